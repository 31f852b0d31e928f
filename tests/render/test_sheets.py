"""Bent sheets and several sheets, rendered: where the truth says, and an error of the truth is found."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers_studies import small_study

from roundel.datasets.fidelity.measure import measure_circle
from roundel.datasets.layout.truth_table import TRUTH_SCHEMA
from roundel.render.radiance import render_radiance
from roundel.render.run import render_study
from roundel.render.scene.transport import is_plain
from roundel.scenes.world.frame import frame_of

DISC = "kind: disc, diameter_m: 0.08"
BENT = {
    "cylinder": "shape: cylinder, radius_m: 0.07, axis_deg: 60",
    "wave": "shape: bent, radius_m: 0.1, wave_m: 0.16, axis_deg: 20",
}


def rendered(mi, frame):
    radiance = render_radiance(mi, frame)
    found = [
        measure_circle(view, part.marker_id, radiance.mean, radiance.variance)
        for view in frame.views()
        for part in view.sheet.parts
    ]
    return radiance, found


@pytest.mark.parametrize("surface", list(BENT))
def test_a_bent_circle_is_where_the_truth_says(mi, tmp_path: Path, surface: str) -> None:
    frame = frame_of(small_study(tmp_path, (DISC, f"{DISC}, surface: {{{BENT[surface]}}}")), 2)
    assert not is_plain(frame)
    radiance, (found,) = rendered(mi, frame)
    assert "reason" not in found
    for name in ("shift_x_px", "shift_y_px", "scale_px"):
        # One frame of 256 rays a pixel: five standard errors.
        assert abs(found[name]) < 5 * found["shift_se_px"] + 1e-3, name
    # A radius of curvature 4 % off moves the far contour by some hundredths of a pixel: pixels no longer agree.
    curve = replace(frame.sheet.curve, radius_m=1.04 * frame.sheet.curve.radius_m)
    wrong = replace(frame, sheet=replace(frame.sheet, curve=curve))
    off = measure_circle(wrong, 0, radiance.mean, radiance.variance)
    assert found["z_passed"]
    assert not off.get("z_passed", False)


def test_all_markers_of_a_crowd_are_where_the_truth_says(mi, tmp_path: Path) -> None:
    crowd = ("frames: 4", "frames: 4\nmarkers: {count: 3, distance_D: {uniform: [9, 14]}}")
    near = ("distance_D: {uniform: [7, 9]}", "distance_D: {uniform: [12, 14]}")
    frame = frame_of(small_study(tmp_path, crowd, near), 1)
    radiance, found = rendered(mi, frame)
    measured = [f for f in found if "reason" not in f]
    assert len(measured) >= 3, found
    for one in measured:
        for name in ("shift_x_px", "shift_y_px", "scale_px"):
            assert abs(one[name]) < 5 * one["shift_se_px"] + 1e-3, name
    # A shift of a twentieth of a pixel between truth and image is found, for a marker that is not the first.
    which = next(i for i in range(1, 4) if "reason" not in found[i])
    view = frame.views()[which]
    moved = view.camera_from_sheet.copy()
    moved[0, 3] += 0.05 * moved[2, 3] / frame.camera.K[0, 0]
    off = measure_circle(
        replace(view, camera_from_sheet=moved), view.sheet.parts[0].marker_id, radiance.mean, radiance.variance
    )
    # To two thousandths: the shift of a whole pose moves the far side of a tilted disc by less.
    assert off["shift_x_px"] - found[which]["shift_x_px"] == pytest.approx(-0.05, abs=2e-3)
    assert sorted(radiance.coverage) == [0, 1, 2, 3]
    assert all(plane.max() == 1.0 for plane in radiance.coverage.values())


@pytest.mark.parametrize("world", ["tabletop", "outdoor"])
def test_a_crowd_in_a_world_is_rendered_to_a_dataset(tmp_path: Path, world: str) -> None:
    light = "light: {environment: 0.7, lamps: [{position_m: [-0.3, -0.5, 0.0], size_m: 0.2, radiance: 6}]}"
    study = small_study(
        tmp_path,
        (light, f"world: {world}\nmarkers: {{count: 2, distance_D: {{uniform: [9, 14]}}}}"),
        ("distance_D: {uniform: [7, 9]}", "distance_D: {uniform: [10, 12]}"),
        ("band_samples: 256", "target_error: 0.1, background_error: 0.3"),
        ("frames: 4", "frames: 1"),
        (DISC, f"{DISC}, surface: {{shape: cylinder, radius_m: 0.09}}"),
        ("tilt_deg: {uniform: [10, 50]}", "tilt_deg: {uniform: [10, 20]}"),
    )
    dataset = render_study(study, tmp_path / "out")
    assert dataset.truth.schema.equals(TRUTH_SCHEMA)
    assert dataset.truth["marker_id"].to_pylist() == [0, 1, 2]
    assert dataset.truth["surface"].to_pylist() == ["cylinder"] * 3
    assert np.asarray(dataset.truth["conic_00"].is_null()).all()
    assert [m["marker_id"] for m in dataset.images.markers(0)] == [0, 1, 2]
    dataset.verify(full=True)
