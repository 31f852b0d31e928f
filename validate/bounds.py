"""The Cramer-Rao bound of each frame's errors, from the truth: what no unbiased method could do better than.

An edge of contrast h, noise s and blur b (Gaussian sigma, the pixel's own 1/12 px^2 included) tells its position, a
pixel of its length, with a variance of 2 sqrt(pi) b s^2 / h^2; the contour's information about the pose follows
(`scenes.information`). Grey levels and blur are taken as known, which costs a real method up to some ten per cent more.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.datasets.dataset import Dataset
from roundel.scenes.conic import ellipse_perimeter_px
from roundel.scenes.information import contour_information, pose_bound
from roundel.validate.targets import Targets, columns_of

Array = NDArray[np.float64]

PIXEL_VARIANCE = 1.0 / 12.0


@dataclass(frozen=True)
class Bounds:
    """Bounds, row by row as the targets; NaN where the truth does not tell (no noise, no contrast, seen on edge).

    Attributes
    ----------
    normal_deg, position_m, ellipse_centre_px : (N,) arrays
        RMS of the angle, of the distance, and of the distance between ellipse centres.
    information : (N, 5, 5) array
        Of rotation about the marker's X and Y axes (rad) and of the centre (m).
    """

    normal_deg: Array
    position_m: Array
    ellipse_centre_px: Array
    information: Array

    def take(self, rows: NDArray[np.int64]) -> Bounds:
        """Some of the rows."""
        return Bounds(
            self.normal_deg[rows], self.position_m[rows], self.ellipse_centre_px[rows], self.information[rows]
        )


def bounds_of(dataset: Dataset, targets: Targets) -> Bounds:
    """Bounds of every target, with its true camera known."""
    n = len(targets)
    sigma, count = _edge(dataset, targets)
    normal, position, information = np.full(n, np.nan), np.full(n, np.nan), np.full((n, 5, 5), np.nan)
    for i in np.flatnonzero(np.isfinite(sigma) & (sigma > 0) & (count > 0) & targets.placed).tolist():
        k = targets.cameras[targets.camera[i]].K
        try:
            information[i] = contour_information(
                targets.camera_from_marker[i], targets.diameter_m[i] / 2, k, sigma[i], count[i]
            )
        except ValueError:  # seen on edge: no bound
            continue
        bound = pose_bound(information[i])
        if math.isfinite(bound.normal_deg):
            normal[i], position[i] = bound.normal_deg, bound.position_m
    # sqrt(2 / N) sigma for either coordinate of a circle's centre (errata, section 6); an ellipse's is within 10 %.
    with np.errstate(invalid="ignore", divide="ignore"):
        centre = 2.0 * sigma / np.sqrt(count)
    return Bounds(normal, position, np.where(np.isfinite(normal), centre, np.nan), information)


def _edge(dataset: Dataset, targets: Targets) -> tuple[Array, Array]:
    """Standard deviation of an edge point, px, and how many points the contour has: one a pixel of its length."""
    names = ["edge_contrast_dn", "edge_noise_dn", "edge_blur_px", "visible_fraction"]
    contrast, noise, blur, visible = columns_of(targets.truth, names).T
    blur = np.sqrt(np.where(np.isfinite(blur), blur, 0.0) ** 2 + PIXEL_VARIANCE)
    with np.errstate(invalid="ignore", divide="ignore"):
        sigma = np.sqrt(2.0 * math.sqrt(math.pi) * blur) * noise / contrast
    count = ellipse_perimeter_px(targets.ellipse)
    group = np.array(targets.truth["group"].to_pylist(), dtype=object)
    groups: dict[str, Any] = dataset.study.get("groups") or {}
    for name, settings in groups.items():
        if settings.get("mode") != "points":
            continue
        rows, points = group == name, settings["points"]
        sigma[rows] = float(points["sigma_px"])
        if points["count"] != "perimeter":
            count[rows] = float(points["count"])
        visible[rows] = 1.0
    return sigma, count * np.where(np.isfinite(visible), visible, 1.0)
