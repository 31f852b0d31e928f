"""Errors of a focal length that a method measured from the image alone, and of its fusion with the default prior."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.film import DEFAULT_FOCAL_35MM_MM, DEFAULT_FOCAL_35MM_SIGMA_MM, FILM_DIAGONAL_MM
from roundel.scenes.camera.focal_fusion import fused_focal_px
from roundel.scenes.camera.model import Camera

Array = NDArray[np.float64]

DEFAULT_SIGMA = DEFAULT_FOCAL_35MM_SIGMA_MM / DEFAULT_FOCAL_35MM_MM


@dataclass(frozen=True)
class FocalErrors:
    """Magnitudes of the relative errors of a focal length, in percent; NaN where there is none.

    `measured` from the image alone, `fused` with the default phone's prior, and `prior` alone.
    """

    measured: float
    fused: float
    prior: float


def focal_errors(focal_px: float, focal_sigma_px: float, camera: Camera) -> FocalErrors:
    """Errors against the true camera.

    Parameters
    ----------
    focal_px, focal_sigma_px : float
        As measured, with its standard deviation; NaN if unknown.
    camera : Camera
        The true one; its fx is the truth.
    """
    true = float(camera.K[0, 0])
    prior_px = DEFAULT_FOCAL_35MM_MM * float(np.hypot(camera.width_px, camera.height_px)) / FILM_DIAGONAL_MM
    measured, fused = float("nan"), float("nan")
    if np.isfinite(focal_px):
        measured = _percent(focal_px, true)
        if not np.isnan(focal_sigma_px):
            fused = _percent(fused_focal_px(prior_px, DEFAULT_SIGMA, focal_px, focal_sigma_px)[0], true)
    return FocalErrors(measured, fused, _percent(prior_px, true))


def _percent(value: float, true: float) -> float:
    return float(100 * abs(value / true - 1))
