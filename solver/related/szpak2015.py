"""Szpak: an ellipse that is one by construction, with its covariance and the confidence band of its contour.

The fit is `roundel.solver.fit.guaranteed_fit`; this module is the method, and the band. The covariance of the shape is
that of the paper, sigma^2 pinv5(sum u u^T / (theta^T B theta)), sigma^2 = J / (N - 5), there for the conic's
coefficients. The paper's band is the set of points x that lie on an ellipse of the confidence region,
(theta . u(x))^2 <= q u(x)^T Lambda u(x) with u the carrier of x; to first order in the width that is, along the normal
nu of the contour point (x, y) + S u,

    w = sqrt(q nu^T G Lambda G^T nu),    G = d((x, y) + S u) / d(shape),    q = the quantile of chi-square,

with five degrees of freedom for the whole contour at once (Scheffe's bound: the true ellipse lies in the band with at
least this probability), with one for a single point.

Source: Z. L. Szpak, W. Chojnacki, A. van den Hengel, Guaranteed ellipse fitting with a confidence region and an
uncertainty measure for centre, axes, and orientation, J. Math. Imaging Vis. 52 (2015), sections 5 to 7.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from roundel.solver.fit.ellipse import EllipseFit, shape_of_ellipse
from roundel.solver.methods.plugin import Found, View
from roundel.solver.views.circles_of_view import circles_of_view, require_kind

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ConfidenceBand:
    """A band about an ellipse.

    Attributes
    ----------
    contour_px : (n, 2) array
        Points of the fitted ellipse.
    inner_px, outer_px : (n, 2) arrays
        The band's limits, along the normal.
    half_width_px : (n,) array
    """

    contour_px: Array
    inner_px: Array
    outer_px: Array
    half_width_px: Array


def confidence_band(fit: EllipseFit, level: float = 0.95, count: int = 128, pointwise: bool = False) -> ConfidenceBand:
    """The band that holds the true ellipse with a probability of `level` or more.

    Parameters
    ----------
    fit : EllipseFit
    level : float
        From 0 to 1.
    count : int
        Number of contour points.
    pointwise : bool
        Whether the level is that of each point of the contour instead of the whole of it: a narrower band.

    Raises
    ------
    ValueError
        If the level is not between 0 and 1, or the fit has no covariance.
    """
    if not 0 < level < 1:
        raise ValueError(f"a confidence level is between 0 and 1, not {level:g}")
    if not np.all(np.isfinite(fit.shape_cov)):
        raise ValueError("the fit has no covariance, so it has no confidence band")
    t = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    u = np.stack([np.cos(t), np.sin(t)], axis=1)
    x, y, s11, s12, s22 = shape_of_ellipse(fit.ellipse)
    spread = np.array([[s11, s12], [s12, s22]])
    contour = np.array([x, y]) + u @ spread.T
    normal = u @ np.linalg.inv(spread)  # gradient of |S^-1 (p - c)|^2 at the point, S symmetric
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    # nu . d((x, y) + S u) by x, y, S11, S12, S22.
    rate = np.column_stack(
        [
            normal,
            normal[:, 0] * u[:, 0],
            normal[:, 0] * u[:, 1] + normal[:, 1] * u[:, 0],
            normal[:, 1] * u[:, 1],
        ]
    )
    variance = np.einsum("ni,ij,nj->n", rate, fit.shape_cov, rate)
    width = np.sqrt(chi2.ppf(level, 1 if pointwise else 5) * variance)
    step = width[:, None] * normal
    return ConfidenceBand(contour, contour - step, contour + step, width)


def find(view: View) -> list[Found]:
    """Both poses of each circle, from the guaranteed ellipse of its edge points."""
    boards = "disc_with_chessboard", "disc_with_charuco"
    require_kind(view, "disc", "disc_with_tick", "ring", "rings", "coded_rings", "ring_code", *boards)
    return [
        Found(ellipse=circle.ellipse, confidence=circle.confidence)
        for circle in circles_of_view(view, method="guaranteed")
    ]
