"""OpenCV's blob and grid detectors as plug-ins, written as a third party would: centres, or the pose of a grid."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import undistort_px
from roundel.scenes.markers.circle_grid import circle_grid_centres_m
from roundel.solver.methods.plugin import Found, MethodFailure, View


def _detector(grey: NDArray[np.uint8]) -> cv2.SimpleBlobDetector:
    """`cv2.SimpleBlobDetector` with two changed limits and its circularity filter enabled."""
    parameters = cv2.SimpleBlobDetector.Params()
    # By default it limits areas to 5,000 px, a disc of 80 px, and merges two dots closer than 10 px.
    parameters.minArea, parameters.maxArea = 25.0, float(grey.size)
    parameters.minDistBetweenBlobs = 2.0
    # A circle tilted by 63 degrees has 0.80, a square 0.785; without the filter, sheets of paper are also blobs.
    parameters.filterByCircularity, parameters.minCircularity = True, 0.8
    return cv2.SimpleBlobDetector.create(parameters)


def blobs(view: View) -> list[Found]:
    """Centres of dark blobs by `cv2.SimpleBlobDetector`."""
    return [Found(centre_px=point.pt) for point in _detector(view.grey).detect(view.grey)]


def circles_grid(view: View) -> list[Found]:
    """Centres of a grid of dots by `cv2.findCirclesGrid`.

    The grid's size is read from the layout of the printed marker (`columns`, `rows`, and `layout`, which says whether
    it is asymmetric).
    """
    layouts = [m["layout"] for m in view.markers if _is_grid(m.get("layout"))]
    sizes = {(d["columns"], d["rows"], d.get("layout") == "asymmetric") for d in layouts}
    out: list[Found] = []
    for columns, rows, asymmetric in sorted(sizes):
        out += [Found(centre_px=centre) for centre in _grid_px(view.grey, columns, rows, asymmetric)]
    return out


def _grid_px(grey: NDArray[np.uint8], columns: int, rows: int, asymmetric: bool) -> NDArray[np.float64]:
    """Centres (N, 2) of a grid's dots, row by row; none if it is not found."""
    flag = cv2.CALIB_CB_ASYMMETRIC_GRID if asymmetric else cv2.CALIB_CB_SYMMETRIC_GRID
    found, centres = cv2.findCirclesGrid(grey, (columns, rows), flags=flag, blobDetector=_detector(grey))
    return np.reshape(centres, (-1, 2)).astype(np.float64) if found else np.empty((0, 2))


def circle_grid_pose(view: View) -> list[Found]:
    """Pose of a `circle_grid` by `cv2.findCirclesGrid` and `cv2.solvePnP`: blobs are taken as images of the centres."""
    grids = [m for m in view.markers if m["kind"] == "circle_grid"]
    if not grids:
        printed = ", ".join(sorted({str(m["kind"]) for m in view.markers})) or "unknown"
        raise MethodFailure(f"it reads circle_grid; the printed marker is {printed}")
    layout = grids[0]["layout"]
    asymmetric = layout["layout"] == "asymmetric"
    centres = _grid_px(view.grey, layout["columns"], layout["rows"], asymmetric)
    if not len(centres):
        return []
    plane = circle_grid_centres_m(layout["columns"], layout["rows"], layout["spacing_m"], asymmetric)
    points = undistort_px(view.camera, centres)
    ok, rotation, translation = cv2.solvePnP(np.pad(plane, ((0, 0), (0, 1))), points, view.camera.K, None)
    if not ok:
        return []
    normal = cv2.Rodrigues(rotation)[0][:, 2]
    # A symmetric grid reads the same upside down, which is the same plane seen from the same side.
    centre = translation[:, 0]
    return [Found(poses=[(normal, centre)])] if normal @ centre < 0 else []


def _is_grid(layout: object) -> bool:
    return isinstance(layout, dict) and {"columns", "rows"} <= set(layout)
