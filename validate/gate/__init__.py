"""A report against a baseline.

baseline: Baselines: the scores that later ones are held against, one small Parquet file for git
checks: The questions that a gate asks of one run, circle by circle paired with the baseline's, and how it words the
    answers
gate: The gate: has a solver become worse on the same frames? Red only for a loss that is certain and that matters
output: What a gate says, for people and for CI: lines, JUnit XML, a Markdown summary
"""
