"""The ellipse of one marker as detected by each program, and the error of the resulting pose.

For each program the ellipse nearest to the truth is used, so that only measurement accuracy is compared, not selection.
The pose is that of the program's own closed form; if there are two, the better one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import closed_forms
import cv2
import numpy as np
from closed_forms import ClosedForm, opencv_ellipse, ours, toward_camera
from numpy.typing import NDArray

from roundel.datasets.dataset import open_dataset
from roundel.scenes.geometry.pose import angle_deg
from roundel.solver.methods.roundel_fits import METHODS, detect_circles, fit_detection
from roundel.solver.photometry.image_levels import grey_levels

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]
OpenCVEllipse = tuple[tuple[float, float], tuple[float, float], float]

_FOUND_CENTRE, _FOUND_SIZE = 0.25, 0.3  # of the major semi-axis, and of either axis: an ellipse closer is the marker


@dataclass(frozen=True)
class Program:
    """A method from an image to ellipses, and from an ellipse to poses."""

    name: str
    ellipses: Callable[[Grey, Any], list[OpenCVEllipse]]
    poses: ClosedForm


@dataclass(frozen=True)
class Error:
    """Error of one program in one frame; NaN if it found no ellipse of the marker."""

    level: str
    normal_deg: float
    position_pct: float
    centre_px: float
    axis_px: float


def otsu(grey: Grey, _: Any) -> list[OpenCVEllipse]:
    """Threshold, contours, `cv2.fitEllipse`, as in tutorials and in pycalib's documentation."""
    _, binary = cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    return _of_contours(binary)


def canny(grey: Grey, _: Any) -> list[OpenCVEllipse]:
    """The same on Canny edges; the upper threshold is Otsu's and the lower half of it."""
    level, _ = cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    return _of_contours(cv2.Canny(grey, level / 2, level))


def _of_contours(binary: Grey) -> list[OpenCVEllipse]:
    contours, _ = cv2.findContours(binary, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    return [cv2.fitEllipse(c) for c in contours if len(c) >= 12]


def edge_drawing(grey: Grey, _: Any) -> list[OpenCVEllipse]:
    """The ellipses of OpenCV's EdgeDrawing, with its default parameters."""
    drawing = cv2.ximgproc.createEdgeDrawing()
    drawing.detectEdges(grey)
    found = drawing.detectEllipses()
    rows = [] if found is None else np.asarray(found, dtype=np.float64).reshape(-1, 6)
    # A circle is returned as r > 0 and a = b = 0.
    return [((x, y), (2 * (a + r), 2 * (b + r)), angle) for x, y, r, a, b, angle in rows]


def simittag_ellipses(grey: Grey, k: Array) -> list[OpenCVEllipse]:
    """The detector's refined outer contours before decoding: the front end of `detect_markers`."""
    from simittag import detect

    return [detect._refine_ellipse(view, tuple(found[:3])) for (found, *_), view, _ in detect._candidate_views(grey, k)]


def roundel(method: str) -> Callable[[Any, Any], list[OpenCVEllipse]]:
    def ellipses(image: Any, camera: Any) -> list[OpenCVEllipse]:
        grey, full_scale_dn = grey_levels(image)
        seen = detect_circles(grey, full_scale_dn)
        fits = (fit_detection(seen, d, camera, method) for d in seen.detections)
        return [opencv_ellipse(fit.ellipse) for fit in fits if fit]

    return ellipses


def programs(peers: dict[str, str]) -> list[Program]:
    pycalib = closed_forms.pycalib if "pycalib" in peers else ours
    asked = "; pose by pycalib" if "pycalib" in peers else ""
    out = [
        Program(f"`cv2.fitEllipse`, Otsu's contour{asked}", otsu, pycalib),
        Program(f"`cv2.fitEllipse`, Canny's edges{asked}", canny, pycalib),
        Program(f"EdgeDrawing's ellipse{asked}", edge_drawing, pycalib),
    ]
    if "simittag" in peers:
        out.append(Program("simittag's ellipse and pose", simittag_ellipses, closed_forms.simittag))
    mine = [m for m in ("ml", "pixels") if m in METHODS]
    return out + [Program(f"**Roundel**, `{m}`", roundel(m), ours) for m in mine]


def frames(dataset: Path, key: str) -> Iterator[tuple[str, Any, Any, dict[str, Any]]]:
    """Level, grey levels, camera and truth of each frame; the level is a column of the truth, or that of a sweep."""
    data = open_dataset(dataset)
    truth = {row["frame_id"]: row for row in data.truth.to_pylist()}
    # A sweep has all its frames at one level before the next level.
    levels = data.study["groups"]["main"].get("sweep", {}).get("levels", [None])
    each = len(data) // len(levels)
    for i, frame_id in enumerate(data.images.frame_ids):
        row = truth[frame_id]
        same = [truth[data.images.frame_ids[j]] for j in range(i // each * each, i // each * each + each)]
        value = float(np.median([r[key] for r in same])) if levels[0] is not None else row[key]
        yield f"{value:.3g}", data.images.linear_image(i)[0], data.images.camera(i), row


def errors(dataset: Path, key: str, asked: list[Program]) -> dict[str, list[Error]]:
    """Error of each program in every frame of a dataset."""
    out: dict[str, list[Error]] = {program.name: [] for program in asked}
    for name, image, camera, row in frames(dataset, key):
        for program in asked:
            # Roundel takes the camera, the others take K.
            given = camera if program.name.startswith("**") else camera.K
            out[program.name].append(_error(program, name, image, given, camera.K, row))
    return out


def _error(program: Program, level: str, image: Any, given: Any, k: Array, row: dict[str, Any]) -> Error:
    missed = Error(level, *(np.nan,) * 4)
    size = np.array([row["ellipse_a_px"], row["ellipse_b_px"]])
    best, least = None, np.inf
    for ellipse in program.ellipses(image, given):
        axes = np.sort(ellipse[1])[::-1] / 2
        off = float(np.hypot(ellipse[0][0] - row["ellipse_x_px"], ellipse[0][1] - row["ellipse_y_px"]))
        gap = off + float(np.abs(axes - size).max())
        near = off < _FOUND_CENTRE * size[0] and np.all(np.abs(axes / size - 1) < _FOUND_SIZE)
        if near and gap < least:
            best, least = (ellipse, off, float(np.abs(axes - size).max())), gap
    if best is None:
        return missed
    ellipse, off, axis = best
    (normals, centres), _ = toward_camera(program.poses(ellipse, k, row["radius_m"]))
    if not np.all(np.isfinite(normals)):
        return missed
    turn = angle_deg(normals, np.array([row[f"normal_{a}"] for a in "xyz"]))
    oracle = int(np.argmin(turn))
    centre = np.array([row[f"centre_{a}_m"] for a in "xyz"])
    position = 100 * float(np.linalg.norm(centres[oracle] - centre)) / row["distance_m"]
    return Error(level, float(turn[oracle]), position, off, axis)
