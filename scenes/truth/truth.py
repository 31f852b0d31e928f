"""The exact truth of a frame, in float64: one row for each marker.

Names, frames and units are those of `docs/dataset-format.md`. Values that depend on the developed image (contrast and
noise at the edge) are added when the frame is finished.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.airy import spread_px
from roundel.scenes.camera.model import Camera, project
from roundel.scenes.camera.motion import image_of
from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic, other_candidate, vanishing_line
from roundel.scenes.geometry.pose import tilt_azimuth_deg
from roundel.scenes.markers.marker import Part
from roundel.scenes.truth.visibility import contour_visible, visibility
from roundel.scenes.world.frame import Frame
from roundel.scenes.world.placement import part_outline

CONTOUR_POINTS = 256

_UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


def defocus_radius_px(camera: Camera, depth_m: float) -> float:
    """Radius in pixels of the disc over which a thin lens spreads a point at `depth_m`: fx A |1/z - 1/u|."""
    if camera.aperture_radius_m == 0:
        return 0.0
    return float(camera.K[0, 0] * camera.aperture_radius_m * abs(1.0 / depth_m - 1.0 / camera.focus_distance_m))


def edge_blur_px(frame: Frame, part: Part) -> float:
    """Standard deviation along one axis, in pixels, of the blur at a part's centre, averaged over both axes.

    Variances add: the pixel's own area (side^2 / 12), the lens (radius^2 / 4 for a round aperture, radius^2 (2 +
    cos(2 pi / n)) / 12 for n blades), the declared Airy pattern, and motion along a line (length^2 / 12, half of it
    along either axis on average).
    """
    camera, exposure_s = frame.camera, frame.motion.exposure_s
    round_ = 3.0 if camera.blades == 0 else 2.0 + float(np.cos(2 * np.pi / camera.blades))
    defocus = defocus_radius_px(camera, float(frame.camera_from_part(part)[2, 3])) ** 2 * round_ / 12
    ends = [project(camera, frame.camera_from_part(part, s * exposure_s / 2)[:3, 3]) for s in (-1, 1)]
    length2 = float(np.sum((ends[1] - ends[0]) ** 2)) if frame.motion.moves else 0.0
    return float(np.sqrt(camera.pixel_side**2 / 12 + defocus + spread_px(camera)[0] ** 2 + length2 / 24))


def vector_columns(prefix: str, suffix: str, values: NDArray[np.float64]) -> dict[str, float]:
    """A vector (3,) as columns `prefix_x`, `_y`, `_z`, each with the suffix."""
    return {f"{prefix}_{axis}{suffix}": float(v) for axis, v in zip("xyz", values, strict=True)}


def matrix_columns(name: str, matrix: NDArray[np.float64]) -> dict[str, float]:
    """A matrix (4, 4) as columns `name_00` to `name_33`."""
    return {f"{name}_{i}{j}": float(matrix[i, j]) for i in range(4) for j in range(4)}


def circle_truth(camera: Camera, pose: NDArray[np.float64], radius_m: float) -> dict[str, Any]:
    """Conic, ellipse and second candidate of a circle, as columns."""
    conic = conic_of_circle(pose, radius_m, camera.K)
    other_normal, other_centre = other_candidate(pose[:3, 2], pose[:3, 3], radius_m)
    names = ("ellipse_x_px", "ellipse_y_px", "ellipse_a_px", "ellipse_b_px", "ellipse_angle_deg")
    return {
        **{f"conic_{i}{j}": float(conic[i, j]) for i, j in _UPPER},
        **{name: float(v) for name, v in zip(names, ellipse_of_conic(conic), strict=True)},
        **vector_columns("other_normal", "", other_normal),
        **vector_columns("other_centre", "_m", other_centre),
    }


# Columns that do not apply to a board, or to a circle on a bent sheet, whose image is no conic.
NO_CIRCLE: dict[str, Any] = {
    **{f"conic_{i}{j}": None for i, j in _UPPER},
    **dict.fromkeys(("ellipse_x_px", "ellipse_y_px", "ellipse_a_px", "ellipse_b_px", "ellipse_angle_deg")),
    **{f"other_normal_{axis}": None for axis in "xyz"},
    **{f"other_centre_{axis}_m": None for axis in "xyz"},
}


def truth_of(frame: Frame) -> list[dict[str, Any]]:
    """One row for each part of the frame's sheets, keyed as in truth.parquet.

    Contrast, noise and electrons at the edge are None until the frame is developed.
    """
    return [_row(view, part) for view in frame.views() for part in view.sheet.parts]


def _row(frame: Frame, part: Part) -> dict[str, Any]:
    camera, pose = frame.camera, frame.camera_from_part(part)
    normal, centre = pose[:3, 2], pose[:3, 3]
    tilt, azimuth = tilt_azimuth_deg(normal)
    distance_m = float(np.linalg.norm(centre))
    sheet_outline = part_outline(frame.sheet, part, CONTOUR_POINTS)
    contour, _ = image_of(camera, frame.motion, frame.camera_from_sheet, sheet_outline)
    (centre_px,), _ = image_of(camera, frame.motion, frame.camera_from_sheet, [frame.part_centre_m(part)])
    line = vanishing_line(pose, camera.K)
    curve = frame.sheet.curve
    has_conic = part.radius_m is not None and curve is None
    visible_fraction, hidden_by = visibility(frame, part, contour)
    return {
        "frame_id": frame.frame_id,
        "marker_id": part.marker_id,
        "group": frame.group,
        "kind": part.kind,
        "radius_m": part.radius_m,
        **matrix_columns("camera_from_marker", pose),
        **vector_columns("normal", "", normal),
        **vector_columns("centre", "_m", centre),
        "distance_m": distance_m,
        "distance_D": distance_m / (2 * part.radius_m) if part.radius_m else None,
        "tilt_deg": float(tilt),
        "azimuth_deg": float(azimuth),
        **(circle_truth(camera, pose, part.radius_m) if has_conic and part.radius_m else NO_CIRCLE),
        "centre_image_x_px": float(centre_px[0]),
        "centre_image_y_px": float(centre_px[1]),
        **{f"vanishing_line_{i}": float(v) for i, v in enumerate(line)},
        "contour_x_px": contour[:, 0].tolist(),
        "contour_y_px": contour[:, 1].tolist(),
        "visible_fraction": visible_fraction,
        "hidden_by": hidden_by,
        "contour_visible": contour_visible(frame, part, contour, sheet_outline).tolist(),
        "surface": "flat" if curve is None else curve.kind,
        "curvature_radius_m": None if curve is None else curve.radius_m,
        "edge_contrast_dn": None,
        "edge_noise_dn": None,
        "edge_inside_e": None,
        "edge_outside_e": None,
        "edge_blur_px": edge_blur_px(frame, part),
        "edge_softness_m": frame.sheet.edge_softness_m,
        **matrix_columns("open_camera_from_marker", frame.camera_from_part(part, -frame.motion.exposure_s / 2)),
        **matrix_columns("close_camera_from_marker", frame.camera_from_part(part, frame.motion.exposure_s / 2)),
    }
