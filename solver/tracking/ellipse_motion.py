"""Where the ellipse of a marker will be in the next image: a Kalman filter of its centre and shape in the image.

The state is (x, y, S11, S12, S22), as in `shape_of_ellipse`, and its rate of change. Both candidate poses have the same
image, so that this prediction needs no choice between them. Accelerations are white noise: those of a moving marker are
proportional to the ellipse's size, those of a shaking camera to its focal length.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.solver.fit.ellipse import ellipse_of_shape, shape_of_ellipse

Array = NDArray[np.float64]

_MARKER = 15.0  # acceleration of centre and shape, in semi-axes / s^2: 0.6 m/s^2 for a marker of 80 mm
_CAMERA = 1.5  # angular acceleration of the camera, rad/s^2
_LASTS_S = 0.1  # of an acceleration
_FIRST_SPEED = (3.0, 0.5)  # semi-axes / s and rad/s: of a marker that was seen once
_MEASURED_PX = 0.1  # an edge-point ellipse that has not converged, and what lens distortion does to an ellipse
GATE = 30.0  # squared distance of five numbers: a true one in 70,000 is farther


@dataclass(frozen=True, eq=False)
class EllipseMotion:
    """State (10,) and covariance (10, 10) of an ellipse in the image and of its motion."""

    state: Array
    cov: Array
    focal_px: float

    @classmethod
    def begin(cls, ellipse: Array, focal_px: float) -> EllipseMotion:
        """From the first sight of it (5,)."""
        size, turn = _FIRST_SPEED
        a = float(ellipse[2])
        speed = np.array([np.hypot(size * a, turn * focal_px)] * 2 + [size * a] * 3)
        cov = np.diag(np.concatenate([np.full(5, _MEASURED_PX), speed]) ** 2)
        return cls(np.concatenate([shape_of_ellipse(ellipse), np.zeros(5)]), cov, focal_px)

    @property
    def ellipse(self) -> Array | None:
        """The ellipse (5,); None if the prediction is no ellipse any more."""
        theta = self.state[:5]
        if not (theta[2] > 0 and theta[2] * theta[4] > theta[3] ** 2):
            return None
        ellipse = ellipse_of_shape(theta)
        return ellipse if ellipse[3] > 1.0 else None

    def after(self, dt: float) -> EllipseMotion:
        """The prediction for `dt` seconds later."""
        f = np.eye(10)
        f[:5, 5:] = dt * np.eye(5)
        a = float(np.sqrt(abs(self.state[2] * self.state[4] - self.state[3] ** 2)))
        density = np.array([np.hypot(_MARKER * a, _CAMERA * self.focal_px)] * 2 + [_MARKER * a] * 3) ** 2 * _LASTS_S
        q = np.kron([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]], np.diag(density))
        return EllipseMotion(f @ self.state, f @ self.cov @ f.T + q, self.focal_px)

    def distance(self, ellipse: Array) -> float:
        """Squared Mahalanobis distance of an ellipse (5,) from the prediction; compare it with `GATE`."""
        residual = shape_of_ellipse(ellipse) - self.state[:5]
        return float(residual @ np.linalg.solve(self.cov[:5, :5] + _MEASURED_PX**2 * np.eye(5), residual))

    def seen(self, ellipse: Array, shape_cov: Array | None) -> EllipseMotion:
        """After an ellipse (5,) was measured, with the covariance (5, 5) of its shape if that is known."""
        own = _MEASURED_PX**2 * np.eye(5) + (0.0 if shape_cov is None else shape_cov)
        gain = np.linalg.solve(self.cov[:5, :5] + own, self.cov[:5]).T
        cov = self.cov - gain @ self.cov[:5]
        state = self.state + gain @ (shape_of_ellipse(ellipse) - self.state[:5])
        return EllipseMotion(state, 0.5 * (cov + cov.T), self.focal_px)
