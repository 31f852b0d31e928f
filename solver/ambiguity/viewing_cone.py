"""The viewing cone of an ellipse and its two circular sections, with derivatives by every uncertain parameter.

In units of the circle's radius the dual cone is M = c c^T - I + n n^T with its lowest eigenvalue at -1; a concentric
circle of r radii in the same plane has M + (1 - r^2) (I - n n^T). So a candidate's normal determines its prediction of
the marker's interior (errata, section 2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.solver.ambiguity.observation import Observation
from roundel.solver.fit.ellipse import shape_of_ellipse

Array = NDArray[np.float64]

NUISANCES = 8  # x, y, S11, S12, S22 of the ellipse, logarithm of the focal length, both principal coordinates


@dataclass(frozen=True, eq=False)
class ViewingCone:
    """The measured cone (row 0), and the cone with each nuisance stepped up (rows 1 to 8) and down (rows 9 to 16).

    Attributes
    ----------
    K : (17, 3, 3) array
    cone : (17, 3, 3) array
        Dual cone in the camera frame, in units of the radius.
    normal : (17, 2, 3) array
        Both candidates, tracked through the steps.
    side : (17, 3) array
        Unit vector e3 normal to the mirror plane of both candidates.
    step : (8,) array
    factor : (8, 8) array
        Square root F of the nuisances' covariance F F^T.
    """

    K: Array
    cone: Array
    normal: Array
    side: Array
    step: Array
    factor: Array

    def derivative(self, values: Array) -> Array:
        """Derivative (..., 8) with respect to the nuisances of values computed in all 17 rows (17, ...)."""
        difference = values[1 : 1 + NUISANCES] - values[1 + NUISANCES :]
        return np.asarray(np.moveaxis(difference, 0, -1) / (2.0 * self.step))

    def spread(self, values: Array) -> Array:
        """Standard deviations as a factor G (..., 8): the covariance of the values (17, ...) is G G^T."""
        return np.asarray(self.derivative(values) @ self.factor)


def viewing_cone(observation: Observation) -> ViewingCone | None:
    """The cone of an observation; None if ellipse or camera are missing."""
    if observation.ellipse is None or observation.uncertain_camera is None:
        return None
    camera = observation.uncertain_camera.camera
    theta = shape_of_ellipse(observation.ellipse)
    # Steps of 1e-4: errors by curvature and rounding (1e-16 times the cone's condition, about 1e5) are below 1e-6.
    size = 1e-4 * float(observation.ellipse[3])
    step = np.array([size] * 5 + [1e-4] + [1e-4 * float(camera.K[0, 0])] * 2)
    steps = np.concatenate([np.zeros((1, NUISANCES)), np.diag(step), -np.diag(step)])
    k = np.repeat(camera.K[None].astype(np.float64), len(steps), axis=0)
    k[:, :2, :2] *= np.exp(steps[:, 5])[:, None, None]
    k[:, :2, 2] += steps[:, 6:]
    cone, normal, side = _sections(theta + steps[:, :5], k)
    if np.sum((normal[0] - observation.normal) ** 2) > np.sum((normal[0, ::-1] - observation.normal) ** 2):
        normal = normal[:, ::-1]
    factor = np.zeros((NUISANCES, NUISANCES))
    if observation.shape_cov is not None and np.all(np.isfinite(observation.shape_cov)):
        value, vector = np.linalg.eigh(observation.shape_cov)
        factor[:5, :5] = vector * np.sqrt(np.maximum(value, 0.0))
    value, vector = np.linalg.eigh(observation.uncertain_camera.projection_covariance())
    factor[5:, 5:] = vector * np.sqrt(np.maximum(value, 0.0))
    return ViewingCone(k, cone, normal, side, step, factor)


def _sections(theta: Array, k: Array) -> tuple[Array, Array, Array]:
    """Cones, normals and e3 for ellipses (m, 5) under K (m, 3, 3); all rows keep the order and signs of row 0."""
    shape = np.zeros((len(theta), 3, 2))
    shape[:, 0, 0], shape[:, 1, 1] = theta[:, 2], theta[:, 4]
    shape[:, 0, 1] = shape[:, 1, 0] = theta[:, 3]
    point = np.concatenate([theta[:, :2], np.ones((len(theta), 1))], axis=1)
    inverse = np.linalg.inv(k)
    p, w = inverse @ point[:, :, None], inverse @ shape
    value, vector = np.linalg.eigh(p @ p.swapaxes(1, 2) - w @ w.swapaxes(1, 2))
    radius2 = -value[:, 0]
    cone = (vector * (value / radius2[:, None])[:, None, :]) @ vector.swapaxes(1, 2)
    mu1, mu3 = value[:, 2] / radius2, np.minimum(-value[:, 1] / radius2, 1.0)
    cos = np.sqrt(mu3 * (mu1 + 1.0) / (mu1 + mu3))[:, None]
    sin = np.sqrt(mu1 * (1.0 - mu3) / (mu1 + mu3))[:, None]
    axis, side = vector[:, :, 2], vector[:, :, 1]
    axis = np.where(axis[:, 2:] < 0, -axis, axis)
    side = side * (-1.0 if side[0, 2] < 0 else 1.0)
    side = np.where((side @ side[0])[:, None] < 0, -side, side)
    return cone, np.stack([-cos * axis - sin * side, -cos * axis + sin * side], axis=1), side


def concentric_image(cone: Array, normal: Array, k: Array, ratio: float) -> tuple[Array, Array]:
    """Image of the concentric circle of `ratio` radii.

    Parameters
    ----------
    cone : (..., 3, 3) array
    normal : (..., 3) array
    k : (..., 3, 3) array
    ratio : float

    Returns
    -------
    centre : (..., 2) array
        Centre of the ellipse, undistorted pixels.
    spread : (..., 2, 2) array
        S S^T of the ellipse {centre + S u, |u| = 1}.
    """
    inner = cone + (1.0 - ratio**2) * (np.eye(3) - normal[..., :, None] * normal[..., None, :])
    dual = k @ inner @ k.swapaxes(-1, -2)
    dual = dual / dual[..., 2:, 2:]
    centre = dual[..., :2, 2]
    return centre, centre[..., :, None] * centre[..., None, :] - dual[..., :2, :2]
