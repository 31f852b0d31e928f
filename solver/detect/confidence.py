"""Confidence that a contour is the image of a circle, and the threshold below which it is not reported.

The confidence is a product of four parts, each 1 if there is no evidence against a circle:

- shape: an upper bound of the contour's systematic deviation from an ellipse, relative to b. 0.9 % halves it: an
  octagon deviates by 2.2 % from its best ellipse, a hexagon by 4 %, a square by 9 %, most letters O by 1.5 %. Small,
  noisy or blurred contours do not distinguish an octagon from a circle, so their bound is large.
- pixels: residual of the single-edge model beyond the pixels' noise; a tenth of the contrast halves it.
- coverage: the fraction of the contour inside the image that shows an edge; a half counts little, 95 % fully.
- contrast: the step over the noise, times the square root of the number of points.

A fit to the pixels whose residuals exceed their noise lowers it: see `confidence_of_fit`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.geometry.edge_spread_function import PIXEL_VARIANCE
from roundel.solver.detect.candidates import plausible
from roundel.solver.detect.ellipse_sums import sampson
from roundel.solver.fit.edges import EdgePoints
from roundel.solver.kernels.compiled import compiled

Array = NDArray[np.float64]

_SHAPE = 0.009
_PIXELS = 0.10
_NO_COVERAGE, _FULL_COVERAGE = 0.25, 0.95
# Of a contour cut by the border: what is outside is no evidence against a circle, but a short arc fits many things.
_NO_ARC, _FULL_ARC = 0.3, 0.6
_SIGNAL = 20.0
# Residuals of a fit to the pixels, 33 times the noise, that halve it. The ratio counts by its logarithm: where an image
# has hardly any noise (the interpolated colours of a mosaic), the covariance has residuals of four times as much.
_RESIDUALS = 33.0
# A blur of sigma s reduces the n-th harmonic of a contour by exp(-n^2 s^2 / (2 r^2)); n = 5 is that of a pentagon.
_BLUR = 12.5

_MODEL = 0.7  # of the residual over the slope: levels and blur of the model explain a part of it
_MARKS_PX = 15.0  # marks farther from an edge than its blur displace it by the blur's square over some such distance

_MIN_COVERAGE = 0.35
_MIN_POINTS = 11  # fewer lie on an ellipse by chance
_WHOLE = 0.55  # a lower coverage is an arc, which must fit better
_MIN_CONTRAST_DN = 2.5  # rounding of smooth light produces contours of one grey level


def confidence_of(edges: EdgePoints, noise: float, full_scale_dn: float, visible: float = 1.0) -> float:
    """Confidence in [0, 1] that a contour is the image of a circle; 1: complete, with residuals at the noise level.

    Parameters
    ----------
    edges : EdgePoints
    noise : float
        Standard deviation of the image's noise, dn.
    full_scale_dn : float
    visible : float
        Fraction of the contour inside the image.
    """
    contrast, count = abs(edges.contrast_dn), len(edges.points_px)
    a, b = float(edges.ellipse[2]), float(edges.ellipse[3])
    free = max(count - 5, 1)  # an ellipse has five parameters
    grain = max(noise, 1e-3 * full_scale_dn)  # rounding, in an image without noise
    noise2 = _noise_px(edges, noise) ** 2
    residual2 = rms_distance(edges.ellipse, edges.points_px) ** 2 * count / free
    model2 = _model_px(edges, 1.3 * grain) ** 2
    # Two standard deviations of the mean square of this many residuals.
    bound = math.sqrt(max(0.0, residual2 - noise2 - model2) + 2.0 * noise2 * math.sqrt(2.0 / free))
    # Of a tilted polygon: relative deviations are seen times about sqrt(a b), and the long sides keep their corners.
    hidden = math.exp(min(_BLUR * edges.blur_px**2 / ((a * a + b * b) / 2.0), 20.0))
    off = bound / math.sqrt(a * b) * hidden / _SHAPE
    misfit = math.sqrt(max(0.0, edges.noise_dn**2 - (1.3 * grain) ** 2)) / max(contrast, 1e-12) / _PIXELS
    seen = (min(edges.coverage / max(visible, 1e-9), 1.0) - _NO_COVERAGE) / (_FULL_COVERAGE - _NO_COVERAGE)
    arc = (visible - _NO_ARC) / (_FULL_ARC - _NO_ARC)
    signal = contrast / grain * math.sqrt(count) / _SIGNAL
    shape, pixels, contrast_part = 1.0 / (1.0 + off**4), 1.0 / (1.0 + misfit**4), -math.expm1(-(signal**2))
    return shape * pixels * contrast_part * min(max(seen, 0.0), 1.0) * min(max(arc, 0.0), 1.0)


def confidence_of_fit(confidence: float, misfit: float) -> float:
    """Confidence of a contour after the fit to its pixels, whose reduced chi-square is `misfit`.

    It falls with the logarithm of the residuals over the noise: unchanged up to 1, by 1 % at a chi-square of 2, 10 % at
    10, 30 % at 100.
    """
    if not misfit > 1.0:
        return confidence
    return confidence / (1.0 + (math.log(misfit) / math.log(_RESIDUALS**2)) ** 2)


def is_circle_image(edges: EdgePoints, noise: float, full_scale_dn: float, rough_px: float = 0.0) -> bool:
    """Whether a contour may be a circle; doubtful contours are kept, with a low confidence.

    `rough_px` is the error of points that have not converged.
    """
    contrast, b, coverage = abs(edges.contrast_dn), float(edges.ellipse[3]), edges.coverage
    if not plausible(edges.ellipse, 10**9, 10**9) or coverage < _MIN_COVERAGE or len(edges.points_px) < _MIN_POINTS:
        return False
    if contrast < max(_MIN_CONTRAST_DN * min(full_scale_dn / 255.0, 1.0), noise):
        return False
    if contrast < 8.0 * noise and coverage < 0.75:  # in strong noise half a contour is found by chance
        return False
    # Residual of the ellipse model beyond the pixels' noise; binary pixels have a larger one.
    aliased = edges.blur_px < 0.1 and b >= 4.0 and edges.noise_dn < 0.15 * contrast
    share = 0.12 if coverage >= _WHOLE else 0.03
    limit = math.hypot(1.5 * noise + 1e-3 * full_scale_dn, share * contrast)
    if edges.noise_dn > limit and not (aliased and coverage >= _WHOLE):
        return False
    # A square deviates from its best ellipse by 5 % of its half side, a letter O by 1 to 1.5 %. Lens distortion bends
    # an ellipse by its quadratic term, 1e-4 b^2 px at the corner of a wide-angle image.
    # If the blur extends across the ellipse, the model is wrong by about b^2 over its size.
    allowed = 0.012 + 0.004 * b + 1.2e-4 * b * b + 0.08 * edges.blur_px**2 / b
    if aliased and edges.noise_dn > 0.06 * contrast:
        allowed = max(allowed, 0.26)  # rounding of an edge to whole pixels
    model_px = _model_px(edges, 1.3 * max(noise, 1e-3 * full_scale_dn))
    explained_px = math.hypot(allowed + rough_px, 1.5 * _noise_px(edges, noise), model_px)
    return rms_distance(edges.ellipse, edges.points_px) <= explained_px


def rms_distance(ellipse: Array, points: Array) -> float:
    """RMS of the distances of points (N, 2) near an ellipse (5,), px."""
    return _rms(ellipse, np.ascontiguousarray(points))


@compiled
def _rms(ellipse: Array, points: Array) -> float:
    total = 0.0
    for i in range(len(points)):
        total += sampson(ellipse, points[i, 0], points[i, 1]) ** 2
    return math.sqrt(total / max(len(points), 1))


def _noise_px(edges: EdgePoints, noise: float) -> float:
    """RMS residual explained by the pixels' noise; residuals of the model beyond it do not count as explained."""
    own = min(1.0, 1.5 * noise / max(edges.noise_dn, 1e-9))
    return math.sqrt(float(np.mean(edges.sigma_px**2))) * own


def _model_px(edges: EdgePoints, grain: float) -> float:
    """How far an error of the model, its residual beyond this grain of the pixels, may displace an edge.

    Blur mixes marks beside the edge into its profile, as it does the other edge of a narrow ring: over the slope at the
    middle of the edge the residual is a displacement, at most the blur's square over the distance of such marks. A
    polygon has no such residual: its sides are perfect edges, which lie on no ellipse.
    """
    error = math.sqrt(max(0.0, edges.noise_dn**2 - grain**2)) / max(abs(edges.contrast_dn), 1e-12)
    width = math.sqrt(2.0 * math.pi * (edges.blur_px**2 + PIXEL_VARIANCE))
    return min(_MODEL * error * width, edges.blur_px**2 / _MARKS_PX)
