"""From candidate ellipses to contours: the strongest evidence first, each contour measured once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.solver.detect.blob import SMALL_PX, blob_ellipse
from roundel.solver.detect.candidates import plausible
from roundel.solver.detect.confidence import confidence_of, is_circle_image
from roundel.solver.detect.distinct import EllipseIndex
from roundel.solver.detect.evidence import POLARITY, RESIDUAL, SUPPORT, contour_evidence
from roundel.solver.detect.light_slope import slope_beside
from roundel.solver.detect.pyramid import enlarged, enlarged_ellipse
from roundel.solver.fit.edges import EdgePoints, edge_points
from roundel.solver.fit.ellipse import FailedFit

Array = NDArray[np.float64]

_MIN_SUPPORT = 0.3  # fraction of the contour that must show a step: a marker may be partly hidden
_CONFIDENT = 0.5
_CLEAR = 8.0  # a contrast of this many sigmas is detected without averaging
_ROUGH_PX = 0.05  # error of points that are not polished
_SMOOTH = 0.6  # slope beside a contour over its own: smooth light; a blur of 5 px of a level has less
_NEAR = 0.05  # fraction of b within which candidates are the same contour
# Of a circle's steps: error of a step's place, and deviation of a rough ellipse as a fraction of b.
_LOCATED_PX, _ROUND = 0.15, 0.01
# The search of a level ends after so many candidates without a confident one; later ones have even less evidence. A
# board of many circles has many chances to be interrupted. A reduced level has only what the full image did not show.
_PATIENCE, _PATIENCE_REDUCED, _PATIENCE_EACH = 48, 24, 0.5


@dataclass(frozen=True, eq=False)
class Level:
    """The image (H, W) of float32, reduced by a factor, and its noise."""

    image: NDArray[np.float32]
    factor: int
    noise: float


@dataclass(frozen=True, eq=False)
class Contour:
    """Edge points of one contour, the confidence that it is a circle, the fraction of it inside the image."""

    edges: EdgePoints
    confidence: float
    visible: float


class Contours:
    """The contours found so far, in pixels of the full image."""

    def __init__(self, full: Level, full_scale_dn: float, polish: bool) -> None:
        self.found: list[Contour] = []
        self._full, self._full_scale_dn, self._polish = full, full_scale_dn, polish
        self._index = EllipseIndex()

    def search(self, level: Level, candidates: Array) -> None:
        """Add the candidates (n, 5) of a level that are circles, each contour once."""
        evidence = contour_evidence(level.image, candidates)
        evidence = evidence[_promising(evidence)]
        # The best first, ties from left to right, so that the order is deterministic.
        order = np.lexsort((evidence[:, 1], evidence[:, 0], -_merit(evidence)))
        tried = EllipseIndex()
        failures, sure = 0, 0
        patience = _PATIENCE if level.factor == 1 else _PATIENCE_REDUCED
        for row in evidence[order]:
            if failures >= patience + _PATIENCE_EACH * sure:
                break
            candidate, sign = enlarged_ellipse(row[:5], level.factor), float(row[POLARITY])
            tolerance = level.factor + _NEAR * float(candidate[3])
            if tried.has(candidate, tolerance, sign) or self._index.has(candidate, tolerance, sign):
                continue
            tried.add(candidate, sign)
            contour = self._measured(level, row[:5])
            if contour and contour.confidence >= _CONFIDENT:
                failures, sure = 0, sure + 1
            else:
                failures += 1
            if contour and not self._index.has(contour.edges.ellipse, 0.5 * level.factor):
                self.found.append(contour)
                self._index.add(contour.edges.ellipse, float(np.sign(contour.edges.contrast_dn)))

    def _measured(self, level: Level, candidate: Array) -> Contour | None:
        """The contour at a candidate: from the full image, or from the level if the full image shows none."""
        there = self._judged(level, candidate)
        if there is None or level.factor == 1:
            return there
        there = Contour(enlarged(there.edges, level.factor), there.confidence, there.visible)
        here = self._judged(self._full, there.edges.ellipse)
        clear = abs(there.edges.contrast_dn) > _CLEAR * self._full.noise
        if there.edges.blur_px < level.factor and clear:
            return here  # neither blurred nor noisy: the reduced image was only too coarse to reject it
        return here if here and here.confidence >= min(there.confidence, _CONFIDENT) else there

    def _judged(self, level: Level, candidate: Array) -> Contour | None:
        # Most candidates are not circles, and a quick test rejects them.
        image, noise, full_scale_dn = level.image, level.noise, self._full_scale_dn
        edges = edge_points(image, candidate, full_scale_dn, polish=False)
        if isinstance(edges, FailedFit) and candidate[3] < SMALL_PX:
            closer = blob_ellipse(image, candidate)
            if closer is not None and plausible(closer, *image.shape):
                edges = edge_points(image, closer, full_scale_dn, polish=False)
        rough_px = _ROUGH_PX if self._polish else 0.0
        if isinstance(edges, FailedFit) or not is_circle_image(edges, noise, full_scale_dn, rough_px):
            return None
        if self._polish:
            edges = edge_points(image, edges.ellipse, full_scale_dn)
            if isinstance(edges, FailedFit) or not is_circle_image(edges, noise, full_scale_dn):
                return None
        if slope_beside(image, edges.ellipse) > _SMOOTH:
            return None
        visible = visible_fraction(edges.ellipse, image.shape)
        return Contour(edges, confidence_of(edges, noise, full_scale_dn, visible), visible)


def _promising(evidence: Array) -> NDArray[np.bool_]:
    # A step is located to some tenths of a pixel; beyond that, a residual over 2 % of b is a square or a letter.
    return np.asarray((evidence[:, SUPPORT] >= _MIN_SUPPORT) & (evidence[:, RESIDUAL] <= 0.3 + 0.02 * evidence[:, 3]))


def _merit(evidence: Array) -> Array:
    """Likelihood that a candidate is a circle: steps all round, on an ellipse; large ones before small ones.

    Lengths alone would put every outline of a large thing before the circles of a cluttered image.
    """
    deviation = evidence[:, RESIDUAL] / (_LOCATED_PX + _ROUND * evidence[:, 3])
    return np.asarray(evidence[:, SUPPORT] ** 2 * (evidence[:, 2] + evidence[:, 3]) ** 0.25 / (1.0 + deviation**2))


def visible_fraction(ellipse: Array, shape: tuple[int, ...]) -> float:
    """Fraction of the contour inside an image (height, width), of 64 steps of the eccentric angle."""
    t = np.arange(64) * (2.0 * np.pi / 64)
    c, s = np.cos(np.radians(ellipse[4])), np.sin(np.radians(ellipse[4]))
    p, q = ellipse[2] * np.cos(t), ellipse[3] * np.sin(t)
    x, y = ellipse[0] + c * p - s * q, ellipse[1] + s * p + c * q
    return float(np.mean((x >= -0.5) & (y >= -0.5) & (x <= shape[1] - 0.5) & (y <= shape[0] - 0.5)))
