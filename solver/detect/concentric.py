"""Which contours are concentric circles in one plane: the edges of rings, whose outermost is the marker's."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from roundel.solver.detect.distinct import half_width
from roundel.solver.kernels.compiled import compiled

Array = NDArray[np.float64]

_TOLERANCE, _TOLERANCE_PX = 0.04, 0.5


@compiled
def outer_contours(ellipses: Array, blur_px: Array) -> NDArray[np.int64]:
    """For each ellipse the index of the outermost one that is concentric with it: its own, if there is none.

    Parameters
    ----------
    ellipses : (n, 5) array
        The largest major axis first.
    blur_px : (n,) array
        Gaussian sigma of each contour's blur.

    Returns
    -------
    (n,) array of int64
    """
    n = len(ellipses)
    outer = np.empty(n, np.int64)
    for i in range(n):
        outer[i] = -1
    for i in range(n):
        if outer[i] >= 0:
            continue
        outer[i] = i
        for j in range(i + 1, n):
            if outer[j] < 0 and concentric(ellipses[i], ellipses[j], blur_px[j]):
                outer[j] = i
    return outer


@compiled
def concentric(outer: Array, inner: Array, blur_px: float) -> bool:
    """Whether two ellipses (5,) may be concentric circles in one plane.

    For such circles of radii r and s, C_outer^-1 C_inner has the eigenvalues (1, 1, s^2 / r^2) up to a common factor,
    in the plane and under any projection. Two equal eigenvalues, other than those of the hole, make them concentric.
    """
    dx, dy = inner[0] - outer[0], inner[1] - outer[1]
    if max(abs(dx), abs(dy)) > outer[2] or inner[2] >= outer[2]:
        return False
    if abs(dx) > half_width(outer, 0.0) - half_width(inner, 0.0):
        return False
    if abs(dy) > half_width(outer, 90.0) - half_width(inner, 90.0):
        return False
    # In the frame in which the outer ellipse is the unit circle, its inverse conic is diag(1, 1, -1).
    c, s = math.cos(math.radians(outer[4])), math.sin(math.radians(outer[4]))
    x, y = (c * dx + s * dy) / outer[2], (c * dy - s * dx) / outer[3]
    turn = math.radians(inner[4] - outer[4])
    c, s = math.cos(turn), math.sin(turn)
    p, q = c * outer[2] / inner[2], s * outer[3] / inner[2]
    u, v = -s * outer[2] / inner[3], c * outer[3] / inner[3]
    a, b, d = p * p + u * u, p * q + u * v, q * q + v * v
    e, f = -(a * x + b * y), -(b * x + d * y)
    g = -(e * x + f * y) - 1.0
    # Characteristic polynomial of [[a, b, e], [b, d, f], [-e, -f, -g]]: x^3 - 3 mean x^2 + ...
    mean = (a + d - g) / 3.0
    a, d, g = a - mean, d - mean, -g - mean
    p3 = -(a * d + a * g + d * g - b * b + e * e + f * f) / 3.0
    half = (a * d * g - 2.0 * b * e * f + a * f * f + d * e * e - g * b * b) / 2.0
    if not p3 > 0.0:
        return False
    cosine = half / (p3 * math.sqrt(p3))
    if abs(cosine) > 1.0:
        # A complex pair: a double eigenvalue that errors have moved off the real axis. It is the larger one.
        return bool(cosine < 0.0)
    third = math.acos(cosine) / 3.0
    first = abs(mean + 2.0 * math.sqrt(p3) * math.cos(third))
    second = abs(mean + 2.0 * math.sqrt(p3) * math.cos(third - 2.0 * math.pi / 3.0))
    last = abs(mean + 2.0 * math.sqrt(p3) * math.cos(third + 2.0 * math.pi / 3.0))
    if second < last:
        second, last = last, second
    if first < second:
        first, second = second, first
    # An offset of a tenth of the outer radius separates them by 1 to 2 %; an error of 0.3 px by about 0.6 px over b.
    # A curved edge is displaced by its blur's square over twice its radius, up to the error of that model.
    error_px = _TOLERANCE_PX + blur_px**2 / inner[3]
    return bool(first / max(second, 1e-300) - 1.0 <= _TOLERANCE + error_px / inner[3])
