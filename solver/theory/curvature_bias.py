"""Correction of the orthogonal-distance fit for its bias under isotropic noise.

Noise along a curved contour moves points outward: at curvature k, noise of sigma px along the tangent moves a point
k sigma^2 / 2 outside on average. The fitted ellipse is therefore too large and its circle too near (the negative bias
of depth in errata, section 6). Points measured along the contour's normal, as in an image, have no such noise and no
such bias: use this for points with equal noise in both coordinates.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.solver.fit.ellipse import EllipseFit, ellipse_of_shape, shape_of_ellipse
from roundel.solver.fit.ellipse_distance import foot_points

Array = NDArray[np.float64]


def without_curvature_bias(fit: EllipseFit, points_px: ArrayLike) -> EllipseFit:
    """The fit without its bias, to first order in the noise's variance; its covariance is unchanged.

    Parameters
    ----------
    fit : EllipseFit
        Orthogonal-distance fit of these points.
    points_px : (N, 2) array_like
        The points, with isotropic noise; `fit.sigma_px` is used as its standard deviation.

    Returns
    -------
    EllipseFit
        Unchanged if the correction would exceed half a semi-axis, that is, for noise as large as the ellipse.
    """
    points = np.asarray(points_px, dtype=np.float64)
    a, b, angle = fit.ellipse[2], fit.ellipse[3], np.radians(fit.ellipse[4])
    _, normal, u = foot_points(fit.ellipse, points)
    along = np.stack(
        [np.cos(angle) * u[:, 0] + np.sin(angle) * u[:, 1], np.cos(angle) * u[:, 1] - np.sin(angle) * u[:, 0]]
    )
    # The foot point is (a u1, b u2) in the ellipse's frame: curvature a b / (a^2 u2^2 + b^2 u1^2)^(3/2).
    curvature = a * b / ((a * along[1]) ** 2 + (b * along[0]) ** 2) ** 1.5
    across = normal[:, 0] * u[:, 1] + normal[:, 1] * u[:, 0]
    outward = np.column_stack([normal, normal[:, 0] * u[:, 0], across, normal[:, 1] * u[:, 1]])
    shift = np.linalg.lstsq(outward, curvature * fit.sigma_px**2 / 2, rcond=None)[0]
    if not np.max(np.abs(shift)) < b / 2:
        return fit
    return replace(fit, ellipse=ellipse_of_shape(shape_of_ellipse(fit.ellipse) - shift))
