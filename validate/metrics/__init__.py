"""Errors of a pose, their bounds, and the truth they are measured against.

bop: BOP's MSSD and MSPD of a disc: the largest surface and projection distance at the best in-plane rotation
cramer_rao: Cramer-Rao bounds of each frame's errors, computed from the truth
edge_conditions: What the truth says of each marker's edge: levels, noise, and what else limits the information of
    its pixels
focal_errors: Errors of a focal length that a method measured from the image alone, and of its fusion with the
    default prior
ground_truth: Reference poses: the true circles, or the same circles as placed by the chessboard beside them
jpeg_noise: Noise that JPEG compression adds at an edge, from the quantisation table of the file
level_noise: Noise of a pixel by its level, from the data sheet in `cameras.json`, referred to the electrons that it
    collects
metric: The metrics: column, title, unit, scale, definition and bound of each, in one place
mosaic_noise: What interpolation between the pixels of a Bayer mosaic leaves at an edge, as noise of the grey image
pose_errors: Errors of a pose and of an ellipse
rows: Rows of scores: what the statistics, claims and figures read of them, in memory or on disk
sweeps: The position in its group's sweep of each row of the truth
uncertainty: Scores of a pose's stated covariance: is the truth as far away as it says?
"""
