"""A report against a baseline.

accuracy: Questions of accuracy: growth and shift of errors, over all circles of a run and in each of its groups
baseline: Baselines: accepted scores in one small Parquet file for git
checks: A check, and a test of the data that becomes one once its p-value is adjusted for all others
detection: Questions of detection: missed circles, false positives, and whether confidences hold over both
gate: The gate: fails when a solver is worse on the same frames by a loss that is certain and that matters
golden: Golden frames: circles that are compared one by one on the same images, where a test would see only noise
output: Output of the gate: lines of text, JUnit XML, a Markdown summary
quantities: What the gate compares: errors, columns, and the smallest loss of each that counts
questions: All questions that the scores of one run allow
uncertainty: Questions of stated uncertainty: covariances of poses, and probabilities of the two candidates
"""
