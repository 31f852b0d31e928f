"""Radiance to digital numbers."""

import numpy as np
import pytest
from helpers_studies import small_study

from roundel.datasets.images import read_image
from roundel.render.develop import develop, edge_photometry, exposure_of, gain_dn_per_e, noise_dn
from roundel.render.run import render_study
from roundel.scenes.sensor_section import SensorSection

FLAT = np.full((400, 500), 0.5, dtype=np.float32)


def test_without_noise_a_pixel_is_its_rounded_mean() -> None:
    sensor = SensorSection(shot_noise=False, read_noise_e=0, full_well_e=10_000)
    ramp = np.linspace(0, 2, 1000, dtype=np.float32)[None]
    image = develop(ramp, 10_000.0, sensor, 1)
    np.testing.assert_array_equal(image, np.minimum(np.rint(ramp.astype(np.float64) * 255), 255).astype(np.uint8))


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("read_noise_e", [0.0, 30.0])
def test_noise_has_the_recorded_variance(bits: int, read_noise_e: float) -> None:
    sensor = SensorSection(read_noise_e=read_noise_e, full_well_e=8000, bits=bits)
    image = develop(FLAT, 9000.0, sensor, 7)
    expected_mean = 0.5 * 9000 * gain_dn_per_e(sensor)
    sigma = noise_dn(0.5, 9000.0, sensor)
    # 200,000 pixels: the mean to sigma / 447, the standard deviation to a relative 1 / 632; four of each.
    assert image.mean() == pytest.approx(expected_mean, abs=4 * sigma / 447)
    assert image.std() == pytest.approx(sigma, rel=4 / 632)


def test_a_well_that_is_full_stays_full() -> None:
    sensor = SensorSection(full_well_e=1000)
    assert (develop(FLAT * 100, 1000.0, sensor, 0) == 255).all()
    assert (develop(FLAT * 1e30, 1000.0, sensor, 0) == 255).all()
    assert (develop(FLAT * 0, 1000.0, SensorSection(read_noise_e=0), 0) == 0).all()


def test_the_same_seed_gives_the_same_noise() -> None:
    sensor = SensorSection()
    np.testing.assert_array_equal(develop(FLAT, 5e3, sensor, 3), develop(FLAT, 5e3, sensor, 3))
    assert (develop(FLAT, 5e3, sensor, 3) != develop(FLAT, 5e3, sensor, 4)).any()


def test_auto_exposure_puts_the_white_where_it_is_asked() -> None:
    sensor = SensorSection(white_level=0.6, full_well_e=10_000)
    levels = np.linspace(0, 1, 10_001)
    assert exposure_of(levels, sensor) * 0.99 == pytest.approx(6000, rel=1e-6)
    assert exposure_of(levels * 0, sensor) == 0.0
    assert exposure_of(levels, SensorSection(exposure_e=123.0)) == 123.0
    # A sheet out of view meters nothing.
    assert exposure_of(levels[:0], sensor) == 0.0


def test_edge_photometry_reads_both_sides_of_the_edge() -> None:
    y, x = np.mgrid[:80, :80]
    coverage = np.clip(20.5 - np.hypot(x - 40, y - 40), 0, 1).astype(np.float32)
    radiance = (0.8 - 0.7 * coverage).astype(np.float32)
    radiance[:5] = 3.0  # bright things far away do not matter
    sensor = SensorSection(full_well_e=10_000, read_noise_e=0)
    found = edge_photometry(radiance, coverage, 10_000.0, sensor)
    assert found["edge_contrast_dn"] == pytest.approx(0.7 * 255, rel=1e-5)
    rms = np.sqrt((noise_dn(0.1, 1e4, sensor) ** 2 + noise_dn(0.8, 1e4, sensor) ** 2) / 2)
    assert found["edge_noise_dn"] == pytest.approx(rms, rel=1e-5)
    nothing = edge_photometry(radiance, coverage * 0, 10_000.0, sensor)
    assert nothing == {"edge_contrast_dn": None, "edge_noise_dn": None}


def test_a_far_sheet_is_not_burnt_out(tmp_path) -> None:
    far = small_study(tmp_path, ("{uniform: [7, 9]}", "40"))
    render_study(far, tmp_path / "ds", frames=range(1))
    image = read_image(tmp_path / "ds" / "images" / "000000.png")
    assert 190 < image.max() < 230
