"""One detection as priors and cues see it, and the log-likelihoods that they return."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from roundel.solver.intrinsics.uncertain_camera import UncertainCamera

Array = NDArray[np.float64]

# Of a hundred declarations one is taken to be a mistake: the share of a likelihood that says nothing. Knowledge that
# contradicts the image then cannot decide by which of two impossibilities is the smaller.
MISTAKES = 0.01

# Squared distance, in sigmas of two dimensions, beyond which a candidate does not fit: 0.03 % of the true ones.
MISFIT = 16.0


@dataclass(frozen=True, eq=False)
class Observation:
    """One detection with both its poses. What is None is not known, and what would need it is left out.

    Attributes
    ----------
    normal : (2, 3) array
        Of both candidates, out of the printed face, in the order of `CirclePoses`.
    cov : (2, 6, 6) array or None
        Covariance of (centre in m, normal) of each candidate, what the camera's assumption adds included.
    ellipse : (5,) array or None
        Outer contour in undistorted pixel coordinates: x_px, y_px, a_px, b_px, angle_deg.
    shape_cov : (5, 5) array or None
        Covariance of (x, y, S11, S12, S22), see `EllipseFit`.
    uncertain_camera : UncertainCamera or None
        The camera that the poses rest on, and how well it is known.
    image : (H, W) array or None
        Grey levels, linear in the light; image pixels, lens distortion still in them.
    blur_px : float
        Gaussian sigma of the blur of the marker's edges, the pixel's aperture not included.
    """

    normal: Array
    cov: Array | None = None
    ellipse: Array | None = None
    shape_cov: Array | None = None
    uncertain_camera: UncertainCamera | None = None
    image: NDArray[Any] | None = None
    blur_px: float = 0.5


@dataclass(frozen=True)
class Verdict:
    """What one piece of knowledge says.

    Attributes
    ----------
    log_odds : float
        Natural logarithm of the odds of candidate 0 against candidate 1; infinite where it is certain.
    basis : str
        In words for the user.
    """

    log_odds: float
    basis: str


class Evidence(Protocol):
    """A piece of knowledge: anything that turns an observation into a verdict."""

    def verdict(self, observation: Observation) -> Verdict:
        """The odds of candidate 0 against candidate 1, and why."""
        ...

    def problem(self) -> str:
        """What is wrong with the declaration itself, in one clause; empty if nothing is."""
        ...
