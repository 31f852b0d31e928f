"""The sensor measured by EMVA 1288: its images reproduce the values of its data sheet."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers_studies import small_study

from roundel.render.sensor.curve import delivered
from roundel.render.sensor.data_sheet import DataSheet, data_sheet
from roundel.render.sensor.develop import develop
from roundel.render.sensor.photometry import expected_dn, noise_dn, temporal_variance_dn2
from roundel.render.sensor.sensor import expose
from roundel.scenes.study.sensor_section import SensorSection
from roundel.scenes.world.frame import frame_of

EXPOSURE_S = 0.02


def sheet_of(**keys) -> DataSheet:
    return data_sheet(SensorSection(**keys), EXPOSURE_S)


def flat(level: float, side: int = 400) -> np.ndarray:
    return np.full((side, side), level, dtype=np.float32)


def test_photon_transfer_gives_back_gain_and_read_noise(tmp_path: Path) -> None:
    """EMVA 1288: the temporal variance is half that of the difference of two frames of the same radiance.

    262,144 pixels give a variance to sqrt(2 / 262144) = 0.28 %, and 25 of them the slope to some 0.1 %, the dark noise
    to 0.14 %: the 2 % that are asked for lie 14 standard errors away. With K = 0.4 DN/e and 12 e, rounding is a
    variance of 0.08 DN^2 beside 24: it matters to the read noise by 0.2 %, and is taken off.
    """
    gain, read_e, dark_e_s, prnu, dsnu_e = 0.4, 12.0, 500.0, 0.01, 4.0
    study = small_study(
        tmp_path,
        ("width_px: 160, height_px: 120", "width_px: 512, height_px: 512"),
        (
            "frames: 4",
            f"frames: 1\nmotion: {{exposure_s: {EXPOSURE_S}}}\nsensor: {{bits: 12, gain_dn_per_e: {gain}, "
            f"full_well_e: 10000, read_noise_e: {read_e}, dark_current_e_s: {dark_e_s}, black_level_dn: 100, "
            f"exposure_e: 7000, prnu: {prnu}, dsnu_e: {dsnu_e}}}",
        ),
    )
    frame = frame_of(study, 0)

    def pair(level: float) -> tuple[np.ndarray, np.ndarray]:
        radiance = np.full((512, 512), level, dtype=np.float32)
        return tuple(
            (develop(replace(frame, noise_seed=seed), radiance).image >> 4).astype(np.float64) for seed in (1, 2)
        )

    # From dark to 70 % of the full well, as the standard fits the line.
    pairs = [pair(level) for level in np.linspace(0.0, 1.0, 25)]
    mean = np.array([(a.mean() + b.mean()) / 2 for a, b in pairs])
    variance = np.array([np.var(a - b) / 2 for a, b in pairs])
    slope, _ = np.polyfit(mean, variance, 1, w=1 / variance)
    assert slope == pytest.approx(gain, rel=0.02)
    # The dark signal's own shot noise, 10 electrons, is part of the dark noise.
    dark_e = np.sqrt(variance[0] - 1 / 12) / slope
    assert np.sqrt(dark_e**2 - dark_e_s * EXPOSURE_S) == pytest.approx(read_e, rel=0.02)
    assert mean[0] == pytest.approx(100 + gain * dark_e_s * EXPOSURE_S, abs=0.1)

    # Fixed patterns: the spatial variance of two frames' mean, less half the temporal one (EMVA 1288, section 8).
    # One sensor's 262,144 pixels: a standard deviation to 0.14 %; in the dark the noise is four times the pattern: 3 %.
    def spatial(a: np.ndarray, b: np.ndarray) -> float:
        return float(np.var((a + b) / 2) - np.var(a - b) / 4)

    dark, bright = spatial(*pairs[0]), spatial(*pairs[-1])
    assert np.sqrt(dark) / slope == pytest.approx(dsnu_e, rel=0.1)
    assert np.sqrt(bright - dark) / (mean[-1] - mean[0]) == pytest.approx(prnu, rel=0.05)


@pytest.mark.parametrize("level", [0.02, 0.5, 0.97, 1.0])
@pytest.mark.parametrize(
    "keys",
    [
        {"full_well_e": 8000},
        {"full_well_e": 8000, "bits": 16, "read_noise_e": 30.0},
        {"full_well_e": 8000, "bits": 10, "prnu": 0.02, "dsnu_e": 20.0, "black_level_dn": 60},
        {"full_well_e": 8000, "bits": 12, "gain_dn_per_e": 0.1, "dark_current_e_s": 5000},
        {"full_well_e": 8000, "curve": "srgb"},
        {"full_well_e": 8000, "curve": "gamma", "bits": 12},
    ],
    ids=["8bit", "16bit", "patterns", "low gain", "srgb", "gamma"],
)
def test_an_image_has_the_noise_and_the_level_that_are_recorded(keys, level: float) -> None:
    sheet = sheet_of(**keys)
    radiance = flat(level)
    image = delivered(expose(radiance, 8000.0, sheet, 7, 8), sheet)
    sigma = float(noise_dn(level, 8000.0, sheet))
    # 160,000 pixels: the standard deviation to 0.18 %, four of them. Poisson numbers are a little skew, which shows
    # where they clip or a curve bends them: 3 %. Half a DN of noise is not quite blind to the rounding: 5 %.
    loose = 0.05 if sigma < 0.6 else 0.03 if sheet.developed or level >= 0.97 or level < 0.1 else 0.0075
    assert image.std() == pytest.approx(sigma, rel=loose)
    if level <= 0.5:
        # Of a curve the mean of the noise is not the noise's mean: some percent of a standard deviation.
        shift = 0.1 if sheet.developed else 4 / 400
        assert image.mean() == pytest.approx(float(expected_dn(level, 8000.0, sheet)), abs=shift * sigma)


def test_without_noise_a_pixel_is_its_rounded_mean() -> None:
    sheet = sheet_of(shot_noise=False, read_noise_e=0, full_well_e=10_000)
    ramp = np.linspace(0, 2, 1000, dtype=np.float32)[None]
    expected = np.minimum(np.rint(ramp.astype(np.float64) * 255), 255)
    np.testing.assert_array_equal(expose(ramp, 10_000.0, sheet, 1, 1), expected)


def test_a_well_that_is_full_stays_full() -> None:
    full = sheet_of(full_well_e=1000)
    assert (expose(flat(100), 1000.0, full, 0, 0) == 255).all()
    assert (expose(flat(1e30), 1000.0, full, 0, 0) == 255).all()
    # Where the gain leaves room above it, the well decides; below black, the converter.
    low = sheet_of(full_well_e=1000, gain_dn_per_e=0.1, black_level_dn=3, read_noise_e=0)
    assert low.saturation_dn == 103
    assert (expose(flat(100), 1000.0, low, 0, 0) == 103).all()
    assert (expose(flat(0), 1000.0, low, 0, 0) == 3).all()
    dark = expose(flat(0), 1000.0, sheet_of(full_well_e=1000, read_noise_e=50), 0, 0)
    assert dark.min() == 0
    assert dark.max() > 20


def test_seeds_decide_noise_and_patterns() -> None:
    sheet = sheet_of(prnu=0.05, dsnu_e=30, bits=16)
    quiet = replace(sheet, shot_noise=False, read_noise_e=0.0)
    one = expose(flat(0.5), 5e3, sheet, 3, 4)
    np.testing.assert_array_equal(one, expose(flat(0.5), 5e3, sheet, 3, 4))
    assert (one != expose(flat(0.5), 5e3, sheet, 5, 4)).mean() > 0.9
    # The pattern is the sensor's, not the frame's.
    np.testing.assert_array_equal(expose(flat(0.5), 5e3, quiet, 3, 4), expose(flat(0.5), 5e3, quiet, 5, 4))
    assert (expose(flat(0.5), 5e3, quiet, 3, 4) != expose(flat(0.5), 5e3, quiet, 3, 5)).mean() > 0.9
    # Levels of a swept noise are paired: twice the read noise is the same noise, twice.
    plain = sheet_of(shot_noise=False, read_noise_e=20, bits=16, black_level_dn=4000)
    once, twice = (expose(flat(0.5), 5e3, s, 3, 4).astype(int) for s in (plain, replace(plain, read_noise_e=40.0)))
    middle = round(0.5 * 5e3 * plain.gain_dn_per_e + 4000)
    assert np.abs((twice - middle) - 2 * (once - middle)).max() <= 2


def test_dark_current_is_collected_over_the_exposure() -> None:
    sheet = sheet_of(dark_current_e_s=1000)
    assert sheet.dark_e == pytest.approx(20)
    quiet = replace(sheet, shot_noise=False, read_noise_e=0.0, gain_dn_per_e=1.0)
    assert (expose(flat(0), 1e4, quiet, 0, 0) == 20).all()
    assert float(temporal_variance_dn2(20.0, sheet)) == pytest.approx((20 + 25) * sheet.gain_dn_per_e**2 + 1 / 12)


def test_more_bits_of_the_converter_do_not_change_the_exposure() -> None:
    plain = sheet_of(gain_dn_per_e=0.02, black_level_dn=10)
    curved = sheet_of(gain_dn_per_e=0.02, black_level_dn=10, curve="gamma", gamma=1.0)
    assert (plain.adc_bits, curved.adc_bits) == (8, 12)
    assert curved.black_level_dn == pytest.approx(10 * 4095 / 255)
    # What is developed has its black level taken off, and its range filled again.
    level = float(expected_dn(0.5, 1e4, plain))
    assert level == pytest.approx(110)
    assert float(expected_dn(0.5, 1e4, curved)) == pytest.approx((level - 10) * 255 / 245)


def test_clipping_takes_noise_away() -> None:
    sheet = sheet_of(full_well_e=8000, read_noise_e=40, bits=16)
    free = float(np.sqrt(temporal_variance_dn2(8000.0, sheet)))
    # Half of a Gaussian, clipped at its mean: variance (1 - 1/pi) / 2 of the whole.
    assert float(noise_dn(1.0, 8000.0, sheet)) == pytest.approx(free * np.sqrt((1 - 1 / np.pi) / 2), rel=1e-6)
    assert float(noise_dn(3.0, 8000.0, sheet)) == pytest.approx(0.0, abs=1e-6)
    assert float(noise_dn(1e30, 8000.0, sheet)) == 0.0
