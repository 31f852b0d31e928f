"""Intervals, paired tests and trends; knows no metric.

intervals: Confidence intervals: bootstrap over frames, Wilson for rates; Holm's correction for families
nested: Ratio of two errors over cameras, calibrations of each, and frames of each: a nested bootstrap
paired_tests: Paired tests of two methods on the same frames, with the detectable effect
trends: Slopes, means and ratios of errors, and whether they are in the region required by a claim
"""
