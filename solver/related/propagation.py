"""Standard deviation of the logarithm of a focal length that is a closed form of ellipses."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from roundel.solver.fit.ellipse import ellipse_of_shape, shape_of_ellipse

Array = NDArray[np.float64]


def log_focal_sigma(focal_of: Callable[[Array], float], ellipses: Array, shape_covs: Array) -> float:
    """Standard deviation of log f to second order, from the covariances of independent ellipses.

    Each ellipse is moved by plus and minus one standard deviation along the principal axes of its covariance. With
    a = (g+ - g-) / 2 and b = (g+ + g-) / 2 - g, g = log f, a normal distribution along that axis gives log f the
    variance a^2 + 2 b^2 and the bias b. The sum of the variances and the square of the summed biases are the mean
    square error. Where one standard deviation makes the closed form fail, the focal length is not determined: infinite.

    Parameters
    ----------
    focal_of : callable
        Ellipses (n, 5) to a focal length; raises ValueError where there is none.
    ellipses : (n, 5) array
    shape_covs : (n, 5, 5) array
    """
    try:
        middle = math.log(focal_of(ellipses))
        variance, bias = 0.0, 0.0
        for i, cov in enumerate(shape_covs):
            values, vectors = np.linalg.eigh(cov)
            shape = shape_of_ellipse(ellipses[i])
            for step in (vectors * np.sqrt(np.maximum(values, 0.0))).T:
                ends = []
                for side in (1.0, -1.0):
                    moved = ellipses.copy()
                    moved[i] = ellipse_of_shape(shape + side * step)
                    ends.append(math.log(focal_of(moved)))
                variance += (0.5 * (ends[0] - ends[1])) ** 2 + 2.0 * (0.5 * (ends[0] + ends[1]) - middle) ** 2
                bias += 0.5 * (ends[0] + ends[1]) - middle
    except ValueError:
        return math.inf
    return math.sqrt(variance + bias**2)
