"""An ellipse to both poses of the circle, with covariance.

camera_covariance: What the uncertain parameters of a camera do to the ellipse of a circle
centre_rows: The poses of an ellipse that moves while the rows are read, at mid-exposure of the row of the circle's
    centre
circle_pose: Both poses of a circle of known radius from its image, in closed form
circle_pose_batch: Both poses of many circles at once, vectorised; `circle_pose` explains the method
circle_pose_scalar: Both poses of a single circle in plain Python floats, without the overhead of vectorised calls
coplanar_circles: Maximum likelihood for circles of one plane: focal length, normal, centres and radii from their
    ellipses
direct_homography: Homography from points of a plane to the image, and the pose that it shows, without iteration
focal_uncertainty: Standard deviation of log f, the focal length, of a closed form of ellipses and of a least sum of
    squares
plane_focal: Focal length from one view of a known plane: square pixels and a known principal point
plane_homography: Homography from a plane to the image, by maximum likelihood from the ellipses of circles at known
    places in it
plane_pose: Both poses of a plane from points on it: Collins and Bartoli, Infinitesimal Plane-based Pose Estimation
    (2014)
pose_covariance: Covariance of both poses, propagated from the ellipse and from the camera
pose_curvature: What the bent map from ellipse and focal length to pose adds to a covariance of first order
shape_rates: How fast the ellipse of a circle moves when the camera does
"""
