"""Pose of a chessboard from its corners, as the reference of a camera: the better of both poses of its plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.camera.model import Camera, undistort_px
from roundel.solver.detect.chessboard_corners import BoardLayout, board_points_m, detect_corners
from roundel.solver.pose.plane_pose import plane_points, plane_poses

Array = NDArray[np.float64]


def pose_of_corners(corners_px: ArrayLike, layout: BoardLayout, camera: Camera) -> Array | None:
    """Pose `camera_from_board` (4, 4) from corners (N, 2) in the order of `board_points_m`.

    None if a corner is outside the lens's field, or no pose is in front of the camera.
    """
    flat = undistort_px(camera, corners_px)
    if not np.all(np.isfinite(flat)):
        return None
    poses = plane_poses(plane_points(board_points_m(layout), flat, camera))
    return poses[0].camera_from_marker if poses else None


def board_pose(image: ArrayLike, layout: BoardLayout, camera: Camera) -> Array | None:
    """Pose `camera_from_board` (4, 4) of the chessboard in an image; None if it is not found."""
    corners = detect_corners(image, layout.columns, layout.rows)
    return None if corners is None else pose_of_corners(corners, layout, camera)
