"""Quantiles of a few hundred values: a sort of our own compiles in a tenth of the time of NumPy's."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from roundel.solver.kernels.compiled import compiled

Array = NDArray[np.float64]


@compiled
def sorted_copy(values: Array) -> Array:
    """The values in ascending order, by Shell's method (Communications of the ACM 2, 1959) with Knuth's gaps."""
    out = values.copy()
    n = len(out)
    gap = 1
    while gap < n // 3:
        gap = 3 * gap + 1
    while gap > 0:
        for i in range(gap, n):
            value = out[i]
            j = i
            while j >= gap and out[j - gap] > value:
                out[j] = out[j - gap]
                j -= gap
            out[j] = value
        gap //= 3
    return out


@compiled
def quantile(ordered: Array, share: float) -> float:
    """Quantile of sorted values, with linear interpolation."""
    if len(ordered) == 1:
        return float(ordered[0])
    at = share * (len(ordered) - 1)
    i = min(int(at), len(ordered) - 2)
    return float(ordered[i] + (ordered[i + 1] - ordered[i]) * (at - i))


@compiled
def median(values: Array) -> float:
    """Median of values in any order."""
    return quantile(sorted_copy(values), 0.5)
