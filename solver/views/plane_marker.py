"""A detection from the corners of a flat marker: both poses, and the focal length measured from this view alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.focal_fusion import fused_camera
from roundel.scenes.camera.model import Camera, distort_px, distorts, undistort_px
from roundel.solver.methods.plugin import Found, View
from roundel.solver.pose.plane_focal import PlaneFocal, focal_from_plane
from roundel.solver.pose.plane_pose import PlanePose, plane_points, plane_poses

Array = NDArray[np.float64]

# The other pose is excluded when its chi^2 is larger by this: odds of 19 to 1 for equal priors.
DECIDED = 2 * np.log(19.0)


def found_plane(
    view: View,
    points_m: Array,
    pixels: Array,
    cov_px2: float | Array,
    square: bool = False,
    identity: int | None = None,
) -> Found:
    """Poses of a flat marker, with the focal length where the view measures it.

    Parameters
    ----------
    view : View
    points_m : (N, 3) array
        Corners in the marker frame, Z = 0.
    pixels : (N, 2) array
        Their images in undistorted pixels of `view.camera`.
    cov_px2 : float or (2N, 2N) array
        Variance of each coordinate, or covariance of x0, y0, x1, ...
    square : bool
        Whether the points are the corners of one square, see `plane_poses`.
    identity : int, optional

    Returns
    -------
    Found
        With both poses; chosen if the reprojection error excludes the other one. Without a focal length where the
        marker is too close to fronto-parallel to measure it.
    """
    focal = measured_focal(view.camera, points_m, pixels, cov_px2, square)
    camera, points = view.camera, pixels
    if focal is not None and view.focal_sigma > 0:
        camera = fused_camera(camera, view.focal_sigma, focal.focal_px, focal.sigma_px)
        if distorts(camera):  # the lens model is in units of the focal length
            points = undistort_px(camera, distort_px(view.camera, pixels))
    poses = plane_poses(plane_points(points_m, points, camera, cov_px2), square=square)
    if not poses:
        return Found(failure="no pose of the plane is in front of the camera; are the corners those of this marker?")
    return Found(
        poses=[(pose.normal, pose.centre_m) for pose in poses],
        chosen=0 if decided(poses) else None,
        identity=identity,
        focal_px=None if focal is None else focal.focal_px,
        focal_sigma_px=None if focal is None else focal.sigma_px,
        camera=camera,
    )


def measured_focal(
    camera: Camera, points_m: Array, pixels: Array, cov_px2: float | Array, square: bool
) -> PlaneFocal | None:
    """Focal length from the view alone; None where it does not bound one."""
    try:
        return focal_from_plane(plane_points(points_m, pixels, camera, cov_px2), square)
    except ValueError:
        return None


def decided(poses: list[PlanePose]) -> bool:
    """Whether the reprojection error decides between the poses, the better of which is first."""
    return len(poses) == 1 or poses[1].chi2 - poses[0].chi2 > DECIDED
