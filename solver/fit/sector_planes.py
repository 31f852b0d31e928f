"""Planes of the grey levels in the sectors of a contour, by least squares over the neighbouring sectors.

Coefficients of a sector's planes: level, change along the normal, change along the contour; inside, then outside. The
offset of the edge in each sector is eliminated, so that the planes do not follow the edge.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from roundel.solver.kernels.compiled import compiled
from roundel.solver.kernels.contour_pixels import DISTANCE
from roundel.solver.kernels.pixel_equations import CLIPPED, RESIDUAL, SHARE, SLOPE
from roundel.solver.kernels.sector_offsets import SECTOR_PX
from roundel.solver.kernels.small_matrices import inverse_of

Array = NDArray[np.float64]

PLANES = 6
_LEVEL, _CHANGE = 0.5, 0.05  # standard deviations of the coefficients, in contrasts and contrasts per px
# Columns of a sector's sums beside those of its planes: chi-square without its offset, pixels, information on the
# offset, pull on it.
SQUARE, NUMBER, KNOWN, PULL = range(4)


@compiled
def _add(
    s: int, d: float, residual: float, slope: float, share: float, weight: float, planes: Array, cut: float,
    gram: Array, moment: Array, lean: Array, sums: Array, phi: Array, flat_gram: Array, flat_moment: Array,
) -> None:  # fmt: skip
    phi[0], phi[1], phi[3], phi[4] = 1.0 - share, (1.0 - share) * d, share, share * d
    left = residual - phi[0] * planes[s, 0] - phi[1] * planes[s, 1] - phi[3] * planes[s, 3] - phi[4] * planes[s, 4]
    if left * left * weight > cut:
        return
    sums[s, SQUARE] += weight * residual * residual
    sums[s, NUMBER] += 1.0
    sums[s, KNOWN] += weight * slope * slope
    sums[s, PULL] += weight * slope * residual
    for a in range(PLANES):
        part = weight * phi[a]
        lean[s, a] += part * slope
        moment[s, a] += part * residual
        for b in range(a + 1):
            gram[s, a, b] += part * phi[b]
    if slope == 0.0:
        for a in range(PLANES):
            flat_moment[s, a] += weight * phi[a] * residual
            for b in range(PLANES):
                flat_gram[s, a, b] += weight * phi[a] * phi[b]


@compiled
def gather_sectors(
    sector: NDArray[np.int64], table: Array, record: Array, noise: Array, levels: Array,
    inner_sector: NDArray[np.int64], inner: Array, inner_basis: Array, inner_value: Array,
    outer_sector: NDArray[np.int64], outer: Array, outer_basis: Array, outer_value: Array,
    planes: Array, cut: float, gram: Array, moment: Array, lean: Array, sums: Array, flat_gram: Array,
    flat_moment: Array, near_px: float,
) -> None:  # fmt: skip
    """Write each sector's normal equations of its planes without its offset, its lean on the offset, and sums."""
    for s in range(len(sums)):
        for j in range(sums.shape[1]):
            sums[s, j] = 0.0
        for a in range(PLANES):
            moment[s, a], lean[s, a], flat_moment[s, a] = 0.0, 0.0, 0.0
            for b in range(PLANES):
                gram[s, a, b], flat_gram[s, a, b] = 0.0, 0.0
    phi = np.zeros(PLANES)
    for i in range(len(table)):
        if record[i, CLIPPED] == 0.0:
            share = record[i, SHARE]
            weight = 1.0 / (noise[0] + (noise[1] - noise[0]) * share)
            _add(
                sector[i], table[i, DISTANCE], record[i, RESIDUAL], record[i, SLOPE], share, weight, planes, cut,
                gram, moment, lean, sums, phi, flat_gram, flat_moment,
            )  # fmt: skip
    k = levels.shape[1]
    for side in range(2):
        at, far = (inner_sector, inner) if side == 0 else (outer_sector, outer)
        basis, value = (inner_basis, inner_value) if side == 0 else (outer_basis, outer_value)
        for i in range(len(value)):
            if abs(far[i]) > near_px:
                continue
            residual = value[i]
            for j in range(k):
                residual -= basis[i, j] * levels[side, j]
            _add(
                at[i], far[i], residual, 0.0, float(side), 1.0 / noise[side], planes, cut,
                gram, moment, lean, sums, phi, flat_gram, flat_moment,
            )  # fmt: skip
    for s in range(len(sums)):
        known = sums[s, KNOWN]
        for a in range(PLANES):
            if known > 0.0:
                lean[s, a] /= known
                moment[s, a] -= lean[s, a] * sums[s, PULL]
            for b in range(a + 1):
                if known > 0.0:
                    gram[s, a, b] -= lean[s, a] * lean[s, b] * known
                gram[s, b, a] = gram[s, a, b]
        if known > 0.0:
            sums[s, SQUARE] -= sums[s, PULL] ** 2 / known


@compiled
def chi_square_left(s: int, plane: Array, gram: Array, moment: Array, sums: Array) -> float:
    """Chi-square of a sector's pixels with its planes and its own offset."""
    total = sums[s, SQUARE]
    for a in range(PLANES):
        if a % 3 < 2:
            total -= 2.0 * plane[a] * moment[s, a]
            for b in range(PLANES):
                if b % 3 < 2:
                    total += plane[a] * gram[s, a, b] * plane[b]
    return float(max(total, 0.0))


@compiled
def plane_of(
    s: int, window: int, usable: NDArray[np.bool_], contrast_dn: float, gram: Array, moment: Array, normal: Array,
    gradient: Array, inverse: Array, plane: Array,
) -> tuple[float, int]:  # fmt: skip
    """Write the planes of a sector; returns by how much they reduce chi-square, and the number of sectors used."""
    count, used, gain = len(usable), 0, 0.0
    for a in range(PLANES):
        gradient[a], plane[a] = 0.0, 0.0
        for b in range(PLANES):
            normal[a, b] = 0.0
        normal[a, a] = ((_LEVEL if a % 3 == 0 else _CHANGE) * contrast_dn) ** -2.0
    for k in range(-window, window + 1):
        j, u = (s + k) % count, k * SECTOR_PX
        if not usable[j]:
            continue
        used += 1
        for a in range(PLANES):
            # The change along the contour is that of the level, times the place.
            times, at = (u, a - 2) if a % 3 == 2 else (1.0, a)
            gradient[a] += times * moment[j, at]
            for b in range(PLANES):
                also, by = (u, b - 2) if b % 3 == 2 else (1.0, b)
                normal[a, b] += times * also * gram[j, at, by]
    if inverse_of(normal, inverse):
        for a in range(PLANES):
            for b in range(PLANES):
                plane[a] += inverse[a, b] * gradient[b]
            gain += plane[a] * gradient[a]
    return gain, used


@compiled
def ground_changes(sector: NDArray[np.int64], basis: Array, slope: Array, levels: Array, count: int) -> Array:
    """Changes (count, 4) of the level functions in each sector: along normal and contour, inside, then outside."""
    sums, numbers, out = np.zeros((count, 4)), np.zeros(count), np.zeros((count, 4))
    for i in range(len(sector)):
        numbers[sector[i]] += 1.0
        for j in range(levels.shape[1]):
            for side in range(2):
                sums[sector[i], 2 * side] += slope[i, j] * levels[side, j]
                sums[sector[i], 2 * side + 1] += basis[i, j] * levels[side, j]
    for s in range(count):
        before, after = (s - 1) % count, (s + 1) % count
        for side in range(2):
            out[s, 2 * side] = sums[s, 2 * side] / max(numbers[s], 1.0)
            if numbers[before] > 0.0 and numbers[after] > 0.0:
                change = sums[after, 2 * side + 1] / numbers[after] - sums[before, 2 * side + 1] / numbers[before]
                out[s, 2 * side + 1] = change / (2.0 * SECTOR_PX)
    return out


@compiled
def steepness_of(plane: Array, ground: Array, inverse: Array, scale: float) -> float:
    """Largest change of a level, per px, less two of its standard deviations."""
    most = 0.0
    for side in range(2):
        a, b = 3 * side + 1, 3 * side + 2
        change = math.hypot(plane[a] + ground[2 * side], plane[b] + ground[2 * side + 1])
        most = max(most, change - 2.0 * math.sqrt(scale * (inverse[a, a] + inverse[b, b])))
    return most
