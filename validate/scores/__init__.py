"""Estimates assigned to circles and scored; the summary of a report.

assignment: Assignment of detections to markers by nearest contour, or nearest centre, one to one
candidates: Up to two poses of each circle, as a run gives them
comparisons: Paired comparisons of runs on the same circles, and the statistical power of a set of frames
false_positives: False positives: detections that match no marker, with the confidence that the method stated for each
readings: What a method reads beside the pose, scored: a focal length measured from the image alone, and an identity
report_files: summary.json, scores.parquet and false_positives.parquet, read again and held against their checksums
run_statistics: Statistics of a run: errors with intervals over frames, rates, recall, errors over their bounds
scores: Scores: one row for every true circle, method, intrinsics and reference, solved or not
scores_on_disk: Scores of a dataset on disk: the few of a small dataset are read at once, of a large one a column
    when it is used
stated_uncertainty: What a run states of itself, held against the truth: regions of its poses, and probabilities of
    two kinds
summary: Summary of the scores by method, intrinsics and reference, and by cell of the study's grid
summary_schema: summary.json as a strict schema, as far as other commands read it
terminal_table: A summary as text for the terminal
"""
