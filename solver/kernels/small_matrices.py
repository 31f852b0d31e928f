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
def weighted_products(design: Array, weight: Array, normal: Array) -> None:
    """Write the sums (n, n) of weighted products of the rows of a design (n, N).

    Four rows at a time: each weighted value is then loaded once for four products.
    """
    size, count = design.shape
    row = np.empty(count)
    for a in range(size):
        for i in range(count):
            row[i] = design[a, i] * weight[i]
        for b in range(0, a + 1, 4):
            if b + 3 <= a:
                s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
                for i in range(count):
                    s0 += row[i] * design[b, i]
                    s1 += row[i] * design[b + 1, i]
                    s2 += row[i] * design[b + 2, i]
                    s3 += row[i] * design[b + 3, i]
                normal[a, b], normal[a, b + 1], normal[a, b + 2], normal[a, b + 3] = s0, s1, s2, s3
            else:
                for j in range(b, a + 1):
                    total = 0.0
                    for i in range(count):
                        total += row[i] * design[j, i]
                    normal[a, j] = total
        for b in range(a + 1):
            normal[b, a] = normal[a, b]
