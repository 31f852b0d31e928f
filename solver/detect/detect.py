"""Detect the circles of an image: candidates, evidence along their contours, one detection for each marker."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.solver.detect.candidates import candidate_ellipses
from roundel.solver.detect.concentric import outer_contours
from roundel.solver.detect.contours import Contour, Contours, Level
from roundel.solver.detect.distinct import alike, half_width
from roundel.solver.detect.edge_chains import edge_chains, edgedrawing_ellipses
from roundel.solver.detect.grey_image import grey_8bit, noise_dn
from roundel.solver.detect.pyramid import enlarged_ellipse, reduced
from roundel.solver.fit.edges import EdgePoints

Array = NDArray[np.float64]

_MAX_PX = 16_000_000  # larger images are searched at reduced size, and measured at full size
_REDUCTIONS = (1, 3, 6)  # of the searched size: reduction shrinks a blur and averages the noise; 3 costs a ninth
_MIN_SIDE_PX = 24  # smallest side of a reduced image


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
        EdgeDrawing's own ellipse of this contour, if it was asked for and found one.
    confidence : float
        Confidence that this is the image of a circle, 0 to 1: see `solver.detect.confidence`.
    visible : float
        Fraction of the contour inside the image; below 1 the border cuts it.
    """

    edges: EdgePoints
    inner: list[EdgePoints] = field(default_factory=list)
    edgedrawing: Array | None = None
    confidence: float = 1.0
    visible: float = 1.0

    @property
    def cut(self) -> bool:
        """Whether the image's border cuts the contour."""
        return self.visible < 1.0


def detect(
    image: NDArray[Any],
    full_scale_dn: float = 255.0,
    polish: bool = False,
    own_ellipses: bool = False,
    levels: NDArray[np.float32] | None = None,
) -> list[Detection]:
    """Find the circles of a grey image.

    Parameters
    ----------
    image : (H, W) array
    full_scale_dn : float
        The level at which its pixels saturate.
    polish : bool
        Iterate the edge points to convergence, see `edge_points`. Otherwise they are only accurate enough to accept or
        reject a contour: `fit_pixels` starts from them, other fits need converged points.
    own_ellipses : bool
        Also compute EdgeDrawing's own ellipses.
    levels : (H, W) float32 array, optional
        The image, if the caller has converted it already.

    Returns
    -------
    list of Detection
        The strongest evidence first (visible contour length times contrast).
    """
    image = np.ascontiguousarray(image)
    # Kernels would be compiled again for others.
    pixels = np.require(image if levels is None else levels, np.float32, ["C", "W"])
    first = max(1, math.ceil(math.sqrt(image.size / _MAX_PX)))
    full = Level(pixels, 1, noise_dn(image))
    contours = Contours(full, full_scale_dn, polish)
    ellipses: list[Array] = []
    smaller, by = pixels, 1  # the last reduced image, of which the next may be a reduction
    for factor in (first * reduction for reduction in _REDUCTIONS):
        if factor > 1 and min(image.shape) < _MIN_SIDE_PX * factor:
            continue
        if factor > 1:
            smaller, by = reduced(smaller, factor // by) if factor % by == 0 else reduced(pixels, factor), factor
        level = image if factor == 1 else smaller
        grey, gain = grey_8bit(level, full_scale_dn)
        noise = full.noise if factor == 1 else noise_dn(level)
        candidates = candidate_ellipses(edge_chains(grey, noise * gain), grey.shape)
        searched = pixels if factor == 1 else np.asarray(level, dtype=np.float32)
        contours.search(Level(searched, factor, noise), candidates)
        if own_ellipses and factor == first:
            ellipses = [enlarged_ellipse(e, factor) for e in edgedrawing_ellipses(grey, noise * gain)]
    return _grouped(contours.found, ellipses)


def _grouped(found: list[Contour], ellipses: list[Array]) -> list[Detection]:
    """Merge concentric contours into one detection; the outermost is the marker's."""
    if not found:
        return []
    found = sorted(found, key=lambda c: -float(c.edges.ellipse[2]))
    ellipses_px, blur_px = np.array([c.edges.ellipse for c in found]), np.array([c.edges.blur_px for c in found])
    members: dict[int, list[Contour]] = {}
    for contour, outer in zip(found, outer_contours(ellipses_px, blur_px), strict=True):
        members.setdefault(int(outer), []).append(contour)
    out = []
    for outer, *inner in members.values():
        own = _closest(outer.edges.ellipse, ellipses)
        out.append(Detection(outer.edges, [c.edges for c in inner], own, outer.confidence, outer.visible))
    strength = [
        d.edges.coverage * float(d.edges.ellipse[2] + d.edges.ellipse[3]) * abs(d.edges.contrast_dn) for d in out
    ]
    order = sorted(range(len(out)), key=lambda i: (-strength[i], out[i].edges.ellipse[0]))
    return [out[i] for i in order]


def _closest(ellipse: Array, ellipses: list[Array]) -> Array | None:
    """The most similar one of the ellipses on the same contour."""
    close = [e for e in ellipses if alike(e, ellipse, 1.0 + 0.1 * float(ellipse[3]))]

    def difference(other: Array) -> float:
        return sum(abs(half_width(other, 45.0 * k) - half_width(ellipse, 45.0 * k)) for k in range(4))

    return min(close, key=difference, default=None)
