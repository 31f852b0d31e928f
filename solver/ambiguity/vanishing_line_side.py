"""The paper's same-side condition as prior knowledge, with its reliability.

`same_side`: the limiting points lie on one side of the vanishing line (E > 0, Proposition 3 with its sign corrected),
and the true pose is the one with the larger n_z of the errata, index 0 here; `opposite_side`: index 1. This converts
external knowledge about the *true* camera: candidates computed with a wrong principal point may be in exchanged order
(errata, section 3, "Reliability guard").
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.solver.ambiguity.observation import Observation, Verdict
from roundel.solver.fit.ellipse import shape_of_ellipse
from roundel.solver.pose.camera_covariance import shape_covariance_of_camera

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SideRule:
    """Declares whether the limiting points are on the same side of the vanishing line.

    Attributes
    ----------
    same : bool
        True for E > 0 (the errata's condition; (i) and (ii) of the paper suffice for it).
    """

    same: bool

    def problem(self) -> str:
        """Empty: a side rule is always valid."""
        return ""

    def verdict(self, observation: Observation) -> Verdict:
        """Probability Phi(|g| / sigma_g) that the candidates are in their true order.

        g = e3_z, where both normals are -cos e1 -+ sin e3: their n_z are equal exactly if e3 is parallel to the image,
        that is, if the principal point is on the ellipse's axis of symmetry, m.(x_e - pp) = 0. So g f is the errata's
        offset along the minor axis, exact also for large and off-axis circles, and sigma_g combines the uncertainties
        of the principal point, the ellipse and the focal length. The prior is flat: cameras are not aimed at markers to
        within the error of the principal point.
        """
        word = "same side" if self.same else "opposite side"
        sign = 1.0 if self.same else -1.0
        if observation.ellipse is None or observation.uncertain_camera is None:
            return Verdict(sign * math.inf, f"{word} of the vanishing line, declared; the camera is taken as exact")
        g, gradient, to_px = _order(observation.ellipse, observation.uncertain_camera.camera.K)
        camera = observation.uncertain_camera
        variance = (camera.focal_sigma * gradient[5]) ** 2
        variance += camera.principal_sigma_px**2 * float(gradient[:2] @ gradient[:2])
        if camera.covariance is not None:
            by_camera = shape_covariance_of_camera(observation.ellipse, camera.camera, camera.covariance)
            variance += float(gradient[:5] @ by_camera @ gradient[:5])
        if observation.shape_cov is not None and np.all(np.isfinite(observation.shape_cov)):
            variance += float(gradient[:5] @ observation.shape_cov @ gradient[:5])
        sigma = math.sqrt(max(variance, 0.0))
        z = g / sigma if sigma > 0 else math.inf
        # log(Phi(z) / Phi(-z)); beyond 8 sigma Phi(-z) is below 1e-15, and the probability rounds to 1.
        odds = math.inf if z > 8.0 else math.log(math.erfc(-z / math.sqrt(2.0)) / math.erfc(z / math.sqrt(2.0)))
        trust = f"{g * to_px:.3g} px from where the order reverses, with a standard deviation of {sigma * to_px:.2g} px"
        return Verdict(sign * odds, f"{word} of the vanishing line, declared; {trust}")


def _order(ellipse: Array, k: Array) -> tuple[float, Array, float]:
    """The quantity that decides the order of the candidates: g = e3_z >= 0, its derivatives, and pixels per unit of g.

    e3 is the middle eigenvector of the dual cone M = K^-1 N K^-T, N = x x^T - [S S^T, 0; 0, 0], x = (centre, 1). By
    perturbation dg = q^T dM e3 with q = sum_j e_j e_jz / (m_3 - m_j) over the other two.

    Returns
    -------
    g : float
    gradient : (6,) array
        With respect to x, y, S11, S12, S22 of the ellipse and the logarithm of the focal length. A shift of the
        principal point is the opposite shift of the ellipse.
    to_px : float
    """
    theta = shape_of_ellipse(ellipse)
    inverse = np.linalg.inv(k)
    s = np.array([[theta[2], theta[3]], [theta[3], theta[4]]])
    x = np.array([theta[0], theta[1], 1.0])
    p, w = inverse @ x, inverse[:, :2] @ s
    value, vector = np.linalg.eigh(np.outer(p, p) - w @ w.T)
    e3 = vector[:, 1] if vector[2, 1] >= 0 else -vector[:, 1]
    # Two equal eigenvalues: a circle viewed along its own axis, whose candidates coincide and have no order.
    low, high = max(value[1] - value[0], 1e-300), min(value[1] - value[2], -1e-300)
    parts = vector[2, 0] / low * vector[:, 0], vector[2, 2] / high * vector[:, 2]
    q, mq = parts[0] + parts[1], value[0] * parts[0] + value[2] * parts[1]
    a, b = q @ inverse, e3 @ inverse
    v, u = s @ a[:2], s @ b[:2]
    ax, bx = float(a @ x), float(b @ x)
    gradient = np.array(
        [
            a[0] * bx + b[0] * ax,
            a[1] * bx + b[1] * ax,
            -(a[0] * u[0] + v[0] * b[0]),
            -(a[0] * u[1] + a[1] * u[0] + v[0] * b[1] + v[1] * b[0]),
            -(a[1] * u[1] + v[1] * b[1]),
            -(float(value[1]) * float(q[:2] @ e3[:2]) + float(mq[:2] @ e3[:2])),
        ]
    )
    return float(e3[2]), gradient, float(k[0, 0]) / max(math.hypot(e3[0], e3[1]), 1e-12)
