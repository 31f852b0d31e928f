"""An ellipse to both poses of the circle, with covariance.

circle_pose: Both poses of a circle of known radius from its image, in closed form
circle_pose_batch: Both poses of many circles at once, vectorised; `circle_pose` explains the method
circle_pose_scalar: Both poses of a single circle in plain Python floats, without the overhead of vectorised calls
pose_covariance: Covariance of both poses, propagated from the ellipse and from the camera
"""
