"""Estimates assigned to circles and scored; the summary of a report.

assignment: Which detection is which marker: the nearest contour, or the nearest centre where only that was found,
    one to one
comparisons: Runs against each other on the same circles, and what a set of this size could have shown
run_statistics: A run in numbers: statistics of its errors with intervals over frames, rates, recall, errors over
    their bounds
scores: Scores: one row for every true circle, method, intrinsics and reference, solved or not
summary: summary.json: the scores in a few numbers, by method, intrinsics and reference, and by cell of the study's
    grid
"""
