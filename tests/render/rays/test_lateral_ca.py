"""Lateral chromatic aberration: each colour's pixels see a disc magnified by their own factor."""

from pathlib import Path

import numpy as np
import pytest
from helpers_studies import small_study

from roundel.datasets.fidelity.measure import measure_circle
from roundel.render.radiance import Radiance, render_radiance
from roundel.render.sensor.demosaic import filters
from roundel.scenes.camera.model import camera_from_json, camera_of_colour, camera_to_json, lateral_shift_px
from roundel.scenes.errors import StudyError
from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic
from roundel.scenes.study.study import load_study
from roundel.scenes.world.frame import Frame, frame_of

MAGNIFIED = (1.006, 0.993)
CA = f"lateral_ca: [{MAGNIFIED[0]}, {MAGNIFIED[1]}]"


def study_with(folder: Path, camera: str, sensor: str = "{mosaic: rggb, deliver: raw}"):
    return small_study(
        folder,
        ("focal_px: 320", f"focal_px: 320, {camera}"),
        ("offset_x_px: {uniform: [-20, 20]}", "offset_x_px: 40\n  offset_y_px: -25"),
        ("lamps: [{position_m: [-0.3, -0.5, 0.0], size_m: 0.2, radiance: 6}]", "lamps: []"),
        ("frames: 4", f"frames: 1\nsensor: {sensor}"),
    )


def rendered(mi, frame: Frame) -> Radiance:
    return render_radiance(mi, frame)


def planes(mi, folder: Path, camera: str) -> tuple[Frame, np.ndarray]:
    """Coverage (3, H, W) of every pixel in red, green, blue: over the four mosaics, a pixel has each filter once."""
    whole = np.full((3, 120, 160), np.nan)
    for mosaic in ("rggb", "bggr", "grbg", "gbrg"):
        frame = frame_of(study_with(folder, camera, f"{{mosaic: {mosaic}, deliver: raw}}"), 0)
        cover, colour = rendered(mi, frame).coverage[0], filters(mosaic, (120, 160))
        for channel in range(3):
            whole[channel][colour == channel] = cover[colour == channel]
    return frame, whole


def moments(cover: np.ndarray) -> np.ndarray:
    """Centroid and area-equivalent radius of a disc from its coverage (H, W), px."""
    y, x = np.mgrid[:120, :160]
    return np.array([np.sum(cover * x), np.sum(cover * y), np.sqrt(cover.sum() / np.pi) * cover.sum()]) / cover.sum()


@pytest.mark.parametrize("lens", ["", "distortion: [-0.15, 0.02, 0.001, 0.0]"])
def test_every_colour_is_magnified_about_the_principal_point(mi, tmp_path: Path, lens: str) -> None:
    camera = ", ".join(filter(None, [lens, "principal_point_x_px: 85"]))
    frame, bare = planes(mi, tmp_path, camera)
    _, seen = planes(mi, tmp_path, f"{camera}, {CA}")
    axis = frame.camera.K[:2, 2]
    x0, y0, r0 = moments(bare[1])
    for colour, magnified in enumerate((MAGNIFIED[0], 1.0, MAGNIFIED[1])):
        x1, y1, r1 = moments(seen[colour])
        # About 120 pixels at an edge, each within 0.01 of its coverage, and a disc of 1,250 px: centroid and radius
        # have standard errors of 0.001 px. A difference of two, at four of them.
        np.testing.assert_allclose([x1, y1], axis + magnified * ([x0, y0] - axis), atol=0.006)
        assert r1 == pytest.approx(magnified * r0, abs=0.006)


def test_fidelity_finds_the_magnification_and_its_absence(mi, tmp_path: Path) -> None:
    frame = frame_of(study_with(tmp_path, CA), 0)
    seen = rendered(mi, frame)
    right = measure_circle(frame, 0, seen.mean, seen.variance)
    # Each within five of its own standard errors, which are some thousandths of a pixel.
    assert right["shift_se_px"] < 0.005
    for name in ("shift_x_px", "shift_y_px", "scale_px"):
        assert abs(right[name]) < 5 * right["shift_se_px"], name
    assert right["residual"] < 2 * right["monte_carlo"] + 1e-3
    # Compared with the truth of a lens without aberration, the same picture does not pass.
    wrong = measure_circle(frame_of(study_with(tmp_path, "aspect: 1"), 0), 0, seen.mean, seen.variance)
    assert wrong["residual"] > 5 * right["residual"]


def test_the_camera_of_a_colour_images_what_its_pixels_see(tmp_path: Path) -> None:
    frame = frame_of(study_with(tmp_path, CA), 0)
    part = frame.sheet.parts[0]
    pose = frame.camera_from_part(part)
    axis = frame.camera.K[:2, 2]
    green = ellipse_of_conic(conic_of_circle(pose, part.radius_m, frame.camera.K))
    for colour, magnified in enumerate((MAGNIFIED[0], 1.0, MAGNIFIED[1])):
        k = camera_of_colour(frame.camera, colour).K
        own = ellipse_of_conic(conic_of_circle(pose, part.radius_m, k))
        np.testing.assert_allclose(own[:2] - axis, magnified * (green[:2] - axis), rtol=1e-9)
        np.testing.assert_allclose(own[2:4], magnified * green[2:4], rtol=1e-9)
    assert lateral_shift_px(frame.camera) == pytest.approx(0.007 * np.hypot(79.5, 59.5))


def test_the_record_has_green_and_says_so(tmp_path: Path) -> None:
    frame = frame_of(study_with(tmp_path, CA), 0)
    record = camera_to_json(frame.camera)
    assert record["lateral_ca"] == list(MAGNIFIED)
    np.testing.assert_array_equal(camera_from_json(record).K, frame_of(study_with(tmp_path, "aspect: 1"), 0).camera.K)
    assert "lateral_ca" not in camera_to_json(camera_from_json(record))


def test_values_do_not_change_the_kernel(mi, tmp_path: Path) -> None:
    import drjit as dr

    rendered(mi, frame_of(study_with(tmp_path, CA), 0))
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        rendered(mi, frame_of(study_with(tmp_path, "lateral_ca: [0.9991, 1.0003]"), 0))
        missed = [k for k in dr.kernel_history([dr.KernelType.JIT]) if not k["cache_hit"]]
    assert missed == []


@pytest.mark.parametrize(
    ("camera", "sensor", "words", "place"),
    [
        (CA, "{}", "camera.lateral_ca: only colours are magnified differently; add sensor.mosaic", (4, 56)),
        ("lateral_ca: [1.001]", "{mosaic: rggb}", "lateral_ca takes two magnifications: red, blue", None),
        ("lateral_ca: [1.1, 1]", "{mosaic: rggb}", "relative magnification must be between 0.98 and 1.02", None),
        ("lateral_ca: [1, 1, 1]", "{mosaic: rggb}", "at most 2 items", None),
    ],
)
def test_bad_input_is_one_line(tmp_path: Path, camera: str, sensor: str, words: str, place) -> None:
    with pytest.raises(StudyError) as caught:
        study_with(tmp_path, camera, sensor)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    assert caught.value.line == 4
    if place:
        assert (caught.value.line, caught.value.column) == place
    with pytest.raises(StudyError):
        load_study(tmp_path / "study.yaml")
