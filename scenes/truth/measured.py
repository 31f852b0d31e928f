"""A row of the truth for a marker whose pose was measured: in a photograph, of which nothing was rendered."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera, project
from roundel.scenes.geometry.conic import vanishing_line
from roundel.scenes.geometry.pose import tilt_azimuth_deg, transform_points
from roundel.scenes.markers.marker import Part, Sheet
from roundel.scenes.truth.truth import CONTOUR_POINTS, NO_CIRCLE, circle_truth, matrix_columns, vector_columns
from roundel.scenes.truth.visibility import inside_image
from roundel.scenes.world.placement import part_outline

Array = NDArray[np.float64]

# What only a renderer knows: light and blur at the edge, the pose at both ends of the exposure.
UNKNOWN: dict[str, Any] = {
    **dict.fromkeys(("edge_contrast_dn", "edge_noise_dn", "edge_inside_e", "edge_outside_e", "edge_blur_px")),
    **{f"{end}_camera_from_marker_{i}{j}": None for end in ("open", "close") for i in range(4) for j in range(4)},
}
_SAMPLES = 64


def measured_row(
    frame_id: int, group: str, camera: Camera, sheet: Sheet, part: Part, camera_from_part: Array
) -> dict[str, Any]:
    """One row keyed as in truth.parquet, from a measured pose; what only a renderer knows is None.

    Parameters
    ----------
    frame_id : int
    group : str
    camera : Camera
    sheet : Sheet
        Flat.
    part : Part
        Of the sheet.
    camera_from_part : (4, 4) array
        Its frame has its origin in the part's centre.
    """
    pose = np.asarray(camera_from_part, dtype=np.float64)
    tilt, azimuth = tilt_azimuth_deg(pose[:3, 2])
    distance_m = float(np.linalg.norm(pose[:3, 3]))
    contour = project(camera, transform_points(pose, _around(part, part_outline(sheet, part, CONTOUR_POINTS))))
    centre_px = project(camera, pose[:3, 3])
    seen = inside_image(camera, contour)
    fraction = 1.0 if seen.all() else _visible(camera, part, pose)
    return {
        "frame_id": frame_id,
        "marker_id": part.marker_id,
        "group": group,
        "kind": part.kind,
        "radius_m": part.radius_m,
        **matrix_columns("camera_from_marker", pose),
        **vector_columns("normal", "", pose[:3, 2]),
        **vector_columns("centre", "_m", pose[:3, 3]),
        "distance_m": distance_m,
        "distance_D": distance_m / (2 * part.radius_m) if part.radius_m else None,
        "tilt_deg": float(tilt),
        "azimuth_deg": float(azimuth),
        **(circle_truth(camera, pose, part.radius_m) if part.radius_m else NO_CIRCLE),
        "centre_image_x_px": float(centre_px[0]),
        "centre_image_y_px": float(centre_px[1]),
        **{f"vanishing_line_{i}": float(v) for i, v in enumerate(vanishing_line(pose, camera.K))},
        "contour_x_px": contour[:, 0].tolist(),
        "contour_y_px": contour[:, 1].tolist(),
        "visible_fraction": fraction,
        "hidden_by": "" if seen.all() else "image border",
        "contour_visible": seen.tolist(),
        "surface": "flat",
        "curvature_radius_m": None,
        **UNKNOWN,
        "edge_softness_m": sheet.edge_softness_m,
        "flags": "",
    }


def _around(part: Part, in_sheet: Array) -> Array:
    """Points of the sheet (n, 3) in the part's own frame."""
    return np.asarray(in_sheet - np.array([part.x_m, part.y_m, 0.0]), dtype=np.float64)


def _visible(camera: Camera, part: Part, pose: Array) -> float:
    """Fraction of the part's area that is imaged inside the image."""
    (w, h), step = part.half_size_m(), (np.arange(_SAMPLES) + 0.5) / _SAMPLES * 2 - 1
    x, y = (axis.ravel() for axis in np.meshgrid(w * step, h * step))
    if part.radius_m is not None:
        inner = np.hypot(x, y) < part.radius_m
        x, y = x[inner], y[inner]
    points = np.stack([x, y, np.zeros_like(x)], axis=-1)
    return float(inside_image(camera, project(camera, transform_points(pose, points))).mean())
