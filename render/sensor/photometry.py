"""Noise of a pixel and contrast of a marker's edge, in digital numbers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.render.sensor.curve import delivered_levels
from roundel.render.sensor.data_sheet import DataSheet
from roundel.render.sensor.demosaic import filters
from roundel.render.sensor.isp import saturated

Array = NDArray[np.float64]

# Variance of a rounding error, uniform over one DN (EMVA 1288: sigma_q^2).
QUANTISATION_VARIANCE_DN2 = 1.0 / 12.0

# Farther than this from the clipping level, clipping does not reduce a Gaussian's variance within float32 precision.
_CLIPPING_SIGMAS = 6.0

# Noise is propagated through a curve at this many quantiles, for this many levels of radiance.
_QUANTILES = 64
_KNOTS = 4096

# Distance from the edge, in pixels, within which its sides are measured.
_SIDE_PX = 4


def temporal_variance_dn2(electrons: ArrayLike, sheet: DataSheet) -> Array:
    """Temporal variance, converter's DN^2, of a pixel that collects this mean (dark signal included).

    EMVA 1288 release 4.0, linear model: K^2 (sigma_d^2 + mu_e) + sigma_q^2. Clipping is not included.
    """
    shot_e2 = np.asarray(electrons, dtype=np.float64) if sheet.shot_noise else 0.0
    return np.asarray((shot_e2 + sheet.read_noise_e**2) * sheet.gain_dn_per_e**2 + QUANTISATION_VARIANCE_DN2)


def pattern_variance_dn2(photo_electrons: ArrayLike, sheet: DataSheet) -> Array:
    """Spatial variance, converter's DN^2, of the fixed pattern: K^2 (DSNU^2 + PRNU^2 mu^2)."""
    spread_e2 = sheet.dsnu_e**2 + (sheet.prnu * np.asarray(photo_electrons, dtype=np.float64)) ** 2
    return np.asarray(spread_e2 * sheet.gain_dn_per_e**2)


def _unclipped(photo: Array, sheet: DataSheet) -> tuple[Array, Array]:
    """Mean and variance of the converter's numbers for pixels with these photo electrons, without clipping."""
    electrons = photo + sheet.dark_e
    variance = temporal_variance_dn2(electrons, sheet) + pattern_variance_dn2(photo, sheet)
    return electrons * sheet.gain_dn_per_e + sheet.black_level_dn, variance


def _clips(photo: Array, sheet: DataSheet) -> NDArray[np.bool_]:
    """Whether pixels (n,) are so close to the ends of the converter's range that their noise may be clipped."""
    mean, variance = _unclipped(photo, sheet)
    reach = _CLIPPING_SIGMAS * np.sqrt(variance)
    return np.asarray((mean < reach) | (mean + reach > sheet.saturation_dn))


def _clipped_noise(photo: Array, sheet: DataSheet) -> Array:
    """Standard deviation (n,), converter's DN, of numbers clipped to its range (moments of the rectified Gaussian)."""
    from scipy.special import ndtr

    mean, variance = _unclipped(photo, sheet)
    sigma = np.sqrt(variance)
    # Squares of far limits would be multiplied by a probability of 0: infinity times zero.
    a, b = (np.clip((limit - mean) / sigma, -40, 40) for limit in (0.0, sheet.saturation_dn))
    pdf_a, pdf_b = (np.exp(-z * z / 2) / np.sqrt(2 * np.pi) for z in (a, b))
    below, above = ndtr(a), ndtr(-b)
    first = pdf_a - pdf_b + a * below + b * above
    second = 1 - below - above + a * pdf_a - b * pdf_b + a * a * below + b * b * above
    return np.asarray(np.sqrt(np.maximum(second - first * first, 0.0)) * sigma)


def _curved_noise(photo: Array, sheet: DataSheet) -> Array:
    """Standard deviation (n,), in the file's DN, through a curve: over the quantiles of each pixel's numbers."""
    from scipy.special import ndtri

    quantiles = ndtri((np.arange(_QUANTILES) + 0.5) / _QUANTILES)
    quantiles /= np.sqrt(np.mean(quantiles**2))
    mean, variance = _unclipped(photo, sheet)
    numbers = np.clip(mean[:, None] + np.sqrt(variance)[:, None] * quantiles, 0.0, sheet.saturation_dn)
    spread = np.var(delivered_levels(numbers, sheet), axis=1)
    # Values that always clip to the same number have no rounding error either.
    return np.asarray(np.sqrt(spread + np.minimum(spread, QUANTISATION_VARIANCE_DN2 * 4.0**sheet.stored_shift)))


def _tabled(function: Callable[[Array, DataSheet], Array], photo: Array, sheet: DataSheet) -> Array:
    """Tabulate a function of the photo electrons (n,) once and interpolate for many pixels."""
    if photo.size <= _KNOTS:
        return function(photo, sheet)
    # Knots are even in the root of the electrons, like shot noise. Above a hundred full wells nothing changes.
    root = np.sqrt(np.minimum(photo, 100 * sheet.full_well_e))
    knots = np.linspace(root.min(), root.max(), _KNOTS)
    return np.asarray(np.interp(root, knots, function(knots**2, sheet)))


def noise_dn(radiance: ArrayLike, exposure_e: float, sheet: DataSheet) -> Array:
    """Standard deviation (...), in the file's DN, of pixels of this radiance (...).

    Includes shot, dark and read noise, fixed pattern, quantisation, the reduction by clipping, and the slope of the
    curve and of a processor's tone curve. For a colour image it is that of the mosaic's pixel, before white balance and
    interpolation. A processor's denoising and sharpening are not included, as they add no information about an edge;
    nor is compression. Rounding counts as independent noise, which holds above a third of a DN; below, it is the RMS
    error.
    """
    photo = np.asarray(radiance, dtype=np.float64) * exposure_e
    flat = photo.ravel()
    if sheet.developed:
        return _tabled(_curved_noise, flat, sheet).reshape(photo.shape)
    clips = _clips(np.linspace(flat.min(), flat.max(), 64), sheet).any()
    sigma = np.sqrt(_unclipped(flat, sheet)[1])
    if clips:
        near = _clips(flat, sheet)
        sigma[near] = _tabled(_clipped_noise, flat[near], sheet)
    return sigma.reshape(photo.shape) * 2.0**sheet.stored_shift


def expected_dn(radiance: ArrayLike, exposure_e: float, sheet: DataSheet, balance: Array | None = None) -> Array:
    """Level (...), in the file's DN, of pixels of this radiance (...) without noise and rounding."""
    electrons = np.asarray(radiance, dtype=np.float64) * exposure_e + sheet.dark_e
    numbers = np.minimum(electrons * sheet.gain_dn_per_e + sheet.black_level_dn, sheet.saturation_dn)
    return delivered_levels(numbers, sheet, balance)


def edge_photometry(
    radiance: NDArray[np.float32],
    coverage: NDArray[np.float32],
    exposure_e: float,
    sheet: DataSheet,
    balance: Array | None = None,
) -> dict[str, float | None]:
    """Contrast and noise at a marker's edge, from the radiance on both sides of it.

    Returns
    -------
    dict
        `edge_contrast_dn`: absolute difference of the mean levels within 4 px inside and outside the edge, for a colour
        image the mean of its channels; `edge_noise_dn`: RMS of the noise at these two levels. Both are those after the
        tone curve and before denoising and sharpening (`noise_dn`). `edge_inside_e`, `edge_outside_e`: mean electrons
        of the two sides, dark signal included, without clipping. None if a side is not in the image.
    """
    from scipy.ndimage import binary_dilation

    names = ("edge_contrast_dn", "edge_noise_dn", "edge_inside_e", "edge_outside_e")
    nothing: dict[str, float | None] = dict.fromkeys(names)
    edge = (coverage > 0) & (coverage < 1)
    if not edge.any():
        return nothing
    rows, columns = np.nonzero(edge)
    # Only the marker's neighbourhood is used; the whole frame would cost as much as rendering it. It begins at even
    # rows and columns, so that the mosaic's phase is unchanged.
    margin = _SIDE_PX + 1
    top, left = (max(int(i.min()) - margin, 0) // 2 * 2 for i in (rows, columns))
    window = slice(top, rows.max() + margin + 1), slice(left, columns.max() + margin + 1)
    near = binary_dilation(edge[window], iterations=_SIDE_PX)
    values = radiance[window].astype(np.float64)
    colour = filters(sheet.mosaic, values.shape) if sheet.colour else None
    levels, noises, electrons = [], [], []
    for side in (near & (coverage[window] >= 1), near & (coverage[window] <= 0)):
        channels = [side] if colour is None else [side & (colour == channel) for channel in range(3)]
        if not all(channel.any() for channel in channels):
            return nothing
        means = np.array([values[channel].mean() for channel in channels])
        expected = expected_dn(means, exposure_e, sheet, balance)
        if sheet.colour and sheet.isp is not None:
            top = (2**sheet.bits - 1) * 2.0**sheet.stored_shift
            expected = saturated(expected / top, sheet.isp) * top
        levels.append(float(expected.mean()))
        electrons.append(float(means.mean() * exposure_e + sheet.dark_e))
        noises.append(float(np.sqrt(np.mean(noise_dn(means, exposure_e, sheet) ** 2))))
    return {
        "edge_contrast_dn": abs(levels[0] - levels[1]),
        "edge_noise_dn": float(np.hypot(noises[0], noises[1]) / np.sqrt(2)),
        "edge_inside_e": electrons[0],
        "edge_outside_e": electrons[1],
    }
