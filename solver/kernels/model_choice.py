"""Which further parameters and level functions the pixels of a contour show, to first order."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from roundel.solver.kernels.compiled import compiled

Array = NDArray[np.float64]

_RIDGE = 1e-10  # fraction of a diagonal: a function that the pixels do not tell from the others is left out


@compiled
def _cost(size: int, count: int) -> float:
    """What the level functions of both sides have to explain, by Schwarz's criterion."""
    return 2.0 * math.log(count) * size


@compiled
def _cost_of_extra(added: int) -> float:
    """What further parameters of the edge have to explain.

    A soft edge of the ink (one parameter) that is taken for blur shifts the radius by many of its standard deviations,
    so two of its own are enough. A smear (two) shifts the contour, too, because the darker side has less noise and more
    weight: it has to be as rare as three standard deviations, which also keeps soft ink from being taken for it.
    """
    return 4.0 if added == 1 else 5.0 * added


@compiled
def _factorise(normal: Array, use: NDArray[np.int64], factor: Array) -> None:
    """Write Cholesky's factor of a part of a matrix; a row that depends on the ones before it is zero."""
    for i in range(len(use)):
        for j in range(i + 1):
            total = normal[use[i], use[j]]
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            if j < i:
                factor[i, j] = total / factor[j, j] if factor[j, j] > 0.0 else 0.0
            else:
                least = _RIDGE * max(normal[use[i], use[i]], 1e-300)
                factor[i, i] = math.sqrt(total) if total > least else 0.0


@compiled
def _highest(scores: Array) -> tuple[int, int]:
    """Row and column of the highest score; the first one of equal ones."""
    row, column = 0, 0
    for i in range(scores.shape[0]):
        for j in range(scores.shape[1]):
            if scores[i, j] > scores[row, column]:
                row, column = i, j
    return row, column


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
    scores = np.empty((len(extras), len(sizes)))
    use, factor, solved = np.empty(len(gradient), np.int64), np.zeros_like(normal), np.empty(len(gradient))
    for chosen in range(len(extras)):
        n, added = base, 0
        for i in range(base):
            use[i] = i
        for i in range(extra):
            if extras[chosen, i] == 1:
                use[n] = base + i
                n, added = n + 1, added + 1
        # In this order the first rows of Cholesky's factor are those of the smaller models.
        fewer = 0
        for size in sizes:
            for side in range(2):
                for i in range(fewer, size):
                    use[n] = base + extra + side * most + i
                    n += 1
            fewer = size
        _factorise(normal, use[:n], factor)
        explained, done = 0.0, 0
        for which in range(len(sizes)):
            end = base + added + 2 * sizes[which]
            for i in range(done, end):
                total = gradient[use[i]]
                for j in range(i):
                    total -= factor[i, j] * solved[j]
                solved[i] = total / factor[i, i] if factor[i, i] > 0.0 else 0.0
                explained += solved[i] * solved[i]
            done = end
            costs = _cost_of_extra(added) + _cost(sizes[which], count)
            scores[chosen, which] = explained / (scale * scale) - costs
    best_set, best = _highest(scores)
    return best_set, sizes[best]
