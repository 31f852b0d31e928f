"""Cramer-Rao bounds of each frame's errors, computed from the truth.

Images: the information of all pixels near the edge, each with the noise of its level; the two grey levels and the blur
are unknown (`scenes.geometry.pixel_information`), and so are the width of soft ink and the motion during a readout,
where there are any (`edge_conditions`). Points: the information of a contour with the given number of points and noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.datasets.dataset import Dataset
from roundel.scenes.geometry.conic import ellipse_perimeter_px
from roundel.scenes.geometry.edge_spread_function import PIXEL_VARIANCE
from roundel.scenes.geometry.information import (
    contour_information,
    pose_bound,
    pose_information_of_shape,
)
from roundel.scenes.geometry.pixel_information import shape_information_of_pixels
from roundel.validate.metrics.edge_conditions import Edge, edges_of
from roundel.validate.metrics.ground_truth import Targets, columns_of

Array = NDArray[np.float64]

# Width of the band around the edge that determines the grey levels; beyond 6 px it matters by less than a tenth.
_REACH_PX = 8.0


@dataclass(frozen=True)
class Bounds:
    """Bounds, row by row as the targets; NaN if undefined (no noise, no contrast, viewed edge-on).

    Attributes
    ----------
    normal_deg, position_m, ellipse_centre_px : (N,) arrays
        Bounds of the RMS of the angle, of the distance, and of the distance between ellipse centres.
    information : (N, 5, 5) array
        Fisher information of the rotation about the marker's X and Y axes (rad) and of the centre (m).
    """

    normal_deg: Array
    position_m: Array
    ellipse_centre_px: Array
    information: Array

    def take(self, rows: NDArray[np.int64]) -> Bounds:
        """The selected rows."""
        return Bounds(
            self.normal_deg[rows], self.position_m[rows], self.ellipse_centre_px[rows], self.information[rows]
        )


def bounds_of(dataset: Dataset, targets: Targets) -> Bounds:
    """Bounds of every target, for a known true camera."""
    n = len(targets)
    points, edges, simple = _points(dataset, targets), edges_of(dataset, targets), _simple_edges(dataset, targets)
    normal, position, centre = (np.full(n, np.nan) for _ in range(3))
    information = np.full((n, 5, 5), np.nan)
    for i in np.flatnonzero(targets.placed).tolist():
        pose, radius, k = targets.camera_from_marker[i], targets.diameter_m[i] / 2, targets.cameras[targets.camera[i]].K
        try:
            if np.isfinite(points[i]).all():
                information[i] = contour_information(pose, radius, k, points[i, 0], points[i, 1])
                # sqrt(2 / N) sigma for each coordinate (errata, section 6); for an ellipse this is within 10 %.
                centre[i] = 2.0 * points[i, 0] / math.sqrt(points[i, 1])
            elif np.isfinite(simple[i]).all() and simple[i, 4] > 0:
                shape = _shape_information(targets.ellipse[i], edges[i], simple[i])
                information[i] = pose_information_of_shape(shape, pose, radius, k)
                centre[i] = math.sqrt(np.trace(np.linalg.inv(shape)[:2, :2]))
        except (ValueError, np.linalg.LinAlgError):  # edge-on, no contrast, no noise: no bound
            continue
        bound = pose_bound(information[i])
        if math.isfinite(bound.normal_deg):
            normal[i], position[i] = bound.normal_deg, bound.position_m
    return Bounds(normal, position, np.where(np.isfinite(normal), centre, np.nan), information)


def _shape_information(ellipse: Array, edge: Edge | None, simple: Array) -> Array:
    """Information of a marker's pixels about the shape of its ellipse; `simple` is a row of `_simple_edges`."""
    contrast, blur, dark, light, visible = simple.tolist()
    if edge is None:  # older truth says how much is hidden, and not where
        whole = shape_information_of_pixels(ellipse, 0.0, contrast, blur, (dark, light), reach_px=_REACH_PX)
        return np.asarray(visible * whole)
    levels = edge.inside, edge.outside, edge.blur_px, edge.noise
    return shape_information_of_pixels(ellipse, *levels, reach_px=_REACH_PX, conditions=edge.conditions)


def _simple_edges(dataset: Dataset, targets: Targets) -> Array:
    """Contrast, blur without the pixel, noise of the dark and of the light side, visible fraction: (N, 5)."""
    names = ["edge_contrast_dn", "edge_noise_dn", "edge_blur_px", "visible_fraction"]
    contrast, noise, blur, visible = columns_of(targets.truth, names).T
    slope = _shot_slope(dataset, targets)
    # The truth has the RMS of both sides' noise; it is split by the shot noise, whose variance grows with the level.
    with np.errstate(invalid="ignore"):
        apart = np.minimum(slope * contrast / 2, 0.99 * noise**2)
        blur = np.sqrt(np.maximum(blur**2 - PIXEL_VARIANCE, 0.0))
    return np.stack([contrast, blur, np.sqrt(noise**2 - apart), np.sqrt(noise**2 + apart), visible], axis=-1)


def _shot_slope(dataset: Dataset, targets: Targets) -> Array:
    """Variance of shot noise over level, DN, of each target's frame; 0 if the response is not linear or unknown."""
    of_frame = {}
    for frame_id, record in zip(dataset.images.frame_ids, dataset.images.records, strict=True):
        sensor: dict[str, Any] = record.get("sensor") or {}
        plain = sensor.get("shot_noise") and sensor.get("curve") == "linear" and "isp" not in sensor
        of_frame[frame_id] = float(sensor.get("gain_dn_per_e", 0.0)) if plain else 0.0
    return np.array([of_frame.get(frame_id, 0.0) for frame_id in targets.frame_id.tolist()])


def _points(dataset: Dataset, targets: Targets) -> Array:
    """Standard deviation of an edge point, px, and number of points: (N, 2), NaN if the frame is an image."""
    out = np.full((len(targets), 2), np.nan)
    group = np.array(targets.truth["group"].to_pylist(), dtype=object)
    groups: dict[str, Any] = dataset.study.get("groups") or {}
    for name, settings in groups.items():
        if settings.get("mode") == "points":
            rows, points = group == name, settings["points"]
            out[rows, 0] = float(points["sigma_px"])
            out[rows, 1] = (
                ellipse_perimeter_px(targets.ellipse[rows])
                if points["count"] == "perimeter"
                else float(points["count"])
            )
    return out
