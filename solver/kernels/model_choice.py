"""Which further parameters and level functions the pixels of a contour show, to first order."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from roundel.solver.kernels.compiled import compiled
from roundel.solver.kernels.small_matrices import inverse_of

Array = NDArray[np.float64]

_RIDGE = 1e-10  # at unit diagonal: functions that the pixels do not tell apart get small coefficients


@compiled
def _cost(size: int, count: int) -> float:
    """What the level functions of both sides have to explain.

    A gradient of light that is too weak for Schwarz's criterion still shifts the ellipse, and costs little: Akaike's
    is enough for it.
    """
    return 2.0 * 2.0 * min(size, 3) + 2.0 * math.log(count) * max(size - 3, 0)


@compiled
def _cost_of_extra(added: int, count: int) -> float:
    """What further parameters of the edge have to explain.

    A soft edge of the ink (one parameter) that is taken for blur shifts the radius by many of its standard deviations,
    so two of its own are enough; a smear (two) shifts nothing.
    """
    return 4.0 if added == 1 else 2.0 * added * math.log(count)


@compiled
def model_choice(
    normal: Array,
    gradient: Array,
    base: int,
    extras: NDArray[np.int64],
    sizes: NDArray[np.int64],
    count: int,
    scale: float,
) -> tuple[int, int]:
    """The best set of extra parameters and number of level functions.

    Parameters
    ----------
    normal, gradient : (n, n), (n,) arrays
        Normal equations of the largest model, n = base + extra + 2 K, at a state in which extra parameters and all
        level functions but the constants are zero.
    base : int
        Number of parameters that every model has.
    extras : (sets, extra) array of 0 and 1
        The extra parameters of each set.
    sizes : (n,) array
        Numbers of level functions to choose from, ascending, K the largest.
    count : int
        Number of pixels.
    scale : float
        Residuals are so many times the noise.

    Returns
    -------
    set, size : int
    """
    extra, most = extras.shape[1], sizes[-1]
    best, best_set, best_size = -math.inf, 0, sizes[0]
    use = np.empty(len(gradient), np.int64)
    for chosen in range(len(extras)):
        for size in sizes:
            n = base
            for i in range(base):
                use[i] = i
            for i in range(extra):
                if extras[chosen, i] == 1:
                    use[n] = base + i
                    n += 1
            added = n - base
            for side in range(2):
                for i in range(size):
                    use[n] = base + extra + side * most + i
                    n += 1
            part, inverse = np.empty((n, n)), np.empty((n, n))
            for i in range(n):
                for j in range(n):
                    part[i, j] = normal[use[i], use[j]]
                part[i, i] = max(part[i, i] * (1.0 + _RIDGE), 1e-12)
            if not inverse_of(part, inverse):
                continue
            explained = 0.0
            for i in range(n):
                for j in range(n):
                    explained += gradient[use[i]] * inverse[i, j] * gradient[use[j]]
            score = explained / (scale * scale) - _cost_of_extra(added, count) - _cost(size, count)
            if score > best:
                best, best_set, best_size = score, chosen, size
    return best_set, best_size
