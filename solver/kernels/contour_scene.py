"""Sums over the plateaus of a contour, their medians, and the distances of its pixels to another ellipse."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from roundel.solver.kernels.compiled import compiled
from roundel.solver.kernels.contour_pixels import (
    DISTANCE,
    NORMAL_X,
    NORMAL_Y,
    U_X,
    U_Y,
    VALUE,
    X,
    Y,
    foot_point,
    write_pixel,
)
from roundel.solver.kernels.order_statistics import median, quantile
from roundel.solver.kernels.pixel_equations import CLIPPED, RESIDUAL, SHARE, SLOPE, WEIGHT
from roundel.solver.kernels.small_matrices import add_products
from roundel.solver.kernels.trace_contour import shape_row

Array = NDArray[np.float64]

_MEDIAN_SQUARE = 0.4549  # median of chi-square with one degree of freedom
_BLOCK = 64  # pixels
_STEEP, _LITTLE = 0.2, 1e-3  # fractions of the steepest pixel's slope, and of the best sector's information
_STAIN = 16.0  # squared sigmas beyond which a pixel of a plateau does not belong to it


@compiled
def plateau_sums(
    basis: Array, value: Array, coefficients: Array, clip_dn: float, gram: Array, moment: Array
) -> tuple[float, int]:
    """Write the sums of products of a plateau's pixels, without stains (far from the level) and clipped ones.

    Parameters
    ----------
    basis, value : (N, K), (N,) arrays
    coefficients : (k,) array
        The level; k may be smaller than K.
    clip_dn : float
    gram, moment : (k, k), (k,) arrays
        Written: sums of the products of functions, and of functions and values.

    Returns
    -------
    square : float
        Sum of squared values.
    count : int
    """
    n, k = len(value), len(coefficients)
    squares = np.empty(n)
    for i in range(n):
        level = 0.0
        for j in range(k):
            level += basis[i, j] * coefficients[j]
        squares[i] = (value[i] - level) ** 2
    limit = math.inf if n == 0 else max(_STAIN / _MEDIAN_SQUARE * median(squares.copy()), 1.0)
    # Blocks of pixels, and their values in the last row, stay in the fastest cache.
    design, weights, sums = np.empty((k + 1, _BLOCK)), np.ones(_BLOCK), np.zeros((k + 1, k + 1))
    filled, count = 0, 0
    for i in range(n):
        if squares[i] <= limit and value[i] < clip_dn:
            for j in range(k):
                design[j, filled] = basis[i, j]
            design[k, filled] = value[i]
            filled, count = filled + 1, count + 1
        if filled == _BLOCK or i == n - 1:
            add_products(design, weights, filled, sums)
            filled = 0
    for a in range(k):
        moment[a] = sums[k, a]
        for b in range(a + 1):
            gram[a, b] = gram[b, a] = sums[a, b]
    return sums[k, k], count


@compiled
def place_at(table: Array, ellipse: Array, jacobian: Array) -> None:
    """Write distances, normals and curvatures of the pixels of a table for another ellipse, and the jacobian (N, 5)."""
    a, b, angle = ellipse[2], ellipse[3], math.radians(ellipse[4])
    c, s = math.cos(angle), math.sin(angle)
    for i in range(len(table)):
        pixel = table[i]
        dx, dy = pixel[X] - ellipse[0], pixel[Y] - ellipse[1]
        distance, nx, ny, ux, uy = foot_point(a, b, c * dx + s * dy, c * dy - s * dx)
        write_pixel(pixel, pixel[X], pixel[Y], pixel[VALUE], distance, nx, ny, ux, uy, c, s, a, b)
        shape_row(pixel[NORMAL_X], pixel[NORMAL_Y], pixel[U_X], pixel[U_Y], jacobian[i])


@compiled
def side_medians(table: Array, inside: Array, outside: Array) -> tuple[float, float]:
    """Medians of the levels on both sides: of the plateaus, and of the fifth of the edge's pixels that is nearest."""
    n = len(table)
    distances, values = np.empty(n), np.empty(n)
    for i in range(n):
        distances[i] = table[i, DISTANCE]
    near, far = quantile(distances, 0.2), quantile(distances, 0.8)
    medians = np.empty(2)
    for side in range(2):
        plateau = inside if side == 0 else outside
        count = 0
        for i in range(n):
            if (side == 0 and table[i, DISTANCE] <= near) or (side == 1 and table[i, DISTANCE] >= far):
                values[count] = table[i, VALUE]
                count += 1
        every = np.empty(count + len(plateau))
        for i in range(count):
            every[i] = values[i]
        for i in range(len(plateau)):
            every[count + i] = plateau[i]
        medians[side] = median(every)
    return medians[0], medians[1]


@compiled
def sector_sums(
    record: Array, jacobian: Array, starts: NDArray[np.int64], noise: Array, light: Array
) -> tuple[Array, Array, Array, Array, NDArray[np.bool_], Array]:
    """What a fit knows of each sector of the contour: the fields of `roundel.solver.fit.pixel_covariance.Sectors`.

    Parameters
    ----------
    record, jacobian, light : (N, 5), (N, 5), (N or 0, 5) arrays
        See `pixel_equations`.
    starts : (S + 1,) array
        The sectors' first pixels.
    noise : (2,) array
        Variance of a pixel inside and outside.
    """
    count = len(starts) - 1
    offset, sigma, shape = np.zeros(count), np.empty(count), np.zeros((count, 5))
    square, pixels, known = np.zeros(count), np.zeros(count), np.zeros(count)
    used = np.empty(count, np.bool_)
    steepest, most = 0.0, 0.0
    for i in range(len(record)):
        steepest = max(steepest, abs(record[i, SLOPE]))
    for s in range(count):
        for i in range(starts[s], starts[s + 1]):
            if record[i, CLIPPED] == 1.0:
                continue
            variance = noise[0] + (noise[1] - noise[0]) * record[i, SHARE]
            if abs(record[i, SLOPE]) > _STEEP * steepest:
                square[s] += record[i, RESIDUAL] ** 2 / variance
                pixels[s] += 1.0
            part = light[i, 4] if len(light) > 0 else 1.0
            information = record[i, SLOPE] ** 2 / variance * part
            known[s] += information
            # If the contour is inside the ellipse, the prediction is too low: the residual has the opposite sign.
            offset[s] -= record[i, WEIGHT] * record[i, SLOPE] * record[i, RESIDUAL]
            for j in range(5):
                shape[s, j] += information * jacobian[i, j]
        most = max(most, known[s])
    for s in range(count):
        used[s] = known[s] > _LITTLE * most
        whole = known[s] if used[s] else 1.0
        offset[s] = offset[s] / whole if used[s] else 0.0
        sigma[s] = 1.0 / math.sqrt(whole) if used[s] else math.inf
        for j in range(5):
            shape[s, j] /= whole
    return offset, sigma, square, pixels, used, shape


@compiled
def plateau_squares(gram: Array, moment: Array, square: float, coefficients: Array) -> float:
    """Sum of squared residuals of a plateau's pixels, from its sums over them."""
    k = len(coefficients)
    total = square
    for i in range(k):
        total -= 2.0 * coefficients[i] * moment[i]
        for j in range(k):
            total += coefficients[i] * gram[i, j] * coefficients[j]
    return max(total, 0.0)
