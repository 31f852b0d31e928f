"""Intervals, paired tests and trends; knows no metric.

intervals: How sure a number is: bootstrap intervals over frames, Wilson intervals for rates, Holm's correction for
    families
paired_tests: Two methods on the same frames: is the new one worse, by how much, and what could these frames have
    shown?
trends: Statistics of the paper's claims: slopes, means and ratios of errors, and whether one lies in the region of
    a claim
"""
