"""Grey levels inside and outside a contour: constants, or smooth functions where the pixels need them.

Inside and outside each have a level that varies across the marker as a sum of smooth functions: 1; x and y (light
fall-off); their squares (a nearby lamp); harmonics of the direction from the centre (a soft shadow, a highlight). Each
order costs some precision of the ellipse, so it is used only if the pixels show it (Schwarz's criterion).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SIZES = (1, 3, 6, 14)  # functions per side of each order
_MEDIAN_SQUARE = 0.4549  # median of chi-square with one degree of freedom
_STAIN = 16.0  # squared sigmas beyond which a pixel of a plateau does not belong to it
_NEARLY_FLAT = 0.1  # fraction of the step


@dataclass(frozen=True, eq=False)
class Plateau:
    """Pixels on one side of the edge.

    Attributes
    ----------
    basis : (N, k) array
        The functions at each pixel.
    value : (N,) array
        Grey levels.
    """

    basis: Array
    value: Array

    def residual(self, coefficients: Array) -> Array:
        """Residual of the pixels for a level with these coefficients."""
        return np.asarray(self.value - self.basis @ coefficients)

    def without_stains(self, coefficients: Array, size: int) -> Plateau:
        """The pixels that match the level of the first `size` functions."""
        squares = (self.value - self.basis[:, :size] @ coefficients) ** 2
        keep = squares <= max(_STAIN / _MEDIAN_SQUARE * float(np.median(squares)), 1.0) if len(squares) else slice(None)
        return replace(self, basis=self.basis[keep, :size], value=self.value[keep])


def level_basis(pixel_px: Array, centre_px: Array, size_px: float, order: int) -> Array:
    """The functions (N, SIZES[order]) at pixels (N, 2), scaled by the marker's size."""
    x, y = (pixel_px - centre_px).T / size_px
    out = np.empty((len(x), SIZES[order]))
    out[:, 0] = 1.0
    if order >= 1:
        out[:, 1], out[:, 2] = x, y
    if order >= 2:
        out[:, 3], out[:, 4], out[:, 5] = x * x - y * y, 2 * x * y, x * x + y * y - 1
    if order >= 3:
        z = (x + 1j * y) / np.maximum(np.hypot(x, y), 0.25)
        power = z * z
        for i in range(4):
            power = power * z
            out[:, 6 + 2 * i], out[:, 7 + 2 * i] = power.real, power.imag
    return out


def best_order(count: int) -> int:
    """The highest order that this number of pixels can determine."""
    return 3 if count > 40 * SIZES[3] else 2 if count > 40 * SIZES[2] else 1


def first_levels(
    basis: Array, outer: Array, value: Array, nuisance: Array, plateaus: tuple[Plateau, Plateau]
) -> tuple[Array, Array]:
    """Choose the number of functions of the levels and fit them, at the starting ellipse.

    Parameters
    ----------
    basis, outer : (N, k) arrays
        The functions at the edge's pixels, and the part of each that belongs to the outside of the contour.
    value : (N,) array
        Grey levels of the edge's pixels.
    nuisance : (N, m) array
        Derivatives of the prediction by the other fitted parameters, whose share is not attributed to the levels.
    plateaus : (Plateau, Plateau)
        Inside and outside.

    Returns
    -------
    coefficients : (2, n) array
        Coefficients of the first n functions, inside and outside.
    residual : (N,) array
        Residual of the edge's pixels after levels and nuisances.
    """
    most, free = basis.shape[1], nuisance.shape[1]
    design = np.concatenate([nuisance, basis - outer, outer], axis=1)
    # Relative to their mean, the values keep their digits in the sum of squares.
    values = [value, plateaus[0].value, plateaus[1].value]
    count = sum(map(len, values))
    mean = float(sum(np.sum(v) for v in values)) / count
    gram, moment = design.T @ design, design.T @ (value - mean)
    total = float(np.sum((value - mean) ** 2))
    for i, plateau in enumerate(plateaus):
        part = slice(free + i * most, free + (i + 1) * most)
        gram[part, part] += plateau.basis.T @ plateau.basis
        moment[part] += plateau.basis.T @ (plateau.value - mean)
        total += float(np.sum((plateau.value - mean) ** 2))
    scale = 1.0 / np.sqrt(np.maximum(np.diag(gram), 1e-12))
    gram, moment = gram * scale[:, None] * scale, moment * scale
    variance, lowest = 0.0, math.inf
    for size in (s for s in reversed(SIZES) if s <= most):
        use = np.concatenate([np.arange(free), free + np.arange(size), free + most + np.arange(size)])
        solution = np.linalg.lstsq(gram[np.ix_(use, use)], moment[use], rcond=1e-10)[0]
        squares = max(total - float(moment[use] @ solution), 0.0)
        variance = variance or max(squares / max(count - len(use), 1.0), 1e-9)
        score = squares / variance + 2 * size * math.log(count)
        if score < lowest:
            lowest, best, chosen = score, use, solution * scale[use]
    coefficients = chosen[free:].reshape(2, -1).copy()
    coefficients[:, 0] += mean
    return coefficients, value - mean - design[:, best] @ chosen


def noise_variances(
    plateaus: tuple[Array, Array], residual: Array, response: Array, unknowns: int
) -> tuple[float, float]:
    """Variances of the pixels inside and outside, dn^2, from the model's residuals in the flat parts.

    Shot noise makes the brighter side noisier. If a side has too few pixels, both share one variance.

    Parameters
    ----------
    plateaus : (Array, Array)
        Residuals of the plateaus.
    residual, response : (N,) arrays
        Of the edge's pixels, of which the nearly flat ones are included.
    unknowns : int
        Number of fitted levels, both sides together.
    """
    ends = (response < _NEARLY_FLAT, response > 1.0 - _NEARLY_FLAT)
    groups = [np.concatenate([plateau, residual[end]]) for plateau, end in zip(plateaus, ends, strict=True)]
    if min(map(len, groups)) >= 12 + unknowns:
        sides = [float(np.sum(r**2)) / (len(r) - unknowns / 2) for r in groups]
    else:
        every = np.concatenate([*plateaus, residual])
        sides = [float(np.sum(every**2)) / max(len(every) - unknowns - 6, 1)] * 2
    # No sensor is free of noise. A plateau without noise (clipped or synthetic) gets a thousandth of the rounding's
    # variance 1/12, and at most 64 times the weight of the other side.
    inside, outside = (max(v, 1e-4) for v in sides)
    return max(inside, outside / 64), max(outside, inside / 64)
