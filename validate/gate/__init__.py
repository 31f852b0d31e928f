"""A report against a baseline.

baseline: Baselines: accepted scores in one small Parquet file for git
checks: Checks of one run against its baseline, paired circle by circle
gate: The gate: fails when a solver is worse on the same frames by a loss that is certain and that matters
output: Output of the gate: lines of text, JUnit XML, a Markdown summary
"""
