"""What the related systems share: circles, blobs and pixels of a view, and from their plane to focal length and poses.

circles_of_view: Circles of a view, as conics with covariance: what methods of several circles start from
disc_coverage: How much of each pixel the image of a printed disc covers, with derivatives, in closed form or by
    quadrature
disc_pattern: A print of discs under a homography, predicted and fitted at the pixels
dual_circular_points: Identities between a circle's image, its centre, the vanishing line, the circular points and
    the focal length
homography_pose: Pose and focal length of a printed plane from a measured homography with covariance
ink_blobs: Dark blobs of an image with the moments of their ink: the dots that a coded marker may have
marker_pixels: The pixels of one marker in a view, and the pose and focal length of its fitted print as a `Found`
plane_marker: A detection from the corners of a flat marker: both poses, and the focal length measured from this
    view alone
plane_of_view: From the circles of a view to its answers: which are printed, the focal length of their plane, a pose
    of each
"""
