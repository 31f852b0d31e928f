"""The chessboard, which the paper takes as its reference, as a method: pose and focal length from one view of a board.

Corners by `cv2.findChessboardCornersSB` (Duda and Frese, 2018), refined; pose by Collins and Bartoli (2014); the focal
length from the board's homography (Zhang, 2000). A pose is that of the board's centre.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import undistort_px
from roundel.scenes.errors import DataError
from roundel.solver.detect.chessboard_corners import (
    BoardLayout,
    board_points_m,
    detect_corners,
    is_whole_board,
    layout_of,
)
from roundel.solver.methods.plugin import Found, MethodFailure, View
from roundel.solver.pose.plane_pose import plane_points, plane_poses, refined_pose
from roundel.solver.views.circles_of_view import require_kind
from roundel.solver.views.plane_marker import found_plane

Array = NDArray[np.float64]

# Variance of a corner's coordinate on a clean render, px^2: the residuals of a board may be smaller by chance.
FLOOR_PX2 = 0.01**2
# Of 40 boards each with squares of 6.5 and 5.5 px, the detector finds 33 and 22, and all of them at twice the size.
# Large images would take long.
MAGNIFIED, LARGEST_MAGNIFIED_PX = 2, 1000


def find(view: View) -> list[Found]:
    """Pose and focal length of the chessboard, alone or beside a disc."""
    require_kind(view, "chessboard")
    boards = [marker["layout"] for marker in view.markers if marker["kind"] == "chessboard"]
    if not boards:
        raise MethodFailure("a chessboard is found by its number of squares, and nothing tells what is printed")
    return [_board(view, board) for board in boards]


def _corners(view: View, layout: BoardLayout) -> Array | None:
    """Corners in the image; a board of squares of a few pixels is looked for in a magnified image, too."""
    scales = (1,) if max(view.grey.shape) > LARGEST_MAGNIFIED_PX else (1, MAGNIFIED)
    for scale in scales:
        image = cv2.resize(view.image, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
        found = detect_corners(image, layout.columns, layout.rows)
        if found is not None and is_whole_board(image, found, layout.columns, layout.rows):
            # Resizing keeps the image's border, half a pixel before the centre of the first pixel.
            return (found + 0.5) / scale - 0.5
    return None


def _board(view: View, described: dict[str, object]) -> Found:
    try:
        layout = layout_of(described)
    except DataError as error:
        return Found(failure=str(error))
    corners = _corners(view, layout)
    if corners is None:
        return Found(failure=f"no chessboard of {layout.columns} by {layout.rows} inner corners was found")
    flat = undistort_px(view.camera, corners)
    if not np.all(np.isfinite(flat)):
        return Found(failure="a corner of the chessboard is outside the field of the camera's lens model")
    points = board_points_m(layout)
    given = plane_points(points, flat, view.camera)
    # The residuals of a fit with its own focal length give the corners' noise, whatever camera was assumed.
    fits = [refined_pose(given, pose.camera_from_marker, free=True) for pose in plane_poses(given)]
    left = min((fit.chi2 for fit in fits if fit is not None), default=np.inf)
    variance = max(left / (2 * len(points) - 7), FLOOR_PX2)
    if not np.isfinite(variance):
        return Found(failure="no pose of the chessboard is in front of the camera")
    return found_plane(view, points, flat, variance)
