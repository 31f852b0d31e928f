"""The exact truth about a frame.

edge_points: Points mode: noisy points on the true contour, the paper's experiment without images (its section V)
measured: A row of the truth for a marker whose pose was measured: in a photograph, of which nothing was rendered
row_poses: Rolling shutter: the pose for each sensor row that images a marker
truth: The exact truth of a frame, in float64: one row for each marker
visibility: How much of a marker is seen, and what hides the rest
"""
