"""Standard deviation of log f, the focal length, of a closed form of ellipses and of a least sum of squares."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.solver.fit.ellipse import ellipse_of_shape, shape_of_ellipse
from roundel.solver.pose.coplanar_circles import QUANTILE

Array = NDArray[np.float64]

_LARGEST = 1.0  # of log f: a factor of three is no measurement


@dataclass(frozen=True)
class MeasuredFocal:
    """A focal length in pixels and the standard deviation of its logarithm."""

    focal_px: float
    sigma: float


def log_focal_sigma(focal_of: Callable[[Array], float], ellipses: Array, shape_covs: Array) -> float:
    """Standard deviation of log f to second order, from the covariances of independent ellipses.

    Each ellipse is moved by plus and minus one standard deviation along the principal axes of its covariance. With
    a = (g+ - g-) / 2 and b = (g+ + g-) / 2 - g, a normal distribution along that axis gives g the variance
    a^2 + 2 b^2 and the bias b. The sum of the variances and the square of the summed biases are the mean square error.
    g is 1 / f: the perspective that measures f is proportional to it. The standard deviation s of f g becomes that of
    log f as in `coplanar_circles`, by the far end of the 95 % interval: -log(1 - 1.96 s) / 1.96.
    Where one standard deviation makes the closed form fail, or 1.96 of them reach 1 / f = 0, the focal length is not
    determined: infinite.

    Parameters
    ----------
    focal_of : callable
        Ellipses (n, 5) to a focal length; raises ValueError where there is none.
    ellipses : (n, 5) array
    shape_covs : (n, 5, 5) array
    """
    try:
        focal = focal_of(ellipses)
        variance, bias = 0.0, 0.0
        for i, cov in enumerate(shape_covs):
            values, vectors = np.linalg.eigh(cov)
            shape = shape_of_ellipse(ellipses[i])
            for step in (vectors * np.sqrt(np.maximum(values, 0.0))).T:
                ends = []
                for side in (1.0, -1.0):
                    moved = ellipses.copy()
                    moved[i] = ellipse_of_shape(shape + side * step)
                    ends.append(focal / focal_of(moved))
                curve = 0.5 * (ends[0] + ends[1]) - 1.0
                variance += (0.5 * (ends[0] - ends[1])) ** 2 + 2.0 * curve**2
                bias += curve
    except ValueError:
        return math.inf
    share = QUANTILE * math.sqrt(variance + bias**2)
    return -math.log1p(-share) / QUANTILE if share < 1.0 else math.inf


def profiled_focal(chi2: Callable[[float], float], start: float, step: float) -> MeasuredFocal | None:
    """The focal length of least chi2, with the standard deviation of log f that its 95 % interval has.

    Parameters
    ----------
    chi2 : callable
        log f to the least sum of squares of all other unknowns.
    start, step : float
        Where to begin in log f, and about how far to look: an estimate and its standard deviation.

    Returns
    -------
    MeasuredFocal or None
        None if chi2 has no minimum, or none that bounds log f to within one.
    """
    from scipy.optimize import minimize_scalar

    step = min(max(step, 1e-6), 0.5)
    low, high = start - 3.0 * step, start + 3.0 * step
    found = minimize_scalar(chi2, bounds=(low, high), method="bounded", options={"xatol": 1e-3 * step})
    while min(found.x - low, high - found.x) < 0.05 * (high - low):  # the minimum is at an end: look beyond
        low, high = found.x - (high - low), found.x + (high - low)
        if high - low > 4.0 * _LARGEST or not math.isfinite(float(found.fun)):
            return None
        found = minimize_scalar(chi2, bounds=(low, high), method="bounded", options={"xatol": 1e-3 * step})
    sigma = profile_sigma(chi2, float(found.x), float(found.fun), step)
    return None if sigma is None else MeasuredFocal(math.exp(float(found.x)), sigma)


def profile_sigma(chi2: Callable[[float], float], best: float, least: float, step: float) -> float | None:
    """Standard deviation of log f whose 95 % interval reaches as far as the farther end of that of chi2.

    Parameters
    ----------
    chi2 : callable
        log f to the least sum of squares of all other unknowns.
    best, least : float
        Where it is least, and how large it is there.
    step : float
        An estimate of the standard deviation.

    Returns
    -------
    float or None
        None if chi2 does not bound log f to within one.
    """
    from scipy.optimize import brentq

    widest, rise = 0.0, QUANTILE**2
    for side in (-1.0, 1.0):
        reach = QUANTILE * min(max(step, 1e-9), _LARGEST)
        while chi2(best + side * reach) - least < rise:
            if reach >= QUANTILE * _LARGEST:
                return None
            reach = min(2.0 * reach, QUANTILE * _LARGEST)
        widest = max(
            widest, brentq(lambda r, s=side: min(chi2(best + s * r) - least, 1e3) - rise, 0.0, reach, rtol=0.02)
        )
    return widest / QUANTILE
