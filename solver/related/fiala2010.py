"""Square tags with a binary code: Fiala, Designing Highly Reliable Fiducial Markers (2010), by OpenCV's ArUco module.

OpenCV (Garrido-Jurado et al., 2014; AprilTag: Olson, 2011) finds the quadrilaterals and reads the code; the corners are
the intersections of lines through the edges, as in ARTag, found here below the pixel. On clean renders of tags with
sides of 20 to 80 px an error of a corner's coordinate is 0.01 px; with OpenCV's `CORNER_REFINE_SUBPIX` it is 0.15 to
0.4 px (the window holds two edges of a convex corner, and its gradients pull the corner inward), with
`CORNER_REFINE_CONTOUR` 0.5 px, and with `CORNER_REFINE_APRILTAG` 0.43 px, of which all but 0.05 px is an offset common
to x and y (its pixels are counted from their corners). Tags whose edges are too short for a line keep OpenCV's corners.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import undistort_px
from roundel.solver.detect.quad_edges import QuadCorners, refine_quad
from roundel.solver.methods.plugin import Found, MethodFailure, View
from roundel.solver.photometry.image_levels import grey_levels
from roundel.solver.views.circles_of_view import require_kind
from roundel.solver.views.plane_marker import found_plane

Array = NDArray[np.float64]

# OpenCV's dictionary of each family, and the cells along a side with the border of one cell.
DICTIONARIES = {
    "aruco_4x4_50": (cv2.aruco.DICT_4X4_50, 6),
    "aruco_5x5_100": (cv2.aruco.DICT_5X5_100, 7),
    "aruco_6x6_250": (cv2.aruco.DICT_6X6_250, 8),
    "apriltag_36h11": (cv2.aruco.DICT_APRILTAG_36h11, 8),
}
# RMS error of a coordinate of the corners that `detected_tags` returns.
OPENCV_CORNER_PX = 0.4


def find(view: View) -> list[Found]:
    """Poses, identities and focal length of square tags; a board of tags is one marker."""
    require_kind(view, "tags")
    out: list[Found] = []
    for layout in _layouts(view):
        tags = detected_tags(view.grey, layout["family"])
        if not tags:
            continue
        refined = [(identity, _refined(view, corners, layout["family"])) for identity, corners in tags]
        if layout["columns"] == layout["rows"] == 1:
            out += [_single(view, layout["tag_m"], identity, quad) for identity, quad in refined]
        else:
            out.append(_board(view, layout, [(i, quad) for i, quad in refined if np.all(np.isfinite(quad.corners_px))]))
    if not out:
        families = ", ".join(sorted({layout["family"] for layout in _layouts(view)}))
        raise MethodFailure(f"no tag of {families} was found; the tag may be too small, hidden or of another family")
    return out


def _layouts(view: View) -> list[dict[str, Any]]:
    """What is printed, once each; every family of a single tag with the area of the disc if nothing tells."""
    printed = [marker["layout"] for marker in view.markers if marker["kind"] == "tags"]
    if not view.markers:
        side = view.diameter_m * np.sqrt(np.pi) / 2
        printed = [{"columns": 1, "rows": 1, "tag_m": side, "family": family} for family in DICTIONARIES]
    out: list[dict[str, Any]] = []
    for layout in printed:
        if layout["family"] not in DICTIONARIES:
            raise MethodFailure(f"it reads {', '.join(DICTIONARIES)}; the printed tag is {layout['family']}")
        if layout in out:
            continue
        if any(other["family"] == layout["family"] for other in out):
            raise MethodFailure(
                f"tags of {layout['family']} are printed in several sizes or boards, and the code does not tell which"
            )
        out.append(layout)
    return out


def detected_tags(grey: NDArray[np.uint8], family: str) -> list[tuple[int, Array]]:
    """Identity and corners (4, 2) of each tag, from the tag's top left clockwise, to within a pixel.

    OpenCV's two detectors of quadrilaterals are tried one after the other, then those for light tags on dark.
    """
    dictionary = cv2.aruco.getPredefinedDictionary(DICTIONARIES[family][0])
    for inverted in (False, True):
        for refinement in (cv2.aruco.CORNER_REFINE_SUBPIX, cv2.aruco.CORNER_REFINE_APRILTAG):
            parameters = cv2.aruco.DetectorParameters()
            parameters.cornerRefinementMethod, parameters.detectInvertedMarker = refinement, inverted
            corners, identities, _ = cv2.aruco.ArucoDetector(dictionary, parameters).detectMarkers(grey)
            if len(corners):
                # The second counts pixels from their corners.
                shift = 0.5 if refinement == cv2.aruco.CORNER_REFINE_APRILTAG else 0.0
                flat = [np.asarray(c, dtype=np.float64).reshape(4, 2) - shift for c in corners]
                return list(zip(np.ravel(identities).astype(int).tolist(), flat, strict=True))
    return []


def _refined(view: View, corners: Array, family: str) -> QuadCorners:
    """Corners from the edges; OpenCV's own where they are too short or too weak, with the error measured of those."""
    levels = grey_levels(view.image, view.curve, keep_8bit=True)[0]
    quad = refine_quad(levels, corners, 1.0 / DICTIONARIES[family][1], view.camera)
    return quad or QuadCorners(undistort_px(view.camera, corners), np.eye(8) * OPENCV_CORNER_PX**2)


def tag_corners_m(tag_m: float) -> Array:
    """Corners (4, 3) of a tag about its centre, in OpenCV's order: from the top left clockwise."""
    return np.array([[-1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, -1.0, 0.0]]) * tag_m / 2


def _single(view: View, tag_m: float, identity: int, quad: QuadCorners) -> Found:
    if not np.all(np.isfinite(quad.corners_px)):
        return Found(failure=f"a corner of tag {identity} is outside the field of the camera's lens model")
    return found_plane(view, tag_corners_m(tag_m), quad.corners_px, quad.cov_px2, True, identity)


def _board(view: View, layout: dict[str, Any], tags: list[tuple[int, QuadCorners]]) -> Found:
    """One pose from all tags of a board that were read."""
    columns, rows, first = layout["columns"], layout["rows"], layout["first_id"]
    pitch = layout["tag_m"] + layout["gap_m"]
    points, pixels, spreads = [], [], []
    seen: set[int] = set()
    for identity, quad in tags:
        place = identity - first
        if not 0 <= place < columns * rows:
            continue
        if identity in seen:
            return Found(failure=f"tag {identity} was found twice; two copies of a board cannot be told apart")
        seen.add(identity)
        row, column = divmod(place, columns)
        shift = np.array([(column - (columns - 1) / 2) * pitch, ((rows - 1) / 2 - row) * pitch, 0.0])
        points.append(tag_corners_m(layout["tag_m"]) + shift)
        pixels.append(quad.corners_px)
        spreads.append(quad.cov_px2)
    if not points:
        last = first + columns * rows - 1
        return Found(failure=f"no tag of the board was found; its identities are {first} to {last}")
    cov = np.zeros((8 * len(points), 8 * len(points)))
    for i, block in enumerate(spreads):
        cov[8 * i : 8 * i + 8, 8 * i : 8 * i + 8] = block
    return found_plane(view, np.concatenate(points), np.concatenate(pixels), cov)
