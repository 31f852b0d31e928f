"""Noise by level, against the renderer's own; and JPEG's, against files that a library compressed."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import gaussian_filter
from scipy.special import ndtr

from roundel.render.sensor.data_sheet import data_sheet
from roundel.render.sensor.demosaic import demosaic
from roundel.render.sensor.photometry import expected_dn, noise_dn
from roundel.scenes.study.sensor_section import SensorSection
from roundel.validate.metrics.jpeg_noise import jpeg_variance_dn2, luma_table
from roundel.validate.metrics.level_noise import encoded_dn, level_variance, saturation_e
from roundel.validate.metrics.mosaic_noise import mosaic_variance

ELECTRONS = np.array([500.0, 2000.0, 5000.0, 8000.0])


@pytest.mark.parametrize(
    "keys",
    [
        {},
        {"read_noise_e": 20, "black_level_dn": 8, "prnu": 0.01, "dsnu_e": 6},
        {"shot_noise": False, "bits": 10},
        {"curve": "srgb"},
        {"curve": "gamma", "gamma": 2.0},
        {"mosaic": "rggb"},
        {"gain_dn_per_e": 0.02},
    ],
)
def test_it_is_the_noise_of_the_renderer(keys) -> None:
    sheet = data_sheet(SensorSection.model_validate(keys), 0.01)
    record = sheet.record()
    radiance = ELECTRONS / 10_000.0
    # The level in electrons and its slope, in numbers of the file.
    delivered = expected_dn(radiance, 10_000.0, sheet)
    if sheet.developed:  # without the black level
        np.testing.assert_allclose(encoded_dn(record, ELECTRONS), delivered, rtol=1e-9)
    tiny = 1e-4
    slope = (expected_dn(radiance + tiny, 10_000.0, sheet) - expected_dn(radiance - tiny, 10_000.0, sheet)) / (
        2e4 * tiny
    )
    # An edge without contrast has no pattern of the mosaic.
    sigma = np.sqrt(level_variance(record, (500.0, 500.0), 0.5, None)(ELECTRONS)) * slope
    # The renderer takes a curve at 64 quantiles of the noise; here it is straight within the noise.
    np.testing.assert_allclose(sigma, noise_dn(radiance, 10_000.0, sheet), rtol=0.02 if sheet.developed else 1e-6)
    assert saturation_e(record) * record["gain_dn_per_e"] + record["black_level_dn"] == pytest.approx(
        sheet.saturation_dn, abs=0.5
    )


def test_fine_steps_add_the_rounding_of_each_coefficient() -> None:
    # Steps below the noise: uniform errors, one a coefficient. Over some 11,000 pixels their product with the noise,
    # of 3 * sqrt(1/3), has a mean of some 0.03.
    table = np.full((8, 8), 2.0)
    assert jpeg_variance_dn2(table, (60.0, 200.0), (3.0, 3.0), 1.0) == pytest.approx(4 / 12, rel=0.2)


@pytest.mark.parametrize(("quality", "noise"), [(95, 1.5), (85, 1.5), (75, 3.0), (60, 1.5)])
def test_it_is_the_error_of_compressed_files(tmp_path, quality, noise) -> None:
    y, x = np.mgrid[:256, :256]
    distance = np.hypot(x - 127.3, y - 126.8) - 90.2
    clean = 60.0 + 140.0 * gaussian_filter(np.clip(distance + 0.5, 0, 1), 1.0)
    noisy = clean + np.random.default_rng(1).normal(0, noise, clean.shape)
    buffer = io.BytesIO()
    Image.fromarray(np.clip(np.rint(noisy), 0, 255).astype(np.uint8)).save(buffer, "JPEG", quality=quality)
    (tmp_path / "edge.jpg").write_bytes(buffer.getvalue())
    decoded = np.asarray(Image.open(tmp_path / "edge.jpg"), dtype=np.float64)
    near = np.abs(distance) < 3.0
    table = luma_table((tmp_path / "edge.jpg").read_bytes())
    assert table is not None
    predicted = noise**2 + jpeg_variance_dn2(table, (60.0, 200.0), (noise, noise), 1.04)
    # The rounding of the file to whole numbers, before and after, is 1/6 of the variance at most.
    assert np.mean((decoded - clean)[near] ** 2) == pytest.approx(predicted, rel=0.2)


def test_a_png_has_no_table(tmp_path) -> None:
    Image.new("L", (8, 8)).save(tmp_path / "plain.png")
    assert luma_table((tmp_path / "plain.png").read_bytes()) is None


@pytest.mark.parametrize("blur_px", [0.4, 1.0])
def test_the_pattern_of_a_mosaic_is_that_of_the_renderer(blur_px) -> None:
    y, x = np.mgrid[:200, :200]
    distance = np.hypot(x - 99.6, y - 100.3) - 70.0
    clean = ndtr(distance / blur_px)
    # The mean over the four phases of the cell, at the same pixels of the scene.
    phases = [demosaic(clean, name).mean(axis=2) for name in ("rggb", "grbg", "gbrg", "bggr")]
    pattern = phases[0] - np.mean(phases, axis=0)
    near = np.abs(distance) < 3.0
    # An edge of 440 px samples places and directions as finely as the patches do.
    assert np.mean(pattern[near] ** 2) == pytest.approx(mosaic_variance(blur_px), rel=0.1)
