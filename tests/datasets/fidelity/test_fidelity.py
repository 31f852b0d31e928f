"""Measurement of fidelity: it finds planted errors and nothing else, and names what it cannot measure."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers_effects import CAMERA, EFFECTS, FLAT, motion
from helpers_images import coverage as ellipse_coverage
from helpers_studies import small_study

from roundel.datasets.fidelity.measure import compare, measure_circle
from roundel.datasets.fidelity.pixel_test import normal_scores, pixel_test
from roundel.datasets.fidelity.prediction import Prediction, predict
from roundel.datasets.fidelity.selection import SAMPLED_FRAMES, effect_of, is_sampled
from roundel.datasets.fidelity.summary import fidelity_lines, summarise
from roundel.datasets.layout.radiance import REPLICATES
from roundel.scenes.truth.truth import truth_of
from roundel.scenes.world.frame import Frame, frame_of, frames_of


@pytest.mark.parametrize("planted", [(0.0, 0.0, 0.0), (0.02, -0.01, 0.0), (0.5, 0.5, 0.0), (0.0, 0.0, 0.03)])
def test_a_planted_shift_is_found(tmp_path: Path, planted) -> None:
    frame = frame_of(small_study(tmp_path), 0)
    row = truth_of(frame)[0]
    ellipse = np.array([row[f"ellipse_{n}"] for n in ("x_px", "y_px", "a_px", "b_px", "angle_deg")])
    dx, dy, grow = planted
    coverage = ellipse_coverage(ellipse + np.array([dx, dy, grow, grow, 0]), 160, 120, subpixels=64)
    radiance = (0.8 - 0.75 * coverage).astype(np.float32)
    found = measure_circle(frame, 0, radiance, np.zeros_like(radiance))
    # Half a pixel is beyond the linear range of the measurement: it is seen, if not to the last digit.
    tolerance = 0.2 if dx == 0.5 else 0.001
    assert found["shift_x_px"] == pytest.approx(dx, abs=tolerance)
    assert found["shift_y_px"] == pytest.approx(dy, abs=tolerance)
    assert found["scale_px"] == pytest.approx(grow, abs=tolerance)


def image_of(frame: Frame, seen: Prediction, gradient: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """What a prediction says of the whole image under light that changes linearly; nothing outside its window."""
    shape = frame.camera.height_px, frame.camera.width_px
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    light = 1.0 + gradient[0] * (x - 80) + gradient[1] * (y - 60)
    out = np.full(shape, np.nan)
    h, w = seen.pattern.shape
    rows, columns = slice(seen.row0, seen.row0 + h), slice(seen.col0, seen.col0 + w)
    drift = gradient[0] * seen.drift_x + gradient[1] * seen.drift_y
    out[rows, columns] = light[rows, columns] * seen.pattern + drift
    return out


def replicates(rng, mean: np.ndarray, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """A noisy image as eight replicates would give it, and its estimated variance."""
    noise = sigma * np.sqrt(REPLICATES) * rng.standard_normal((REPLICATES, *mean.shape))
    return mean + noise.mean(axis=0), noise.var(axis=0, ddof=1) / REPLICATES


# Standard error of a pixel, where a white sheet has 0.8: what 1,024 rays leave of an edge blurred over some 4 px.
NAMES = ("sharp", "defocus", "motion")
NOISE = 0.004


@pytest.mark.parametrize("name", NAMES)
def test_a_right_image_passes_and_is_not_shifted(tmp_path: Path, name: str) -> None:
    frame = frame_of(small_study(tmp_path, *EFFECTS[name]), 0)
    seen = predict(frame, frame.sheet.parts[0])
    # Light that changes by a half over the image.
    mean, rng = image_of(frame, seen, (0.002, -0.003)), np.random.default_rng(1)
    found = [compare(frame, [seen], *replicates(rng, mean, NOISE)) for _ in range(60)]
    # One in a hundred fails by chance: three or more of sixty in 2 % of all cases; the seed is fixed.
    assert sum(not f["z_passed"] for f in found) <= 2
    for key in ("shift_x_px", "shift_y_px"):
        shifts = np.array([f[key] for f in found])
        assert abs(shifts.mean()) < 4 * shifts.std() / np.sqrt(60)
    # The standard error, of the less certain of the two, is the scatter that 60 repetitions show, to some 10 %.
    scatter = max(np.std([f[key] for f in found]) for key in ("shift_x_px", "shift_y_px"))
    assert scatter == pytest.approx(np.mean([f["shift_se_px"] for f in found]), rel=0.3)
    assert np.mean([f["residual"] / f["monte_carlo"] for f in found]) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("name", NAMES)
def test_a_displaced_edge_fails(tmp_path: Path, name: str) -> None:
    frame = frame_of(small_study(tmp_path, *EFFECTS[name]), 0)
    seen = predict(frame, frame.sheet.parts[0])
    displaced = replace(seen, pattern=seen.pattern + 0.05 * seen.shift_x)
    rng = np.random.default_rng(2)
    found = [compare(frame, [seen], *replicates(rng, image_of(frame, displaced), NOISE)) for _ in range(10)]
    assert not any(f["z_passed"] for f in found)
    # Some five standard errors of the mean of ten, 0.002 px each.
    assert np.mean([f["shift_x_px"] for f in found]) == pytest.approx(0.05, abs=0.004)


def test_a_blur_that_is_a_tenth_too_wide_fails(tmp_path: Path) -> None:
    frame = frame_of(small_study(tmp_path, *EFFECTS["defocus"]), 0)
    wider = replace(frame, camera=replace(frame.camera, aperture_radius_m=1.1 * frame.camera.aperture_radius_m))
    seen = predict(frame, frame.sheet.parts[0])
    other = predict(wider, frame.sheet.parts[0], (seen.row0, seen.col0, *seen.pattern.shape))
    rng = np.random.default_rng(3)
    found = [compare(frame, [seen], *replicates(rng, image_of(frame, other), NOISE)) for _ in range(10)]
    assert not any(f["z_passed"] for f in found)


def test_colours_have_light_and_diffraction_of_their_own(tmp_path: Path, monkeypatch) -> None:
    # The same few nodes on both sides: what is asked here is which colour a pixel has.
    monkeypatch.setattr("roundel.datasets.fidelity.quadrature._AIRY", 256)
    lens = CAMERA + ", aperture_mm: 0.1, focus_m: 0.64, diffraction: true, wavelengths_nm: [700, 550, 400]"
    mosaic = ("light:", "sensor: {mosaic: rggb}\nlight:")
    frame = frame_of(small_study(tmp_path, (CAMERA, lens), mosaic), 0)
    part, image = frame.sheet.parts[0], np.zeros((120, 160))
    for i, level in enumerate((0.5, 1.0, 2.0)):
        one = replace(frame, camera=replace(frame.camera, wavelengths_m=(frame.camera.wavelengths_m[i],)))
        plane = level * predict(one, part, (0, 0, 120, 160)).pattern
        for row in range(2):
            for column in range(2):
                if row + column == i:
                    image[row::2, column::2] = plane[row::2, column::2]
    found = measure_circle(frame, 0, image.astype(np.float32), np.full_like(image, 1e-6, dtype=np.float32))
    assert found["z_passed"]
    # Float32 and the light's quadratic leave nothing; the tail of the Airy pattern is the same sum both times.
    assert found["residual"] < 1e-4
    wrong = measure_circle(
        replace(frame, camera=replace(frame.camera, wavelengths_m=frame.camera.wavelengths_m[::-1])),
        0,
        image.astype(np.float32),
        np.full_like(image, 1e-6, dtype=np.float32),
    )
    assert not wrong["z_passed"]


REASONS = {
    "cut off by the image border": (("{uniform: [-20, 20]}", "-78"),),
    "smaller than 3 px": (("{uniform: [7, 9]}", "100"),),
    "its paper has grain": (("diameter_m: 0.08", "diameter_m: 0.08, grain: 0.1"),),
    "its surface is glossy": (("diameter_m: 0.08", "diameter_m: 0.08, surface: {kind: plastic}"),),
    "ink and paper have the same reflectance": (("diameter_m: 0.08", "diameter_m: 0.08, ink: 0.4, paper: 0.4"),),
    "occluders hide or shade it": (("light:", "occluders: [{z_m: 0.1, width_m: 0.01, x_m: 0.2}]\nlight:"),),
    "a lamp hides or shades it": (("position_m: [-0.3, -0.5, 0.0]", "position_m: [0.0, 0.0, 0.2]"),),
    "the lens barrel vignettes it": (
        (CAMERA, CAMERA + ", aperture_mm: 5, focus_m: 0.5, barrel_mm: 30, barrel_length_mm: 20"),
    ),
}


@pytest.mark.parametrize("reason", REASONS)
def test_what_cannot_be_measured_says_why(tmp_path: Path, reason: str) -> None:
    frame = frame_of(small_study(tmp_path, *REASONS[reason]), 0)
    bright = np.ones((120, 160), dtype=np.float32)
    assert measure_circle(frame, 0, bright, bright * 1e-6) == {"reason": reason}


def test_black_or_broken_images_give_reasons_not_numbers(tmp_path: Path) -> None:
    frame = frame_of(small_study(tmp_path), 0)
    black = np.zeros((120, 160), dtype=np.float32)
    assert measure_circle(frame, 0, black, black) == {"reason": "no light falls on it"}
    assert measure_circle(frame, 0, black + np.nan, black) == {"reason": "its radiance is not finite"}
    # An image with nothing to do with the circle fails, in finite numbers.
    noise = np.random.default_rng(0).uniform(0.5, 1.0, (120, 160)).astype(np.float32)
    found = measure_circle(frame, 0, noise, black)
    assert not found["z_passed"]
    assert all(np.isfinite(v) for v in found.values() if not isinstance(v, str))
    json.dumps(found, allow_nan=False)


def test_normal_scores_of_students_t_are_normal() -> None:
    noise = np.random.default_rng(4).standard_normal((REPLICATES, 50_000))
    scores = normal_scores(noise.mean(axis=0), noise.var(axis=0, ddof=1) / REPLICATES)
    # Mean square 1 +- 0.006, fourth moment 3 +- 0.04 over so many.
    assert np.mean(scores**2) == pytest.approx(1.0, abs=0.02)
    assert np.mean(scores**4) == pytest.approx(3.0, abs=0.15)


def test_one_wrong_pixel_in_a_thousand_is_seen() -> None:
    rng = np.random.default_rng(5)
    noise = rng.standard_normal((REPLICATES, 1000))
    difference, variance = noise.mean(axis=0), noise.var(axis=0, ddof=1) / REPLICATES
    assert pixel_test(difference, variance)["z_passed"]
    # The Sidak limit of 1,000 is a t of 9 with 7 degrees of freedom.
    difference[17] += 15 * np.sqrt(variance[17])
    assert not pixel_test(difference, variance)["z_passed"]


def test_sharp_circles_are_all_measured_and_blurred_ones_on_a_sample(tmp_path: Path) -> None:
    many = ("frames: 4", "frames: 100")
    sharp, blurred = small_study(tmp_path, many), small_study(tmp_path, many, *EFFECTS["defocus"], name="blurred.yaml")
    assert all(is_sampled(frame_of(sharp, i), 0) for i in range(0, 100, 9))
    chosen = [i for i in range(100) if is_sampled(frame_of(blurred, i), 0)]
    assert len(chosen) == SAMPLED_FRAMES
    assert np.ptp(np.diff(chosen)) <= 1  # evenly
    left = next(i for i in range(100) if i not in chosen)
    nothing = np.ones((120, 160), dtype=np.float32)
    assert measure_circle(frame_of(blurred, left), 0, nothing, nothing) == {
        "reason": "not in the sample of blurred frames"
    }


def test_every_level_of_a_sweep_and_every_corner_of_a_grid_has_its_sample(tmp_path: Path) -> None:
    sweep = ("frames: 4", "frames: 10\nsweep: {key: camera.aperture_mm, levels: [0, 10, 20, 30]}")
    study = small_study(tmp_path, *EFFECTS["defocus"], sweep)
    chosen = [frame for frame in frames_of(study) if is_sampled(frame, 0)]
    # Without an aperture all are sharp, and measured; of the others four a level.
    assert [sum(f.level == level for f in chosen) for level in (0, 10, 20, 30)] == [10, 4, 4, 4]
    cells = ("frames: 4", "frames_per_cell: 2")
    grid = ("{uniform: [10, 50]}", "{grid: [0, 10, 20, 30, 40, 50, 60, 65, 70, 72]}")
    spread = small_study(tmp_path, *EFFECTS["defocus"], cells, grid, name="grid.yaml")
    assert sum(is_sampled(frame, 0) for frame in frames_of(spread)) == SAMPLED_FRAMES


@pytest.mark.parametrize("name", EFFECTS)
def test_the_effect_on_an_edge_has_a_name(tmp_path: Path, name: str) -> None:
    assert effect_of(frame_of(small_study(tmp_path, *EFFECTS[name]), 0)) == name


def circle(effect: str, shift: float, passed: bool = True) -> dict:
    figures = {"shift_x_px": shift, "shift_y_px": -shift, "scale_px": 0.0, "shift_se_px": 0.001}
    return {**figures, "effect": effect, "residual": 0.01, "monte_carlo": 0.01, "z_rms": 1.0, "z_passed": passed}


def test_a_summary_has_figures_by_effect_and_reasons() -> None:
    measured = [
        circle("sharp", 0.001),
        circle("sharp", 0.003),
        circle("defocus", 0.01),
        {"reason": "smaller than 3 px"},
    ]
    found = summarise(measured)
    assert (found["circles"], found["z_passed"], found["z_consistent"]) == (3, 3, True)
    sharp = found["by_effect"]["sharp"]
    # Student's t for two circles: 12.706 times their scatter over sqrt 2.
    assert sharp["shift_x_px"] == pytest.approx({"mean": 0.002, "ci95": 12.706 * 0.001, "worst": 0.003}, rel=1e-3)
    assert sharp["shift_bound_px"] == pytest.approx(0.002 + 12.706 * 0.001, rel=1e-3)
    assert found["by_effect"]["defocus"]["shift_x_px"]["ci95"] == pytest.approx(1.96 * 0.001)
    assert found["unmeasured"] == {"smaller than 3 px": 1}
    text = "\n".join(fidelity_lines(json.loads(json.dumps(found))))
    for words in ("over 3 circles", "passed by 3 of 3", "defocus: 1 circle,", "not measured: 1 (smaller than 3 px)"):
        assert words in text


def test_more_failures_than_chance_allows_are_told() -> None:
    # One of twenty is chance; three are not.
    assert summarise([circle("sharp", 1e-4 * i, i > 0) for i in range(20)])["z_consistent"]
    found = summarise([circle("sharp", 1e-4 * i, i > 2) for i in range(20)])
    assert not found["z_consistent"]
    assert "passed by 17 of 20: more failures than expected by chance" in fidelity_lines(found)[0]


def test_nothing_measured_is_said() -> None:
    assert summarise([]) == {"circles": 0, "reason": "no circle was rendered"}
    found = summarise([{"reason": "its paper has grain"}])
    assert found == {"circles": 0, "reason": "its paper has grain", "unmeasured": {"its paper has grain": 1}}
    assert fidelity_lines(found) == ["fidelity: not measured (its paper has grain)"]
    assert fidelity_lines(None) == ["fidelity: not measured (no circles)"]


def test_clutter_that_shines_in_is_a_reason(tmp_path: Path) -> None:
    clutter = "diameter_m: 0.08, clutter: {cell_m: 0.02}, margin_m: "
    bright = np.ones((120, 160), dtype=np.float32)
    near = frame_of(small_study(tmp_path, ("diameter_m: 0.08", clutter + "0.002")), 0)
    assert measure_circle(near, 0, bright, bright) == {"reason": "clutter on the wall is visible at its edge"}
    far = frame_of(small_study(tmp_path, ("diameter_m: 0.08", clutter + "0.05")), 0)
    assert "z_passed" in measure_circle(far, 0, bright, bright * 1e-6)


def test_a_marker_that_outruns_the_shutter_is_a_reason(tmp_path: Path) -> None:
    fast = motion("exposure_s: 0, readout_s: 0.12, marker: {velocity_m_s: [0, -1.86, 0]}")
    frame = frame_of(small_study(tmp_path, fast, FLAT, ("{uniform: [7, 9]}", "8"), ("{uniform: [10, 50]}", "0")), 0)
    bright = np.ones((120, 160), dtype=np.float32)
    assert "while one row is read" in measure_circle(frame, 0, bright, bright)["reason"]


def test_the_same_rays_under_several_sensors_are_one_measurement(tmp_path: Path) -> None:
    study = small_study(tmp_path, ("light:", "sensor: {read_noise_e: 5}\nlight:"))
    pair = []
    for i in (0, 1):
        frame = frame_of(study, i)
        seen = predict(frame, frame.sheet.parts[0])
        image = np.full((120, 160), 0.8, dtype=np.float32)
        rows, columns = (k + np.arange(n) for k, n in zip((seen.row0, seen.col0), seen.coverage.shape, strict=True))
        image[np.ix_(rows, columns)] -= (0.75 * seen.coverage).astype(np.float32)
        noise = np.random.default_rng(i).normal(0, 1e-3, image.shape).astype(np.float32)
        pair.append(measure_circle(frame, 0, image + noise, np.full_like(image, 1e-6)))
    once, often = summarise(pair), summarise(3 * pair)
    assert once["circles"] == often["circles"] == 2
    assert once["shift_x_px"] == often["shift_x_px"]
