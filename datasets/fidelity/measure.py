"""Fidelity: difference between the rendered image of a circle and its float64 prediction.

The radiance around a circle is modelled by weighted linear least squares as

    Y = E(x, y) (P + shift . dP + growth dP),

where P is the predicted pattern of the print and E a quadratic (smooth light; one quadratic per colour if pixels have
colour filters). The fitted shift and growth are the bias of the edge. Without them, the residual of each pixel is
compared with its own Monte-Carlo error: a t-test with Sidak's correction, and a chi-square test of all pixels together.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from scipy.optimize import nnls

from roundel.datasets.fidelity.pixel_test import pixel_test
from roundel.datasets.fidelity.prediction import Prediction, common_window, is_sharp, predict, window_of
from roundel.datasets.fidelity.selection import effect_of, is_sampled, obstacle
from roundel.scenes.camera.model import camera_of_colour
from roundel.scenes.study.sensor_section import filters_of
from roundel.scenes.world.frame import Frame

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Pixels this far beyond the blurred edge are included: they determine light and reflectances.
_BAND_PX = 2

# Coverage at which a blurred edge begins and ends: the Airy pattern's tail would extend it over the whole image.
_EDGE, _ROUNDING = 0.01, 1e-9

# Least coverage of tested pixels: if the edge only grazes a pixel, few rays hit it and the error is not Gaussian.
_TESTED = 0.05

# Fewer pixels than this cannot separate a shift from a change of light.
_FEWEST = 40

# Error of the prediction itself, as a fraction of the contrast: its nodes are chosen for it, and tests confirm it.
_PREDICTION_ERROR = 1e-3

# Eight replicates of few rays may agree by chance: the variance is at least this fraction of the model's.
_LEAST_VARIANCE = 0.25

# In a world, a mean of (residual / noise)^2 above this shows light that no quadratic describes.
_SMOOTH_LIGHT = 1.6

# Contrast, in units of radiance, at or below which no light falls on the circle.
_DARK = 1e-9


@dataclass(frozen=True)
class _Band:
    """The pixels that are compared: position, rendered value, and the colour (0, 1, 2) of each pixel's filter."""

    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    observed: Array
    variance: Array
    colour: NDArray[np.int64]


def measure_circle(
    frame: Frame, marker_id: int, radiance: NDArray[np.float32], variance: NDArray[np.float32]
) -> dict[str, Any]:
    """Compare one rendered circle with its prediction.

    Parameters
    ----------
    frame : Frame
    marker_id : int
        Identifier of a circular part.
    radiance, variance : (H, W) arrays
        Linear radiance and the variance of its Monte-Carlo estimate.

    Returns
    -------
    dict
        `effect`: what blurs or bends the edge; `shift_x_px`, `shift_y_px`: displacement of the rendered edge from the
        predicted one; `scale_px`: how much larger it is, along the normal; `shift_se_px`: standard error of a shift;
        `residual`: RMS residual in the band, `monte_carlo`: RMS that the recorded variance predicts, both as fractions
        of the edge's contrast; `pixels`; and `z_...`, see `pixel_test`. If there is nothing to compare,
        `{"reason": ...}`.
    """
    reason = obstacle(frame, marker_id)
    if reason is None and not is_sampled(frame, marker_id):
        reason = "not in the sample of blurred frames"
    if reason is not None:
        return {"reason": reason}
    try:
        predictions = _predictions(frame, marker_id)
    except ValueError as error:
        return {"reason": str(error)}
    if predictions[0].step == 0:
        return {"reason": "ink and paper have the same reflectance"}
    if frame.sheet.clutter is not None and any(seen.border for seen in predictions):
        return {"reason": "clutter on the wall is visible at its edge"}
    if frame.on_wall:
        return compare(frame, predictions, radiance, variance)
    found = compare(frame, predictions, radiance, variance)
    # The fit has its shift and growth: what is left is no error of the edge but light that is not smooth.
    if found.get("chi2_left", 0.0) > _SMOOTH_LIGHT:
        return {"reason": "the edge of a shadow or a highlight crosses it"}
    return found


def _colour_of(frame: Frame, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> NDArray[np.int64]:
    mosaic = frame.settings.sensor.mosaic
    if mosaic == "none":
        return np.zeros(len(rows), dtype=np.int64)
    cell = np.array(filters_of(mosaic))
    return np.asarray(cell[2 * (rows % 2) + columns % 2], dtype=np.int64)


def _predictions(frame: Frame, marker_id: int) -> list[Prediction]:
    """One prediction for all pixels, or one per colour if diffraction or magnification depend on the colour."""
    part = next(p for p in frame.sheet.parts if p.marker_id == marker_id)
    camera = frame.camera
    diffracts = len(camera.wavelengths_m) == 3
    if frame.settings.sensor.mosaic == "none" or not (diffracts or camera.magnification):
        return [predict(frame, part)]
    seen = []
    for i in range(3):
        own = camera_of_colour(camera, i)
        seen.append(
            replace(frame, camera=replace(own, wavelengths_m=own.wavelengths_m[i : i + 1]) if diffracts else own)
        )
    window = common_window([window_of(one, part) for one in seen])
    return [predict(one, part, window) for one in seen]


def _band_of(frame: Frame, predictions: list[Prediction], radiance: Any, variance: Any) -> _Band | str:
    """The pixels to compare; a reason if the image border cuts them off."""
    seen = predictions[0]
    low = _ROUNDING if is_sharp(frame) else _EDGE
    edge = np.any([(p.coverage > low) & (p.coverage < 1 - low) for p in predictions], axis=0)
    wide = np.pad(edge, _BAND_PX)
    wide = binary_dilation(wide, structure=np.ones((3, 3), dtype=bool), iterations=_BAND_PX)
    window = np.zeros_like(wide)
    window[_BAND_PX:-_BAND_PX, _BAND_PX:-_BAND_PX] = True
    if not frame.on_wall:
        # What lies beyond the sheet's border is not predicted.
        on_sheet = np.min([p.on_sheet for p in predictions], axis=0)
        window[_BAND_PX:-_BAND_PX, _BAND_PX:-_BAND_PX] = on_sheet > 1 - low
    rows, columns = np.nonzero(wide & window)
    rows, columns = rows - _BAND_PX + seen.row0, columns - _BAND_PX + seen.col0
    height, width = frame.camera.height_px, frame.camera.width_px
    if len(rows) == 0:
        return "smaller than a pixel"
    if rows.min() < 0 or columns.min() < 0 or rows.max() >= height or columns.max() >= width:
        return "cut off by the image border"
    observed, spread = (np.asarray(a)[rows, columns].astype(np.float64) for a in (radiance, variance))
    return _Band(rows, columns, observed, spread, _colour_of(frame, rows, columns))


def _pick(predictions: list[Prediction], band: _Band, name: str) -> Array:
    """One plane of the prediction at the pixels of the band, each by its colour."""
    out = np.empty(len(band.rows))
    for colour in np.unique(band.colour):
        seen = predictions[colour if len(predictions) > 1 else 0]
        which = band.colour == colour
        out[which] = getattr(seen, name)[band.rows[which] - seen.row0, band.columns[which] - seen.col0]
    return out


def _light(predictions: list[Prediction], band: _Band) -> tuple[Array, Array]:
    """Smooth light: 1, u, v, u^2, u v, v^2 per colour, (n, 6 per colour); and the same modulated by the print."""
    half = max(np.ptp(band.rows), np.ptp(band.columns)) / 2
    u, v = ((a - (a.max() + a.min()) / 2) / half for a in (band.columns, band.rows))
    one, none = np.ones_like(u), np.zeros_like(u)
    light = np.stack([one, u, v, u * u, u * v, v * v], axis=1)
    slope_u = np.stack([none, one, none, 2 * u, v, none], axis=1) / half
    slope_v = np.stack([none, none, one, none, u, 2 * v], axis=1) / half
    pattern, dx, dy = (_pick(predictions, band, name)[:, None] for name in ("pattern", "drift_x", "drift_y"))
    seen = light * pattern + slope_u * dx + slope_v * dy
    masks = [(band.colour == colour)[:, None] for colour in np.unique(band.colour)]
    return np.concatenate([light * m for m in masks], axis=1), np.concatenate([seen * m for m in masks], axis=1)


def _solve(design: Array, observed: Array, weight: Array) -> Array:
    root = np.sqrt(weight)
    # Scale columns to a common norm: a dark channel must not degrade the conditioning of the others.
    size = np.maximum(np.linalg.norm(design * root[:, None], axis=0), 1e-300)
    solution, *_ = np.linalg.lstsq(design * root[:, None] / size, observed * root, rcond=1e-12)
    return np.asarray(solution / size, dtype=np.float64)


def _standard_error(design: Array, weight: Array, left: Array) -> Array:
    """Standard errors (k,) of a weighted fit from its residuals (n,), whatever the true variances are.

    White's estimator (H. White 1980): wrong weights, as in flat light where most pixels have no noise at all, reduce
    the precision but do not bias the standard error.
    """
    size = np.maximum(np.linalg.norm(design, axis=0), 1e-300)
    scaled = design / size
    inverse = np.linalg.pinv((scaled * weight[:, None]).T @ scaled)
    pulls = scaled * (weight * left)[:, None]
    return np.asarray(np.sqrt(np.maximum(np.diag(inverse @ (pulls.T @ pulls) @ inverse), 0.0)) / size)


def _smooth_variance(band: _Band, light: Array, coverage: Array) -> Array:
    """Variance of pixels modelled by light and edge; a pixel's own estimate, from 8 replicates, is too noisy."""
    power = light**2 / max(float(np.mean(light**2)), 1e-300)
    terms = np.stack([np.ones_like(coverage), power, 4 * coverage * (1 - coverage)], axis=1)
    scale = max(float(band.variance.max()), 1e-300)
    parts, _ = nnls(terms, band.variance / scale)
    model = terms @ parts * scale
    # An edge pixel with noise-free neighbours must keep some weight.
    return np.asarray(np.maximum(model, 0.02 * model.max()), dtype=np.float64)


def compare(
    frame: Frame, predictions: list[Prediction], radiance: NDArray[np.float32], variance: NDArray[np.float32]
) -> dict[str, Any]:
    """Result of `measure_circle`, from predictions (one, or one per colour)."""
    found = _band_of(frame, predictions, radiance, variance)
    if isinstance(found, str):
        return {"reason": found}
    band = found
    coverage = _pick(predictions, band, "coverage")
    tested = (coverage > _TESTED) & (coverage < 1 - _TESTED)
    if np.count_nonzero(tested) < _FEWEST:
        return {"reason": "too few pixels at its edge"}
    if not np.all(np.isfinite(band.observed)) or not np.all(np.isfinite(band.variance)):
        return {"reason": "its radiance is not finite"}
    light, seen = _light(predictions, band)
    start = _solve(seen, band.observed, np.ones(len(band.observed)))
    height = abs(predictions[0].step) * float(np.abs(light @ start).mean())
    if not height > _DARK:
        return {"reason": "no light falls on it"}
    model = _smooth_variance(band, seen @ start, coverage)
    floor = (_PREDICTION_ERROR * height) ** 2
    weight = 1 / (model + floor)
    still = _solve(seen, band.observed, weight)
    slopes = [(light @ still) * _pick(predictions, band, name) for name in ("shift_x", "shift_y", "growth")]
    design = np.column_stack([seen, *slopes])
    solution = _solve(design, band.observed, weight)
    left = band.observed - design @ solution
    error = _standard_error(design, weight, left)
    noise = np.maximum(band.variance, _LEAST_VARIANCE * model) + floor
    return {
        "effect": effect_of(frame),
        "shift_x_px": float(solution[-3]),
        "shift_y_px": float(solution[-2]),
        "scale_px": float(solution[-1]),
        "shift_se_px": float(error[-3:-1].max()),
        "residual": float(np.sqrt(np.mean(left**2))) / height,
        "monte_carlo": float(np.sqrt(np.mean(band.variance))) / height,
        "pixels": len(left),
        "chi2_left": float(np.mean(left**2 / noise)),
        **pixel_test((band.observed - seen @ still)[tested], noise[tested]),
    }
