"""Detect the circles of an image: candidates, evidence along their contours, one detection for each marker.

EdgeDrawing's own ellipses are only candidates: it returns a circle for ellipses as eccentric as 14.4 x 11.4 px. Every
candidate is decided by the pixels along its contour.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.solver.detect.blob import SMALL_PX, blob_ellipse
from roundel.solver.detect.candidates import edge_drawing, from_segments, grey_8bit, noise_dn, plausible
from roundel.solver.detect.confidence import confidence_of, is_circle_image
from roundel.solver.detect.evidence import contour_evidence
from roundel.solver.detect.pyramid import enlarged, enlarged_ellipse, reduced
from roundel.solver.fit.edges import EdgePoints, edge_points
from roundel.solver.fit.ellipse import FailedFit

Array = NDArray[np.float64]

_MIN_SUPPORT = 0.3  # fraction of the contour that must show a step: a marker may be partly hidden
_CONFIDENT = 0.5
_MAX_PX = 16_000_000  # larger images are searched at reduced size, and measured at full size
_COARSE, _BETWEEN = 4, 2  # reduction factors for blurred and noisy contours, if nothing else is found
_CLEAR = 8.0  # a contrast of this many sigmas is detected without averaging
_ROUGH_PX = 0.05  # error of points that are not polished
_CONCENTRIC, _CONCENTRIC_PX = 0.04, 0.5
_MIN_SIDE_PX = 24  # smallest side of a reduced image
_PATIENCE = 48  # consecutive failed refinements before the search ends; later candidates have even less evidence


@dataclass(frozen=True, eq=False)
class Detection:
    """One marker in the image.

    Attributes
    ----------
    edges : EdgePoints
        The outermost contour.
    inner : list of EdgePoints
        Contours concentric with it, from the outside inward, as in rings.
    edgedrawing : (5,) array or None
        EdgeDrawing's own ellipse of this contour, if it found one.
    confidence : float
        Confidence that this is the image of a circle, 0 to 1: see `solver.detect.confidence`.
    """

    edges: EdgePoints
    inner: list[EdgePoints] = field(default_factory=list)
    edgedrawing: Array | None = None
    confidence: float = 1.0


@dataclass(frozen=True, eq=False)
class _Contour:
    edges: EdgePoints
    confidence: float


@dataclass(frozen=True, eq=False)
class _Level:
    """The image reduced by a factor, and its noise."""

    image: NDArray[Any]
    factor: int
    noise: float


def detect(image: NDArray[Any], full_scale_dn: float = 255.0, polish: bool = False) -> list[Detection]:
    """Find the circles of a grey image.

    Parameters
    ----------
    image : (H, W) array
    full_scale_dn : float
        The level at which its pixels saturate.
    polish : bool
        Iterate the edge points to convergence, see `edge_points`. Otherwise they are only accurate enough to accept or
        reject a contour: `fit_pixels` starts from them, other fits need converged points.

    Returns
    -------
    list of Detection
        The strongest evidence first (visible contour length times contrast).
    """
    image = np.ascontiguousarray(image)
    first = max(1, math.ceil(math.sqrt(image.size / _MAX_PX)))
    found: list[_Contour] = []
    ellipses: list[Array] = []
    for factor in (first, _COARSE * first, _BETWEEN * first):
        if any(c.confidence >= _CONFIDENT for c in found):
            break
        if factor > 1 and min(image.shape) < _MIN_SIDE_PX * factor:
            continue
        level = image if factor == 1 else reduced(image, factor)
        grey, gain = grey_8bit(level)
        noise = noise_dn(level)
        segments, own = edge_drawing(grey, noise * gain, with_ellipses=factor == first)
        ellipses += [enlarged_ellipse(e, factor) for e in own]
        # EdgeDrawing's ellipses come last, and only if nothing similar was found, because the others are more accurate.
        for candidates, near in ((from_segments(segments, grey.shape), 0.05), (own, 0.2)):
            likely = [c for c in candidates if plausible(c, grey.shape)]
            _refine(_Level(level, factor, noise), image, likely, near, full_scale_dn, polish, found)
    return _group(found, ellipses)


def _refine(
    level: _Level,
    image: NDArray[Any],
    candidates: list[Array],
    near: float,
    full_scale_dn: float,
    polish: bool,
    found: list[_Contour],
) -> None:
    """Add the candidates that are circles to `found`, each once; within `near` of b it is the same contour."""
    support, polarity = contour_evidence(level.image, np.array(candidates).reshape(-1, 5))
    # Sorted by the contour length that shows a step, ties from left to right, so that the order is deterministic.
    length = [float(support[i] * (c[2] + c[3])) for i, c in enumerate(candidates)]
    order = sorted(range(len(candidates)), key=lambda i: (-length[i], candidates[i][0], candidates[i][1]))
    tried = [(float(np.sign(c.edges.contrast_dn)), c.edges.ellipse) for c in found]
    failures = 0
    for i in order:
        candidate = enlarged_ellipse(candidates[i], level.factor)
        if failures >= _PATIENCE:
            break
        if support[i] < _MIN_SUPPORT or any(
            p == polarity[i] and _alike(candidate, e, level.factor + near * float(e[3])) for p, e in tried
        ):
            continue
        tried.append((float(polarity[i]), candidate))
        contour = _measured(level, image, candidates[i], full_scale_dn, polish)
        failures = 0 if contour else failures + 1
        if contour and not any(_alike(contour.edges.ellipse, c.edges.ellipse, 0.5 * level.factor) for c in found):
            found.append(contour)
            tried.append((float(np.sign(contour.edges.contrast_dn)), contour.edges.ellipse))


def _measured(
    level: _Level, image: NDArray[Any], candidate: Array, full_scale_dn: float, polish: bool
) -> _Contour | None:
    """The contour at a candidate of a level: from the full image, or from the level if the full image shows none."""
    there = _judged(level.image, candidate, level.noise, full_scale_dn, polish)
    if there is None or level.factor == 1:
        return there
    there = _Contour(enlarged(there.edges, level.factor), there.confidence)
    noise = noise_dn(image)
    here = _judged(image, there.edges.ellipse, noise, full_scale_dn, polish)
    if there.edges.blur_px < level.factor and abs(there.edges.contrast_dn) > _CLEAR * noise:
        return here  # neither blurred nor noisy: the reduced image was only too coarse to reject it
    return here if here and here.confidence >= min(there.confidence, _CONFIDENT) else there


def _judged(image: NDArray[Any], candidate: Array, noise: float, full_scale_dn: float, polish: bool) -> _Contour | None:
    # Most candidates are not circles, and a quick test rejects them.
    edges = edge_points(image, candidate, full_scale_dn, polish=False)
    if isinstance(edges, FailedFit) and candidate[3] < SMALL_PX:
        closer = blob_ellipse(image, candidate)
        if closer is not None and plausible(closer, image.shape):
            edges = edge_points(image, closer, full_scale_dn, polish=False)
    if isinstance(edges, FailedFit) or not is_circle_image(edges, noise, full_scale_dn, _ROUGH_PX if polish else 0.0):
        return None
    if polish:
        edges = edge_points(image, edges.ellipse, full_scale_dn)
        if isinstance(edges, FailedFit) or not is_circle_image(edges, noise, full_scale_dn):
            return None
    return _Contour(edges, confidence_of(edges, noise, full_scale_dn))


def _alike(one: Array, other: Array, tolerance_px: float) -> bool:
    """Whether two ellipses are the same contour: their extreme points agree within the tolerance."""
    if max(abs(one[0] - other[0]), abs(one[1] - other[1])) > tolerance_px:
        return False
    spread_one, spread_other = _half_widths(one), _half_widths(other)
    return bool(np.max(np.abs(spread_one - spread_other)) <= tolerance_px)


def _half_widths(ellipse: Array) -> Array:
    """Half-widths in x, y and the diagonals: enough to distinguish two ellipses with the same centre."""
    directions = np.radians(np.array([0.0, 45.0, 90.0, 135.0]) - ellipse[4])
    return np.asarray(np.hypot(ellipse[2] * np.cos(directions), ellipse[3] * np.sin(directions)))


def _group(found: list[_Contour], ellipses: list[Array]) -> list[Detection]:
    """Merge concentric contours into one detection; the outermost is the marker's."""
    remaining = sorted(found, key=lambda c: -float(c.edges.ellipse[2]))
    out = []
    while remaining:
        outer = remaining.pop(0)
        ellipse = outer.edges.ellipse
        inner = [c.edges for c in remaining if _concentric(ellipse, c.edges.ellipse)]
        remaining = [c for c in remaining if not _concentric(ellipse, c.edges.ellipse)]
        close = [e for e in ellipses if _alike(e, ellipse, 1.0 + 0.1 * float(ellipse[3]))]
        own = min(close, key=lambda e: float(np.abs(_half_widths(e) - _half_widths(ellipse)).sum()), default=None)
        out.append(Detection(outer.edges, inner, own, outer.confidence))
    strength = [
        d.edges.coverage * float(d.edges.ellipse[2] + d.edges.ellipse[3]) * abs(d.edges.contrast_dn) for d in out
    ]
    order = sorted(range(len(out)), key=lambda i: (-strength[i], out[i].edges.ellipse[0]))
    return [out[i] for i in order]


def _concentric(outer: Array, inner: Array) -> bool:
    """Whether two ellipses may be concentric circles in one plane.

    For such circles of radii r and s, C_outer^-1 C_inner has the eigenvalues (1, 1, s^2 / r^2) up to a common factor,
    in the plane and under any projection. Two equal eigenvalues, other than those of the hole, make them concentric.
    """
    gap = np.abs(outer[:2] - inner[:2])
    widths = _half_widths(outer) - _half_widths(inner)
    if inner[2] >= outer[2] or gap[0] > widths[0] or gap[1] > widths[2]:
        return False
    product = np.linalg.solve(_conic(outer, outer), _conic(inner, outer))
    values = np.sort(np.abs(np.linalg.eigvals(product)))[::-1]
    # An offset of a tenth of the outer radius separates them by 1 to 2 %; an error of 0.3 px by about 0.6 px over b.
    return bool(values[0] / values[1] - 1.0 <= _CONCENTRIC + _CONCENTRIC_PX / float(inner[3]))


def _conic(ellipse: Array, frame: Array) -> Array:
    """The conic of an ellipse, in coordinates in which `frame` is about the unit circle, for numerical accuracy."""
    scale = float(frame[2])
    x, y = (ellipse[:2] - frame[:2]) / scale
    c, s = math.cos(math.radians(ellipse[4])), math.sin(math.radians(ellipse[4]))
    to_circle = np.array([[c, s, -c * x - s * y], [-s, c, s * x - c * y], [0.0, 0.0, 1.0]])
    to_circle[0] *= scale / ellipse[2]
    to_circle[1] *= scale / ellipse[3]
    return np.asarray(to_circle.T @ np.diag([1.0, 1.0, -1.0]) @ to_circle)
