"""The exact truth about a frame.

edge_points: Points mode: noisy points of the true contour, the paper's own experiment without images (its section
    V)
row_poses: Rolling shutter: a pose for each row of the sensor on which a marker is imaged
truth: The exact truth of a frame, in float64: one row a marker
"""
