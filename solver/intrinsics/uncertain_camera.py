"""A camera with its uncertainty: the best guess, its standard deviations, and their basis."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera
from roundel.scenes.camera.row_time import RowTime

Array = NDArray[np.float64]


@dataclass(frozen=True)
class UncertainCamera:
    """A camera to estimate with, and its uncertainty.

    Attributes
    ----------
    camera : Camera
        The best guess.
    focal_sigma : float
        Standard deviation of the focal length, as a fraction of it; 0 if it is taken as exact.
    principal_sigma_px : float
        Standard deviation of each coordinate of the principal point; 0 if it is taken as exact.
    basis : str
        The basis of the numbers, for the user.
    row_time : RowTime or None
        Readout of a rolling shutter, with the prior of the twist; None for a global shutter.
    covariance : (c, c) array or None
        Covariance of fx, fy, cx, cy (px) and of the first c - 4 coefficients of OpenCV's lens model, beside the errors
        that `focal_sigma` and `principal_sigma_px` state, and independent of them; None if there are no others.
    """

    camera: Camera
    focal_sigma: float = 0.0
    principal_sigma_px: float = 0.0
    basis: str = "the camera that was given"
    row_time: RowTime | None = None
    covariance: Array | None = None

    @property
    def is_exact(self) -> bool:
        """Whether no parameter is uncertain."""
        return not (self.focal_sigma or self.principal_sigma_px or self.covariance is not None)

    def as_exact(self) -> UncertainCamera:
        """The same camera with every parameter taken as exact."""
        return replace(self, focal_sigma=0.0, principal_sigma_px=0.0, covariance=None)

    def projection_covariance(self) -> Array:
        """Covariance (3, 3) of the logarithm of the focal length and of the principal point (px): all errors."""
        total = np.diag([self.focal_sigma**2, self.principal_sigma_px**2, self.principal_sigma_px**2])
        if self.covariance is not None:
            to_log = np.zeros((3, len(self.covariance)))
            to_log[0, :2] = 0.5 / self.camera.K[0, 0], 0.5 / self.camera.K[1, 1]
            to_log[1, 2] = to_log[2, 3] = 1.0
            total += to_log @ self.covariance @ to_log.T
        return total
