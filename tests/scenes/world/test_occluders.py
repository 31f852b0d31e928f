"""Occluders in front of the print: the closed form against projection, the truth, and the rendered coverage."""

from pathlib import Path

import numpy as np
import pytest
from helpers_studies import small_study
from hypothesis import given
from hypothesis import strategies as st

from roundel.render.backend import start
from roundel.render.radiance import render_radiance
from roundel.scenes.errors import StudyError
from roundel.scenes.geometry.pose import camera_from_marker_of, normal_of, transform_points
from roundel.scenes.study.light_section import OccluderSection
from roundel.scenes.truth.truth import truth_of
from roundel.scenes.world.frame import frame_of
from roundel.scenes.world.occluders import hidden, occluder_outlines_m, occluder_plate, plates_of

FRONTAL = (
    ("distance_D: {uniform: [7, 9]}", "distance_D: 8"),
    ("tilt_deg: {uniform: [10, 50]}", "tilt_deg: 0"),
    ("offset_x_px: {uniform: [-20, 20]}", "offset_x_px: 0"),
)
DISTANCE_M = 0.64


def occluded(folder: Path, occluder: str, *edits: tuple[str, str]):
    return frame_of(small_study(folder, ("frames: 4", f"occluders: [{occluder}]\nframes: 4"), *edits), 0)


@given(
    tilt=st.floats(0, 60),
    azimuth=st.floats(-180, 180),
    turn=st.floats(-180, 180),
    place=st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(0.01, 0.2)),
    size=st.tuples(st.floats(0.02, 0.1), st.floats(0.02, 0.1)),
    is_round=st.booleans(),
)
def test_hidden_points_are_those_within_the_image_of_the_outline(tilt, azimuth, turn, place, size, is_round) -> None:
    occluder = OccluderSection(
        shape="disc" if is_round else "rectangle",
        x_m=place[0],
        y_m=place[1],
        z_m=place[2],
        width_m=size[0],
        height_m=size[1],
        turn_deg=turn,
    )
    pose = camera_from_marker_of(normal_of(tilt, azimuth), [0.05, -0.03, 0.6])
    points = np.column_stack([np.random.default_rng(0).uniform(-0.15, 0.15, (500, 2)), np.zeros(500)])
    found = hidden([occluder_plate(occluder)], pose, points)

    def image(p):
        return p[:, :2] / p[:, 2:]

    (line,) = occluder_outlines_m([occluder_plate(occluder)], pose)
    outline, at = image(line), image(transform_points(pose, points))
    side = outline[1:] - outline[:-1]
    across = side[:, 0] * (at[:, None, 1] - outline[:-1, 1]) - side[:, 1] * (at[:, None, 0] - outline[:-1, 0])
    within = (across > 0).all(axis=1) | (across < 0).all(axis=1)
    # A polygon of 128 corners lies within its circle by 3e-4 of the radius; a point there may differ.
    tolerance = np.abs(across).min(axis=1) < (1e-4 if is_round else 1e-12)
    assert (found == within)[~tolerance].all()


def test_a_half_covered_disc_is_half_visible(tmp_path: Path) -> None:
    # The camera's centre, the occluder's right side at x = 0, and the disc's centre are in line.
    frame = occluded(tmp_path, "{x_m: -0.1, z_m: 0.1, width_m: 0.2, height_m: 0.4}", *FRONTAL)
    row = truth_of(frame)[0]
    assert row["visible_fraction"] == pytest.approx(0.5, abs=1e-9)
    # The two points of the outline in line with the occluder's side may count as either.
    left = np.array(row["contour_x_px"]) < row["centre_image_x_px"] - 1e-6
    right = np.array(row["contour_x_px"]) > row["centre_image_x_px"] + 1e-6
    seen = np.array(row["contour_visible"])
    assert not seen[left].any()
    assert seen[right].all()
    assert left.sum() == right.sum() == 127


def test_an_occluder_that_covers_all_leaves_nothing_and_one_beside_it_everything(tmp_path: Path) -> None:
    # Seen from 0.64 m, a disc 0.32 m above the print looks twice as large as it is.
    assert (
        truth_of(occluded(tmp_path, "{shape: disc, z_m: 0.32, width_m: 0.041}", *FRONTAL))[0]["visible_fraction"] == 0.0
    )
    frame = occluded(tmp_path, "{shape: disc, z_m: 0.32, width_m: 0.039}", *FRONTAL)
    # A ring of 1 - 0.975^2 of the area is left; points stand 1/64 of the area apart.
    assert truth_of(frame)[0]["visible_fraction"] == pytest.approx(1 - 0.975**2, abs=1 / 64)
    assert truth_of(occluded(tmp_path, "{x_m: 0.2, z_m: 0.1, width_m: 0.1}", *FRONTAL))[0]["visible_fraction"] == 1.0


def test_an_area_lamp_in_the_line_of_sight_hides_too(tmp_path: Path) -> None:
    lamp = ("{position_m: [-0.3, -0.5, 0.0], size_m: 0.2", "{position_m: [0.0, 0.01, 0.3], size_m: 0.3")
    frame = frame_of(small_study(tmp_path, lamp, *FRONTAL), 0)
    assert truth_of(frame)[0]["visible_fraction"] == 0.0
    assert len(plates_of(frame.settings, frame.camera_from_sheet)) == 1


def test_an_occluder_behind_the_camera_is_refused_with_its_place(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match=r"study\.yaml:\d+:1: occluders\.0\.z_m: 0\.7 m above .* lower the occluder"):
        occluded(tmp_path, "{z_m: 0.7, width_m: 0.1}", *FRONTAL)


def test_coverage_counts_visible_print_only(tmp_path: Path) -> None:
    occluder = "{shape: rectangle, x_m: 0.02, y_m: 0.01, z_m: 0.05, width_m: 0.05, height_m: 0.08, turn_deg: 30}"
    # Face to face, equal areas of the print are equal areas of the image.
    frame = occluded(tmp_path, occluder, *FRONTAL, ("band_samples: 256", "band_samples: 64"))
    row = truth_of(frame)[0]
    assert 0.2 < row["visible_fraction"] < 0.9
    area = np.pi * row["ellipse_a_px"] * row["ellipse_b_px"]
    seen = render_radiance(start(), frame).coverage[0].astype(float).sum()
    # 4,096 points resolve the occluder's edge, of a diameter's length at most, to 1/64 of the area; pixels do better.
    assert seen / area == pytest.approx(row["visible_fraction"], abs=0.01)
