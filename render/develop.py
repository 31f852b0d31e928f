"""Radiance to digital numbers: exposure, shot noise, read noise, saturation, quantisation (EMVA 1288, linear model)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera import project
from roundel.scenes.frame import Frame
from roundel.scenes.pose import transform_points
from roundel.scenes.sensor_section import SensorSection

# White is where 1 % of the sheet is brighter still.
_WHITE_QUANTILE = 0.99
_METERED_SIDE = 64

_QUANTISATION_VARIANCE_DN2 = 1.0 / 12.0


def metered(frame: Frame, radiance: NDArray[np.float32]) -> NDArray[np.float64]:
    """Radiance at points spread over the sheet: what the exposure is measured on.

    The whole frame would not do: a far sheet is a thousandth of it, and would be burnt out for the sake of the wall.
    """
    (x0, y0), (x1, y1) = frame.sheet.low_m, frame.sheet.high_m
    steps = (np.arange(_METERED_SIDE) + 0.5) / _METERED_SIDE
    x, y = (a.ravel() for a in np.meshgrid(x0 + (x1 - x0) * steps, y0 + (y1 - y0) * steps))
    px = project(frame.camera, transform_points(frame.camera_from_sheet, np.column_stack([x, y, np.zeros_like(x)])))
    height, width = radiance.shape
    seen = np.all((px >= -0.5) & (px < [width - 0.5, height - 0.5]), axis=1)
    columns, rows = np.rint(px[seen]).astype(np.int64).T
    return np.asarray(radiance[rows, columns], dtype=np.float64)


def exposure_of(levels: NDArray[np.float64], sensor: SensorSection) -> float:
    """Electrons that a radiance of 1 collects in a pixel: fixed, or set by the white of the metered levels."""
    if sensor.exposure_e is not None:
        return float(sensor.exposure_e)
    white = float(np.quantile(levels, _WHITE_QUANTILE)) if len(levels) else 0.0
    return float(sensor.white_level * sensor.full_well_e / white) if white > 0 else 0.0


def gain_dn_per_e(sensor: SensorSection) -> float:
    """Digital numbers an electron: the full well fills the range."""
    return float((2**sensor.bits - 1) / sensor.full_well_e)


def develop(radiance: NDArray[np.float32], exposure_e: float, sensor: SensorSection, noise_seed: int) -> NDArray[Any]:
    """An image (H, W), uint8 or uint16, from linear radiance.

    Parameters
    ----------
    radiance : (H, W) array
    exposure_e : float
        Electrons for a radiance of 1.
    sensor : SensorSection
    noise_seed : int
        The frame's own; the same seed gives the same noise.
    """
    generator = np.random.Generator(np.random.PCG64(noise_seed))
    electrons = radiance.astype(np.float64) * exposure_e
    if sensor.shot_noise:
        # numpy refuses means near 2^63; a pixel that bright is saturated whatever its noise.
        electrons = generator.poisson(np.minimum(electrons, 1e15)).astype(np.float64)
    if sensor.read_noise_e > 0:
        electrons = electrons + generator.normal(0.0, sensor.read_noise_e, radiance.shape)
    top = 2**sensor.bits - 1
    numbers = np.clip(np.rint(np.minimum(electrons, sensor.full_well_e) * gain_dn_per_e(sensor)), 0, top)
    image: NDArray[Any] = numbers.astype(np.uint8 if sensor.bits == 8 else np.uint16)
    return image


def noise_dn(radiance: float, exposure_e: float, sensor: SensorSection) -> float:
    """Standard deviation of a pixel of this radiance, in DN, quantisation included (saturation not)."""
    shot_e2 = radiance * exposure_e if sensor.shot_noise else 0.0
    variance = (shot_e2 + sensor.read_noise_e**2) * gain_dn_per_e(sensor) ** 2
    return float(np.sqrt(variance + _QUANTISATION_VARIANCE_DN2))


def edge_photometry(
    radiance: NDArray[np.float32], coverage: NDArray[np.float32], exposure_e: float, sensor: SensorSection
) -> dict[str, float | None]:
    """Contrast and noise at a marker's edge, from the radiance on both sides of it.

    Returns
    -------
    dict
        `edge_contrast_dn`: absolute difference of the mean levels within 4 px inside and outside the edge;
        `edge_noise_dn`: RMS of the noise at these two levels. None where a side is not in the image.
    """
    from scipy.ndimage import binary_dilation

    edge = (coverage > 0) & (coverage < 1)
    if not edge.any():
        return {"edge_contrast_dn": None, "edge_noise_dn": None}
    rows, columns = np.nonzero(edge)
    # Only the marker's neighbourhood matters; the whole frame would cost as much as rendering it.
    window = (
        slice(max(rows.min() - 5, 0), rows.max() + 6),
        slice(max(columns.min() - 5, 0), columns.max() + 6),
    )
    near = binary_dilation(edge[window], iterations=4)
    inside, outside = near & (coverage[window] >= 1), near & (coverage[window] <= 0)
    if not inside.any() or not outside.any():
        return {"edge_contrast_dn": None, "edge_noise_dn": None}
    values = radiance[window].astype(np.float64)
    a, b = float(values[inside].mean()), float(values[outside].mean())
    full_well = sensor.full_well_e
    levels = [min(v * exposure_e, full_well) * gain_dn_per_e(sensor) for v in (a, b)]
    noise = [noise_dn(v, exposure_e, sensor) for v in (a, b)]
    return {
        "edge_contrast_dn": abs(levels[0] - levels[1]),
        "edge_noise_dn": float(np.hypot(noise[0], noise[1]) / np.sqrt(2)),
    }
