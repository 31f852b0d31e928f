"""The predicted pixels along a contour, with derivatives by ellipse, blur and grey levels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.geometry.edge_spread_function import PIXEL_VARIANCE, curved_distance, step_response
from roundel.solver.fit.band_pixels import BandPixels
from roundel.solver.fit.disc_blur import disc_minus_gauss
from roundel.solver.fit.edge_band import Band
from roundel.solver.fit.grey_levels import Plateau

Array = NDArray[np.float64]

_MIN_VARIANCE = 0.05**2  # a smaller blur is indistinguishable from none
_DISC_VARIANCE = 0.1  # the shape of a blur so much smaller than the pixel is not visible
# Share of a disc in the blur, from Gaussian (0) to circle of confusion (1); motion blur is slightly beyond.
_DISC, _DISC_SIGMA, _DISC_LIMITS = 0.0, 1.0, (-1.0, 1.5)
# A tilted plane is more defocused on one side: the radius changes linearly across it, usually by a few per cent. The
# radius at the edge, not at the pixel, decides on which side of the edge a ray meets the print.
_GRADIENT = 0.15
_SMEAR = 2.0


@dataclass(frozen=True, eq=False)
class Light:
    """The level functions that a fit uses, and the plateaus without stains; see `pixel_scene`."""

    basis: Array
    basis_slope: Array
    place: Array
    inside: Plateau
    outside: Plateau
    smeared: bool  # whether the blur may differ between directions

    def residuals(self, levels: Array) -> tuple[Array, Array]:
        """Residuals of the plateaus for levels (2, k)."""
        return self.inside.residual(levels[0]), self.outside.residual(levels[1])


@dataclass(frozen=True, eq=False)
class State:
    """Parameters: shape at which distances were computed, its change since then, blur, levels (2, k)."""

    theta: Array
    change: Array
    variance: float
    disc: float
    gradient: Array  # (2,) of the variance with respect to position
    smear: Array  # (2,) of the variance, coefficients of cos and sin of twice the normal's direction
    levels: Array

    def moved(self, step: Array) -> State:
        """The state after a step (11 + 2 k,), with the blur kept within bounds."""
        variance = float(np.clip(self.variance + step[5], max(self.variance / 4, _MIN_VARIANCE), self.variance * 4))
        disc = float(np.clip(self.disc + step[6], *_DISC_LIMITS))
        gradient = np.clip(self.gradient + step[7:9], -variance / 2, variance / 2)
        smear = self.smear + step[9:11]
        smear = smear * min(1.0, variance / max(float(np.hypot(smear[0], smear[1])), 1e-12))
        levels = self.levels + step[11:].reshape(2, -1)
        return State(self.theta, self.change + step[:5], variance, disc, gradient, smear, levels)


@dataclass(frozen=True, eq=False)
class Response:
    """Step response of pixels.

    Attributes
    ----------
    value : (N,) array
    slope, widening, change, smearing : (N,) arrays, the last (N, 2)
        Derivatives by the distance, the blur's variance, its share of a disc, and its smear.
    moment : (N,) array
        If the step grows by g per pixel along the normal, the response grows by g times this, because the blur moves
        light to the pixel. It is the integral of u p(u) beyond the edge; for a Gaussian, variance times density.
    """

    value: Array
    slope: Array
    widening: Array
    change: Array
    smearing: Array
    moment: Array


@dataclass(frozen=True, eq=False)
class Step:
    """Prediction at the current parameters: the residual of each pixel, and its derivatives."""

    residual: Array
    design: Array  # (N, 11 + 2 k): shape; blur's variance, disc, gradient, smear; levels inside, levels outside
    response: Response
    share: Array  # of the outer level in each pixel, 0 to 1
    slope_dn: Array  # of the prediction by the distance, dn/px


def response_of(band: Band, distance: Array, state: State) -> Response:
    """Step response of a band's pixels, at distances that may differ from the band's own."""
    variance = state.variance
    total = variance + PIXEL_VARIANCE
    z, drift = curved_distance(distance, band.curvature, band.curvature_ss, total)
    own: float | Array = variance
    turned = twice_turned(band)
    if np.any(state.smear):
        # The blur is n^T B n across the edge and t^T B t along it; their covariance rotates the edge's image.
        across = turned @ state.smear
        covariance = state.smear[1] * turned[:, 0] - state.smear[0] * turned[:, 1]
        own = np.maximum(variance + across, _MIN_VARIANCE)
        whole = own + PIXEL_VARIANCE
        share = covariance**2 / whole
        # Beyond two sigmas the edge has no influence.
        along = np.maximum(variance - across, 0.0) + PIXEL_VARIANCE - share * (1.0 - np.minimum(z * z / whole, 4.0))
        z += band.curvature / 2 * (along - total)
    response, slope, bend = step_response(z, band.half_sum, band.half_difference, own)
    widening, change = bend / 2, np.zeros_like(z)
    moment = (own + PIXEL_VARIANCE) * slope
    if variance > _DISC_VARIANCE:
        difference = disc_minus_gauss(z, band.curvature, variance, own)
        change = difference.change
        response += state.disc * change
        slope += state.disc * difference.slope
        widening += state.disc * difference.widening
        moment += state.disc * difference.moment
    # A blur that also widens along the edge shifts it; a smear removes along the edge what it adds across.
    smearing = (widening - slope * (band.curvature / 2))[:, None] * turned
    widening += slope * drift
    slope *= 1.0 - band.curvature**2 * total / 4
    return Response(response, slope, widening, change, smearing, moment)


def twice_turned(band: Band) -> Array:
    """Cosine and sine (N, 2) of twice the direction of the normals."""
    nx, ny = band.normal.T
    return np.stack([(nx - ny) * (nx + ny), 2 * nx * ny], axis=1)


def predict(pixels: BandPixels, state: State, light: Light, response: Response | None = None) -> Step:
    """Residual of the edge's pixels at the current parameters, and derivatives; pass `response` if it is known."""
    if response is None:
        distance = pixels.band.distance + pixels.jacobian @ state.change
        response = response_of(pixels.band, distance, state)
    height = light.basis @ (state.levels[1] - state.levels[0])
    k = light.basis.shape[1]
    slope_dn = height * response.slope
    design = np.empty((len(height), 11 + 2 * k))
    np.multiply(pixels.jacobian, slope_dn[:, None], out=design[:, :5])
    design[:, 5] = height * response.widening
    design[:, 6] = height * response.change
    np.multiply(light.place, design[:, 5:6], out=design[:, 7:9])
    np.multiply(response.smearing, height[:, None], out=design[:, 9:11])
    outer = design[:, 11 + k :]
    np.multiply(light.basis, response.value[:, None], out=outer)
    outer += light.basis_slope * response.moment[:, None]
    np.subtract(light.basis, outer, out=design[:, 11 : 11 + k])
    residual = pixels.band.value - design[:, 11:] @ state.levels.ravel() - design[:, 7:9] @ state.gradient
    return Step(residual, design, response, np.clip(response.value, 0.0, 1.0), slope_dn)


def gauss_newton(
    step: Step, weight: Array, light: Light, state: State, noise: tuple[float, float]
) -> tuple[Array, Array]:
    """Inverse of the normal matrix, and the step; not finite if the pixels do not determine it."""
    weighted = step.design * weight[:, None]
    normal, gradient = step.design.T @ weighted, weighted.T @ step.residual
    # If the blur is small, the pixels do not determine its shape: it is then a Gaussian.
    normal[6, 6] += _DISC_SIGMA**-2
    gradient[6] -= (state.disc - _DISC) * _DISC_SIGMA**-2
    tight = (_GRADIENT * max(state.variance, _DISC_VARIANCE)) ** -2
    normal[7, 7] += tight
    normal[8, 8] += tight
    gradient[7:9] -= state.gradient * tight
    loose = ((_SMEAR if light.smeared else 1e-6) * max(state.variance, _DISC_VARIANCE)) ** -2
    normal[9, 9] += loose
    normal[10, 10] += loose
    gradient[9:11] -= state.smear * loose
    k = light.basis.shape[1]
    for i, plateau in enumerate((light.inside, light.outside)):
        part = slice(11 + i * k, 11 + (i + 1) * k)
        normal[part, part] += plateau.basis.T @ plateau.basis / noise[i]
        gradient[part] += plateau.basis.T @ plateau.residual(state.levels[i]) / noise[i]
    diagonal = np.diag(normal)
    if not (np.all(np.isfinite(diagonal)) and np.all(diagonal > 0)):
        return normal, np.full(len(normal), np.nan)
    scale = 1.0 / np.sqrt(diagonal)
    try:
        inverse = np.linalg.inv(normal * scale[:, None] * scale) * scale[:, None] * scale
    except np.linalg.LinAlgError:
        return normal, np.full(len(normal), np.nan)
    return inverse, inverse @ gradient
