"""An ellipse to both poses of the circle, with covariance.

circle_pose: The two poses of a circle of known radius from its image, in closed form
circle_pose_batch: Many circles' two poses at once, coordinate by coordinate: the arithmetic of `circle_pose`, whose
    text explains it
circle_pose_scalar: One circle's two poses with plain Python floats: the method of `circle_pose`, where a vectorised
    call costs more in overhead than in arithmetic
pose_covariance: How far both poses of a circle may be off: the covariance of its ellipse and of the camera, carried
    to them
pose_region: Regions that hold the true normal or the true centre with a stated probability, from the covariance of
    a pose
"""
