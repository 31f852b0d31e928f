"""The response curve of an image, estimated from its edges.

A blurred edge rises symmetrically: at equal distances from its middle, light lacks as much to the brighter side as it
exceeds the darker one, whatever the blur. A response curve breaks this symmetry. The pixels along a contour are
therefore predicted several times, as light that has passed a linear curve, sRGB, and powers between and beyond, with
the same weights and freedoms: ellipse, blur with its fourth moment, light that varies across the marker. Differences of
their chi-squares are log likelihood ratios. A curve is accepted only if it is far more likely than the others.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.response_curve import LINEAR, SRGB, UNKNOWN, ResponseCurve, gamma_curve
from roundel.scenes.geometry.edge_spread_function import PIXEL_VARIANCE
from roundel.solver.fit.edges import EdgePoints
from roundel.solver.kernels.contour_pixels import (
    DISTANCE,
    VALUE,
    X,
    Y,
    contour_pixels,
)
from roundel.solver.kernels.curve_likelihood import (
    GAMMA_KIND,
    LINEAR_KIND,
    SRGB_KIND,
    UNKNOWNS,
    curve_likelihood,
    outer_shares,
)
from roundel.solver.photometry.edge_levels import overshoots

Array = NDArray[np.float64]

# Powers next to linear and to sRGB, which must not explain the pixels better.
_BESIDE = ((gamma_curve(1 / 1.5), gamma_curve(1.5)), (gamma_curve(1.5), gamma_curve(3.3)))
_CONTOURS = 4  # the strongest; each alone usually decides
_PLATEAU_PX = 3.0
_EDGE_SIGMAS = 2.2  # the step has ended there, but for 1 %
_FEWEST = 30
_SATURATED = 254.5 / 255.0
_MARGIN_PX = 0.7  # a pixel's half diagonal
_LEAST_SIGMA = 0.3 / 255  # rounding to 8 bits
# Chi-square by which a curve must be better than the other, and by which a third one must not be. A difference of D on
# average scatters by 2 sqrt(D): a wrong decision is most likely for D = 16, four standard deviations away.
_BETTER, _THIRD = 16.0, 16.0
_PLAIN = 4 * _BETTER  # further contours would add nothing
_PARTS, _AGREEMENT = 16, 3.0  # parts of a contour, and standard errors by which they must agree
_FEW, _MOST = 450, 2000  # pixels of a contour; more are only needed where few do not decide
_MOST_MISFIT = 20.0  # reduced chi-square beyond which no curve explains the pixels


@dataclass(frozen=True)
class CurveEvidence:
    """Chi-squares of the curves, summed over contours.

    Attributes
    ----------
    chi2 : (float, float)
        Of linear and sRGB levels, in units of the better one's reduced chi-square, if that is more than 1.
    third : float
        The least of other powers.
    agreement : float
        Mean of the difference of both chi-squares over parts of the contours, divided by its standard error: a
        difference that comes from a few places is an error of the model.
    misfit : float
        Largest of the contours' reduced chi-squares for their best curve.
    contours : int
        Number of contours that could be measured.
    sharpened : bool
        Whether a contour overshoots, as no blur does: its shape is then that of the filter.
    """

    chi2: tuple[float, float] = (0.0, 0.0)
    third: float = math.inf
    agreement: float = 0.0
    misfit: float = 0.0
    contours: int = 0
    sharpened: bool = False

    @property
    def curve(self) -> ResponseCurve:
        """The curve that the evidence tells: linear or sRGB, or unknown, with its basis."""
        edges = f"the edges of {self.contours} circle{'' if self.contours == 1 else 's'}"
        if self.sharpened:
            return UNKNOWN.because("the edges are sharpened")
        if not self.contours:
            return UNKNOWN.because("no edge in the image can be measured")
        if self.misfit > _MOST_MISFIT:
            return UNKNOWN.because(f"{edges} fit no curve")
        if min(self.chi2) - self.third > _THIRD:
            return UNKNOWN.because(f"{edges} fit neither linear nor sRGB levels")
        if abs(self.chi2[0] - self.chi2[1]) <= _BETTER or abs(self.agreement) < _AGREEMENT:
            return UNKNOWN.because(f"{edges} do not tell")
        return (LINEAR if self.chi2[0] < self.chi2[1] else SRGB).because(f"estimated from {edges}")


def curve_evidence(levels: NDArray[np.float32], contours: Sequence[EdgePoints], full_scale_dn: float) -> CurveEvidence:
    """Compare the curves on the strongest contours of an image.

    Parameters
    ----------
    levels : (H, W) float32 array
        As delivered.
    contours : sequence of EdgePoints
        Measured in `levels`.
    full_scale_dn : float
        The top of the range of the levels, where pixels saturate.
    """
    order = sorted(contours, key=lambda e: -abs(e.contrast_dn) * math.sqrt(e.coverage * float(e.ellipse[2])))
    few = _evidence(levels, order[:_CONTOURS], full_scale_dn, _FEW)
    plain = abs(few.chi2[0] - few.chi2[1]) > _PLAIN and few.curve.known
    return few if plain or few.sharpened else _evidence(levels, order[:_CONTOURS], full_scale_dn, _MOST)


def _evidence(
    levels: NDArray[np.float32], contours: Sequence[EdgePoints], full_scale_dn: float, most: int
) -> CurveEvidence:
    """The evidence of so many pixels of each contour; the next one is only asked if those before do not decide."""
    total, misfit = np.zeros(2), 0.0
    measured: list[tuple[_Edge, float, Array]] = []
    parts: list[Array] = []
    for edges in contours:
        if overshoots(levels, edges):
            return CurveEvidence(sharpened=True)
        edge = _edge_of(levels, edges, full_scale_dn, most)
        if edge is None:
            continue
        linear = _fit(edge, LINEAR)
        fits = [linear, _fit(edge, SRGB, linear[1])]
        chi2 = np.array([fit[0] for fit in fits])
        if not np.all(np.isfinite(chi2)):
            continue
        reduced = float(np.min(chi2)) / max(len(edge.table) - UNKNOWNS, 1)
        scale = max(reduced, 1.0)
        total += chi2 / scale
        parts.append(np.bincount(edge.part, fits[1][2] - fits[0][2], minlength=_PARTS) / scale)
        measured.append((edge, scale, fits[int(np.argmin(chi2))][1]))
        misfit = max(misfit, reduced)
        if abs(total[0] - total[1]) > _PLAIN:
            break
    if not measured:
        return CurveEvidence()
    every = np.concatenate(parts)
    error = float(np.std(every, ddof=1)) / math.sqrt(len(every))
    agreement = float(np.mean(every)) / max(error, 1e-9)
    third = math.inf
    if abs(total[0] - total[1]) > _BETTER:
        for curve in _BESIDE[int(np.argmin(total))]:
            third = min(third, sum(_fit(edge, curve, start)[0] / scale for edge, scale, start in measured))
    return CurveEvidence((float(total[0]), float(total[1])), third, agreement, misfit, len(measured))


@dataclass(frozen=True, eq=False)
class _Edge:
    """The pixels of one edge: their table with levels as fractions, weights, places, parts, and sides as planes."""

    table: Array
    weight: Array
    place: Array
    part: NDArray[np.int64]
    sides: tuple[Array, Array]
    variance: float


def _edge_of(levels: NDArray[np.float32], edges: EdgePoints, full_scale_dn: float, most: int) -> _Edge | None:
    found = _pixels(levels, edges, full_scale_dn, most)
    if found is None:
        return None
    table, part = found
    table[:, VALUE] /= full_scale_dn
    place = (table[:, [X, Y]] - edges.ellipse[:2]) / edges.ellipse[2]
    sigma = math.sqrt(edges.blur_px**2 + PIXEL_VARIANCE)
    ended = _EDGE_SIGMAS * sigma + _MARGIN_PX / 2
    basis = np.column_stack([np.ones(len(place)), place])
    sides, noise = [], []
    for side in (table[:, DISTANCE] < -ended, table[:, DISTANCE] > ended):
        if np.count_nonzero(side) < _FEWEST:
            return None
        plane = np.linalg.lstsq(basis[side], table[side, VALUE], rcond=None)[0]
        sides.append(plane)
        noise.append(max(float(np.mean((table[side, VALUE] - basis[side] @ plane) ** 2)), _LEAST_SIGMA**2))
    variance = max(edges.blur_px, 0.2) ** 2
    weight = 1.0 / (noise[0] + (noise[1] - noise[0]) * outer_shares(table, variance))
    return _Edge(table, weight, place, part, (sides[0], sides[1]), variance)


def _fit(edge: _Edge, curve: ResponseCurve, near: Array | None = None) -> tuple[float, Array, Array]:
    """Chi-square of an edge for a curve, its unknowns, and what each pixel adds; `near` has those of another curve."""
    start = np.zeros(UNKNOWNS)
    start[5] = math.log(edge.variance)
    if near is not None:
        start[:7] = near[:7]  # ellipse and blur
    for j, plane in zip((7, 10), edge.sides, strict=True):
        level = min(max(float(plane[0]), 1e-3), 1.0)
        start[j] = float(curve.light(level))
        start[j + 1 : j + 3] = plane[1:] * float(np.diff(curve.light([level, level + 1e-3]))[0]) * 1e3
    kind = {"linear": LINEAR_KIND, "srgb": SRGB_KIND}.get(curve.kind, GAMMA_KIND)
    return curve_likelihood(edge.table, edge.weight, edge.place, start, kind, curve.gamma)


def _pixels(
    levels: NDArray[np.float32], edges: EdgePoints, saturation_dn: float, most: int
) -> tuple[Array, NDArray[np.int64]] | None:
    """The pixels around the trusted part of a contour, up to where they start to be clipped, and the part of each."""
    low, high = edges.reach_px
    count = len(edges.trusted)
    table, starts = contour_pixels(levels, edges.ellipse, low - _PLATEAU_PX / 2, high + _PLATEAU_PX / 2, count)
    part = np.repeat(np.arange(count) * _PARTS // count, np.diff(starts))
    # Of a long contour every second sector, or fewer.
    some = edges.trusted & (np.arange(count) % max(1, round(len(table) / most)) == 0)
    trusted = np.repeat(some, np.diff(starts))
    table, part = table[trusted], part[trusted]
    clipped = table[:, VALUE] >= saturation_dn * _SATURATED
    if np.any(clipped):
        # By distance, because a selection by level would be one by noise.
        bright = math.copysign(1.0, edges.contrast_dn)
        first = float(np.quantile(bright * table[clipped, DISTANCE], 0.02)) - _MARGIN_PX
        before = bright * table[:, DISTANCE] < first
        table, part = table[before], part[before]
    return (table, part) if len(table) > 2 * _FEWEST else None
