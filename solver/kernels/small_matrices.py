"""Symmetric positive definite systems of a few unknowns, by Cholesky: too small for BLAS and its threads."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from roundel.solver.kernels.compiled import compiled, compiled_sums

Array = NDArray[np.float64]

_SINGULAR = 1e-13  # smallest squared pivot at unit diagonal: less is rounding


@compiled
def inverse_of(normal: Array, inverse: Array) -> bool:
    """Write the inverse of a normal matrix (n, n) to `inverse`; False if it is singular.

    The matrix is scaled to a unit diagonal first, so that units do not matter.
    """
    n = normal.shape[0]
    scale, factor = np.empty(n), np.zeros((n, n))
    for i in range(n):
        if not (normal[i, i] > 0.0 and normal[i, i] < math.inf):
            return False
        scale[i] = 1.0 / math.sqrt(normal[i, i])
    for i in range(n):
        for j in range(i + 1):
            total = normal[i, j] * scale[i] * scale[j]
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            if i == j:
                if not total > _SINGULAR:
                    return False
                factor[i, i] = math.sqrt(total)
            else:
                factor[i, j] = total / factor[j, j]
    # The inverse of the factor, in its place.
    for j in range(n):
        factor[j, j] = 1.0 / factor[j, j]
        for i in range(j + 1, n):
            total = 0.0
            for k in range(j, i):
                total -= factor[i, k] * factor[k, j]
            factor[i, j] = total / factor[i, i]
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for k in range(i, n):
                total += factor[k, i] * factor[k, j]
            inverse[i, j] = inverse[j, i] = total * scale[i] * scale[j]
    return True


@compiled_sums
def add_products(design: Array, weight: Array, count: int, normal: Array) -> None:
    """Add to the lower triangle of a matrix (n, n) the weighted products of the rows of a design (n, N).

    Of the first `count` columns, two by four rows at a time: each value is then loaded once for several products. What
    is written above the diagonal means nothing.
    """
    size = design.shape[0]
    one, two = np.empty(count), np.empty(count)
    for a in range(0, size, 2):
        last = min(a + 1, size - 1)  # of an odd number of rows the last one is paired with itself
        for i in range(count):
            one[i], two[i] = design[a, i] * weight[i], design[last, i] * weight[i]
        for b in range(0, last + 1, 4):
            if b + 3 < size:
                s0, s1, s2, s3, t0, t1, t2, t3 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
                for i in range(count):
                    p, q = one[i], two[i]
                    s0 += p * design[b, i]
                    s1 += p * design[b + 1, i]
                    s2 += p * design[b + 2, i]
                    s3 += p * design[b + 3, i]
                    t0 += q * design[b, i]
                    t1 += q * design[b + 1, i]
                    t2 += q * design[b + 2, i]
                    t3 += q * design[b + 3, i]
                normal[a, b] += s0
                normal[a, b + 1] += s1
                normal[a, b + 2] += s2
                normal[a, b + 3] += s3
                if last > a:
                    normal[last, b] += t0
                    normal[last, b + 1] += t1
                    normal[last, b + 2] += t2
                    normal[last, b + 3] += t3
            else:
                for j in range(b, last + 1):
                    s0, t0 = 0.0, 0.0
                    for i in range(count):
                        s0 += one[i] * design[j, i]
                        t0 += two[i] * design[j, i]
                    normal[a, j] += s0
                    if last > a:
                        normal[last, j] += t0
