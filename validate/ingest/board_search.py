"""The board of a sheet in a photograph, and whether the circle is where the sheet has it."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.markers.ink_pattern import reflectance_at
from roundel.scenes.markers.marker import Part, Sheet
from roundel.solver.detect.chessboard_corners import (
    board_points_m,
    detect_corners,
    grey,
    is_whole_board,
    layout_of,
    refined_corners,
)
from roundel.validate.calibration.board_bundle import BoardCorners

Array = NDArray[np.float64]

BOARDS = ("chessboard", "charuco")

# Longer sides of the reductions in which a board is looked for, one after another: the search takes seconds in an image
# of twelve megapixels, and finds no more in it.
_SEARCH_PX = (1600, 3200)
# A pose has six unknowns; six corners of a ChArUco board, not in a line, leave as many residuals.
_LEAST_CORNERS = 6
# Correlation of the grey levels about the circle with its print; that of another picture is near 0, and a shadow or a
# lens that the homography does not know lowers that of the right one by less.
_LEAST_CORRELATION = 0.5
# Samples reach this far, in radii: beyond the outer edge of the ink, and not to the board.
_REACH, _SAMPLES = 1.2, 41

_DICTIONARIES = {
    "aruco_4x4_50": cv2.aruco.DICT_4X4_50,
    "aruco_5x5_100": cv2.aruco.DICT_5X5_100,
    "aruco_6x6_250": cv2.aruco.DICT_6X6_250,
    "apriltag_36h11": cv2.aruco.DICT_APRILTAG_36h11,
}


def find_board(image: ArrayLike, board: Part, linear: ArrayLike | None = None) -> BoardCorners | None:
    """The board of a sheet in an image.

    Parameters
    ----------
    image : (H, W[, C]) array_like
        Of any depth.
    board : Part
        A chessboard, which has to be seen whole, or a ChArUco board, of which six corners are enough.
    linear : (H, W) array_like, optional
        The same image in linear light, in which corners are refined: they scatter by a tenth less than in sRGB levels,
        whose noise the curve has raised in dark squares.

    Returns
    -------
    BoardCorners or None
        None if it was not found.
    """
    levels = grey(image)
    fine = None if linear is None else np.asarray(linear, dtype=np.float64)
    search = _chessboard if board.kind == "chessboard" else _charuco
    sizes = dict.fromkeys(min(longest, max(levels.shape)) for longest in _SEARCH_PX)
    return next((found for longest in sizes if (found := search(levels, board, longest, fine)) is not None), None)


def _reduced(levels: Array, longest: int) -> tuple[Array, float]:
    """The image with its longer side reduced to `longest`, and the factor back."""
    scale = max(levels.shape) / longest
    if scale <= 1:
        return levels, 1.0
    size = round(levels.shape[1] / scale), round(levels.shape[0] / scale)
    return np.asarray(cv2.resize(levels, size, interpolation=cv2.INTER_AREA)), scale


def _chessboard(levels: Array, board: Part, longest: int, fine: Array | None) -> BoardCorners | None:
    layout = layout_of(board.layout)
    small, scale = _reduced(levels, longest)
    corners = detect_corners(small, layout.columns, layout.rows)
    if corners is None or not is_whole_board(small, corners, layout.columns, layout.rows):
        return None
    if scale > 1 or fine is not None:
        whole = ((corners + 0.5) * scale - 0.5).reshape(layout.rows, layout.columns, 2)
        corners = refined_corners(levels if fine is None else fine, whole).reshape(-1, 2)
    return BoardCorners(board_points_m(layout), corners)


def _charuco(levels: Array, board: Part, longest: int, fine: Array | None) -> BoardCorners | None:
    keys = board.layout
    columns, rows, square = int(keys["columns"]), int(keys["rows"]), float(keys["square_m"])
    ids = int(keys["first_id"]) + np.arange(columns * rows // 2)
    tags = cv2.aruco.getPredefinedDictionary(_DICTIONARIES[str(keys["family"])])
    printed = cv2.aruco.CharucoBoard((columns, rows), square, float(keys["tag_m"]), tags, ids)
    small, scale = _reduced(levels, longest)
    corners: Any
    found: Any  # None if there are none, which OpenCV's type stubs do not say
    corners, found, _, _ = cv2.aruco.CharucoDetector(printed).detectBoard(np.rint(small).astype(np.uint8))
    if found is None or len(found) < _LEAST_CORNERS:
        return None
    row, column = np.divmod(np.ravel(found), columns - 1)
    points = np.stack([(column + 1 - columns / 2) * square, (rows / 2 - row - 1) * square, np.zeros(len(row))], axis=-1)
    if np.linalg.matrix_rank(points[:, :2] - points[:, :2].mean(axis=0)) < 2:
        return None
    pixels = (np.asarray(corners, dtype=np.float64).reshape(-1, 2) + 0.5) * scale - 0.5
    # A window of the refinement ends where the tags begin.
    clear = (square - float(keys["tag_m"])) / 2 / square
    side = _square_px(points, pixels, square) * min(1.0, clear / 0.4)
    return BoardCorners(points, refined_corners(levels if fine is None else fine, pixels, side))


def _square_px(points_m: Array, pixels: Array, square_m: float) -> float:
    """Smallest side of a square in the image, by the homography of the corners, px."""
    h, _ = cv2.findHomography(points_m[:, :2], pixels)
    steps = [points_m[:, :2] + step for step in ([square_m, 0.0], [0.0, square_m])]
    moved = [cv2.perspectiveTransform(p.reshape(-1, 1, 2), h).reshape(-1, 2) - pixels for p in steps]
    return float(min(np.linalg.norm(m, axis=1).min() for m in moved))


def shows_circle(image: ArrayLike, corners: BoardCorners, sheet: Sheet, board: Part, circle: Part) -> bool:
    """Whether the image looks like the print where the board says the circle is.

    It does not if the sheet is another one, or if the image is mirrored: a mirrored chessboard is a chessboard. A
    circle outside the image is not judged: True.

    Parameters
    ----------
    image : (H, W[, C]) array_like
    corners : BoardCorners
    sheet : Sheet
    board, circle : Part
        Parts of the sheet.
    """
    assert circle.radius_m is not None
    levels = grey(image)
    h, _ = cv2.findHomography(corners.points_m[:, :2], corners.pixels)
    if h is None:
        return False
    step = np.linspace(-_REACH, _REACH, _SAMPLES) * circle.radius_m
    x, y = (axis.ravel() for axis in np.meshgrid(step + circle.x_m, step + circle.y_m))
    here = np.hypot(x - circle.x_m, y - circle.y_m) <= _REACH * circle.radius_m
    x, y = x[here], y[here]
    in_board = np.stack([x - board.x_m, y - board.y_m], axis=-1)
    place = np.rint(cv2.perspectiveTransform(in_board.reshape(-1, 1, 2), h).reshape(-1, 2)).astype(int)
    inside = np.all((place >= 0) & (place < levels.shape[::-1]), axis=-1)
    if inside.mean() < 0.5:
        return True
    seen = levels[place[inside, 1], place[inside, 0]]
    printed = reflectance_at(sheet, x[inside], y[inside])
    if seen.std() == 0 or printed.std() == 0:
        return False
    return bool(np.corrcoef(seen, printed)[0, 1] > _LEAST_CORRELATION)
