"""Points, planes and circles under projection; no camera model, no study.

conic: Conics: the image of a circle, its ellipse, the image of its centre, and the second pose that explains it
edge_spread_function: What a pixel records of a straight edge: the area of a square, blurred by a Gaussian, in
    closed form
information: Fisher information: how well any estimator can know a circle's pose from its contour, or an ellipse
    from its pixels
pose: Poses: normals from tilt and azimuth, rotations, and rigid transforms named by their frames
"""
