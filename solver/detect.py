"""Where the circles of an image are: candidates, evidence along their contours, one detection for each marker.

EdgeDrawing's own ellipses are only places to look: it returns a circle for ellipses as eccentric as 14.4 x 11.4 px.
Every candidate is decided by the pixels along its contour.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.conic import ellipse_perimeter_px
from roundel.solver.candidates import edge_drawing, from_segments, grey_8bit, noise_dn, plausible, rms_distance
from roundel.solver.edges import EdgePoints, edge_points
from roundel.solver.ellipse import FailedFit

Array = NDArray[np.float64]

_MIN_COVERAGE = 0.5  # of the contour that must show an edge: a marker may be partly hidden
_MIN_CONTRAST_DN = 2.5  # smooth light has contours of one step where it is rounded
_MAX_REFINED = 32  # the candidates with the best evidence; refining one takes about 20 ms


@dataclass(frozen=True, eq=False)
class Detection:
    """One marker in the image.

    Attributes
    ----------
    edges : EdgePoints
        The outermost contour.
    inner : list of EdgePoints
        Contours concentric with it, from the outside inward: rings have them.
    edgedrawing : (5,) array or None
        EdgeDrawing's own ellipse of this contour, where it found one.
    """

    edges: EdgePoints
    inner: list[EdgePoints] = field(default_factory=list)
    edgedrawing: Array | None = None


def detect(image: NDArray[Any], full_scale_dn: float = 255.0) -> list[Detection]:
    """Find the circles of a grey image.

    Parameters
    ----------
    image : (H, W) array
    full_scale_dn : float
        The level at which its pixels saturate.

    Returns
    -------
    list of Detection
        The strongest evidence first (length of contour seen, times contrast).
    """
    grey, gain = grey_8bit(image)
    noise = noise_dn(image)
    segments, ellipses = edge_drawing(grey, noise * gain)
    ranked = []
    for candidate in [*ellipses, *from_segments(segments, grey.shape)]:
        if plausible(candidate, grey.shape):
            support, polarity = _evidence(image, candidate)
            if support >= _MIN_COVERAGE - 0.1:
                ranked.append((support, polarity, candidate))
    ranked.sort(key=lambda r: (-round(r[0], 2), -r[2][2], r[2][0], r[2][1]))

    refined = 0
    tried: list[tuple[float, Array]] = []
    found: list[EdgePoints] = []
    for _, polarity, candidate in ranked:
        if refined >= _MAX_REFINED:
            break
        if any(p == polarity and _alike(candidate, e, 1.0 + 0.05 * float(e[3])) for p, e in tried):
            continue
        tried.append((polarity, candidate))
        refined += 1
        edges = edge_points(image, candidate, full_scale_dn)
        if isinstance(edges, FailedFit) or not _is_circle_image(edges, noise, full_scale_dn):
            continue
        if not any(_alike(edges.ellipse, other.ellipse, 0.5) for other in found):
            found.append(edges)
            tried.append((float(np.sign(edges.contrast_dn)), edges.ellipse))
    return _group(found, ellipses)


def _evidence(image: NDArray[Any], ellipse: Array) -> tuple[float, float]:
    """Fraction of the contour with a step of the common polarity, and that polarity (+1: dark inside)."""
    count = int(np.clip(float(ellipse_perimeter_px(ellipse)), 24, 96))
    t = np.linspace(0, 2 * np.pi, count, endpoint=False)
    angle = math.radians(ellipse[4])
    turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    feet = np.stack([ellipse[2] * np.cos(t), ellipse[3] * np.sin(t)], axis=1) @ turn + ellipse[:2]
    normal = np.stack([np.cos(t) / ellipse[2], np.sin(t) / ellipse[3]], axis=1)
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True) @ turn
    inward = min(2.0, 0.6 * float(ellipse[3]))
    outer, seen = _pixels(image, feet + 2.0 * normal)
    inner, seen_too = _pixels(image, feet - inward * normal)
    seen &= seen_too
    if np.count_nonzero(seen) < 8:
        return 0.0, 0.0
    step = outer - inner
    middle = float(np.median(step[seen]))
    agrees = seen & (step * np.sign(middle) > 0.3 * abs(middle))
    if not np.any(agrees):
        return 0.0, 0.0
    # The gradient of a square turns by up to 45 degrees against the normal of its ellipse, a third of it by over 26.
    right, left, below, above = (
        _pixels(image, feet + inward * np.array(d))[0] for d in ((1, 0), (-1, 0), (0, 1), (0, -1))
    )
    gradient = np.stack([right - left, below - above], axis=1)
    along = np.sum(gradient * normal, axis=1) * np.sign(middle)
    aligned = agrees & (along > 0.9 * np.linalg.norm(gradient, axis=1))
    if np.count_nonzero(aligned) < 0.7 * np.count_nonzero(agrees):
        return 0.0, 0.0
    return float(np.mean(agrees)), float(np.sign(middle))


def _pixels(image: NDArray[Any], points: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Bilinear grey levels, and which points lie in the image."""
    height, width = image.shape
    x, y = points.T
    seen = (x >= 0) & (y >= 0) & (x <= width - 1) & (y <= height - 1)
    x, y = np.clip(x, 0, width - 1), np.clip(y, 0, height - 1)
    x0, y0 = np.minimum(x.astype(np.int64), max(width - 2, 0)), np.minimum(y.astype(np.int64), max(height - 2, 0))
    x1, y1 = np.minimum(x0 + 1, width - 1), np.minimum(y0 + 1, height - 1)
    fx, fy = x - x0, y - y0
    top = image[y0, x0] * (1 - fx) + image[y0, x1] * fx
    return top * (1 - fy) + (image[y1, x0] * (1 - fx) + image[y1, x1] * fx) * fy, seen


def _is_circle_image(edges: EdgePoints, noise: float, full_scale_dn: float) -> bool:
    contrast, b = abs(edges.contrast_dn), float(edges.ellipse[3])
    if not plausible(edges.ellipse, (10**9, 10**9)) or edges.coverage < _MIN_COVERAGE:
        return False
    if contrast < max(_MIN_CONTRAST_DN * min(full_scale_dn / 255.0, 1.0), noise):
        return False
    if contrast < 8.0 * noise and edges.coverage < 0.75:  # in strong noise half a contour is found by chance
        return False
    # What the model of an ellipse leaves of the pixels beyond their noise; pixels without shades leave more.
    aliased = edges.blur_px < 0.1 and b >= 4.0 and edges.noise_dn < 0.15 * contrast
    if not aliased and edges.noise_dn**2 > (1.5 * noise + 1e-3 * full_scale_dn) ** 2 + (0.08 * contrast) ** 2:
        return False
    # A square is 5 % of its half side off its best ellipse, a letter O 1 to 1.5 %; lens distortion bends an ellipse by
    # its quadratic term, 1e-4 b^2 px at the corner of a wide-angle image.
    # Where the blur reaches across the ellipse the model itself is off by about b^2 over its size.
    allowed = 0.02 + 0.004 * b + 1.2e-4 * b * b + 0.08 * edges.blur_px**2 / b
    if aliased and edges.noise_dn > 0.06 * contrast:
        allowed = max(allowed, 0.26)  # the rounding of an edge to whole pixels
    expected = float(np.sqrt(np.mean(edges.sigma_px**2))) * min(1.0, 1.5 * noise / max(edges.noise_dn, 1e-9))
    return rms_distance(edges.ellipse, edges.points_px) <= math.hypot(allowed, 1.5 * expected)


def _alike(one: Array, other: Array, tolerance_px: float) -> bool:
    """Whether two ellipses are the same contour: their extreme points lie within the tolerance, wherever they are."""
    if max(abs(one[0] - other[0]), abs(one[1] - other[1])) > tolerance_px:
        return False
    spread_one, spread_other = _second_moments(one), _second_moments(other)
    # Half widths in x, y and the diagonals: enough to tell two ellipses of one centre apart.
    return bool(np.max(np.abs(spread_one - spread_other)) <= tolerance_px)


def _second_moments(ellipse: Array) -> Array:
    directions = np.radians(np.array([0.0, 45.0, 90.0, 135.0]) - ellipse[4])
    return np.asarray(np.hypot(ellipse[2] * np.cos(directions), ellipse[3] * np.sin(directions)))


def _group(found: list[EdgePoints], ellipses: list[Array]) -> list[Detection]:
    """Concentric contours become one detection: the outermost is the marker's."""
    remaining = sorted(found, key=lambda e: -float(e.ellipse[2]))
    out = []
    while remaining:
        outer = remaining.pop(0)
        inner = [e for e in remaining if _concentric(outer.ellipse, e.ellipse)]
        remaining = [e for e in remaining if not _concentric(outer.ellipse, e.ellipse)]
        close = [e for e in ellipses if _alike(e, outer.ellipse, 1.0 + 0.1 * float(outer.ellipse[3]))]
        own = min(
            close, key=lambda e: float(np.abs(_second_moments(e) - _second_moments(outer.ellipse)).sum()), default=None
        )
        out.append(Detection(outer, inner, own))
    strength = [
        d.edges.coverage * float(d.edges.ellipse[2] + d.edges.ellipse[3]) * abs(d.edges.contrast_dn) for d in out
    ]
    order = sorted(range(len(out)), key=lambda i: (-strength[i], out[i].edges.ellipse[0]))
    return [out[i] for i in order]


def _concentric(outer: Array, inner: Array) -> bool:
    """Whether the inner ellipse is a circle about the same centre: perspective moves it by less than 0.15 b."""
    near = float(np.hypot(*(outer[:2] - inner[:2]))) <= 0.5 + 0.15 * float(outer[3])
    return near and inner[2] < outer[2] and abs(inner[3] / inner[2] - outer[3] / outer[2]) < 0.15
