"""One detection as priors and cues see it, and the log-likelihoods that they return."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from roundel.solver.intrinsics.uncertain_camera import UncertainCamera

Array = NDArray[np.float64]

# Weight of the uniform outlier component: 1 % of declared priors are assumed wrong. A prior that contradicts both
# candidates therefore cannot decide by a comparison of two negligible likelihoods.
MISTAKES = 0.01

# Squared distance, in sigmas of two dimensions, beyond which a candidate does not fit; 0.03 % of true ones exceed it.
MISFIT = 16.0


@dataclass(frozen=True, eq=False)
class Observation:
    """One detection with both its poses. Unknown fields are None, and cues that need them are skipped.

    Attributes
    ----------
    normal : (2, 3) array
        Normals of both candidates, out of the printed face, in the order of `CirclePoses`.
    cov : (2, 6, 6) array or None
        Covariance of (centre in m, normal) of each candidate, including the uncertainty of the camera.
    ellipse : (5,) array or None
        Outer contour in undistorted pixel coordinates: x_px, y_px, a_px, b_px, angle_deg.
    shape_cov : (5, 5) array or None
        Covariance of (x, y, S11, S12, S22), see `EllipseFit`.
    uncertain_camera : UncertainCamera or None
        The camera used for the poses, with its uncertainty.
    image : (H, W) array or None
        Grey levels, linear in light; image pixels with lens distortion.
    blur_px : float
        Gaussian sigma of the blur of the marker's edges, excluding the pixel's aperture.
    noise_dn : (float, float) or None
        Standard deviation of a pixel inside and outside the contour: light pixels have more noise than dark ones.
    contrast_dn : float or None
        Outside minus inside.
    """

    normal: Array
    cov: Array | None = None
    ellipse: Array | None = None
    shape_cov: Array | None = None
    uncertain_camera: UncertainCamera | None = None
    image: NDArray[Any] | None = None
    blur_px: float = 0.5
    noise_dn: tuple[float, float] | None = None
    contrast_dn: float | None = None


@dataclass(frozen=True)
class Verdict:
    """Result of one piece of prior knowledge.

    Attributes
    ----------
    log_odds : float
        Natural logarithm of the odds of candidate 0 against candidate 1; infinite if it is certain.
    basis : str
        Explanation for the user.
    """

    log_odds: float
    basis: str


class Evidence(Protocol):
    """A piece of prior knowledge: anything that turns an observation into a verdict."""

    def verdict(self, observation: Observation) -> Verdict:
        """The odds of candidate 0 against candidate 1, and their reason."""
        ...

    def problem(self) -> str:
        """What is invalid about the declaration, as one clause; empty if it is valid."""
        ...
