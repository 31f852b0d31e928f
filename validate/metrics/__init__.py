"""Errors of a pose, their bounds, and the truth they are measured against.

bop: MSSD and MSPD of a disc: the farthest that its rim lies from where it should, at the best turn about its normal
cramer_rao: The Cramer-Rao bound of each frame's errors, from the truth: what no unbiased method could do better
    than
ground_truth: What estimates are compared with: the true circles, or the same circles as a chessboard beside them
    places them
metric: The metrics: what each number is, in one place
pose_errors: Errors of a pose and of an ellipse; `validate.metrics.metric` has their names, units and definitions
sweeps: Where a frame stands in its group's sweep: the same position of two levels is the same frame but for one key
"""
