"""Several markers in a frame: numbered, apart from each other, and no other first marker for it."""

from pathlib import Path

import numpy as np
import pytest
from helpers_studies import small_study
from hypothesis import given
from hypothesis import strategies as st

from roundel.scenes.errors import StudyError
from roundel.scenes.study.identity import frame_digest, frame_numbers
from roundel.scenes.truth.truth import truth_of
from roundel.scenes.world.frame import frame_of, frames_of
from roundel.scenes.world.further_sheets import PlacedSheet, gap_px, image_hull

FRAMES = "frames: 4"
FAR = ("distance_D: {uniform: [7, 9]}", "distance_D: {uniform: [20, 30]}")
RING = "{kind: ring, diameter_m: 0.08, inner_diameter_m: 0.05}"
CROWD = f"frames: 4\nmarkers: {{count: 5, kinds: [{{kind: disc, diameter_m: 0.06}}, {RING}]}}"


def sheets_of(frame):
    own = PlacedSheet(frame.settings.marker, frame.sheet, frame.camera_from_sheet)
    return [own, *frame.others]


def test_random_markers_are_apart_and_numbered_on(tmp_path: Path) -> None:
    for frame in frames_of(small_study(tmp_path, FAR, (FRAMES, CROWD))):
        hulls = [image_hull(sheet, frame.camera) for sheet in sheets_of(frame)]
        assert len(hulls) == 6
        # The gap asked for is 4 px by default.
        assert min(gap_px(a, b) for i, a in enumerate(hulls) for b in hulls[:i]) >= 4.0
        rows = truth_of(frame)
        assert [row["marker_id"] for row in rows] == list(range(6))
        assert [row["kind"] for row in rows] == ["disc", "disc", "ring", "disc", "ring", "disc"]
        assert all(row["visible_fraction"] == 1.0 and row["hidden_by"] == "" for row in rows)
        # Drawn anew for each, from the study's own distributions.
        assert len({row["tilt_deg"] for row in rows}) == 6
        assert all(20 <= row["distance_D"] <= 30 for row in rows)


def test_further_markers_change_nothing_of_the_first(tmp_path: Path) -> None:
    alone = small_study(tmp_path, FAR, name="alone.yaml")
    crowd = small_study(tmp_path, FAR, (FRAMES, CROWD), name="crowd.yaml")
    for a, b in zip(frames_of(alone), frames_of(crowd), strict=True):
        np.testing.assert_array_equal(a.camera_from_sheet, b.camera_from_sheet)
        assert a.noise_seed == b.noise_seed
        row, other = truth_of(a)[0], truth_of(b)[0]
        assert row == other
        assert frame_digest(a) != frame_digest(b)
        assert len(frame_numbers(b)["others"]) == 5


def test_random_bent_markers_turn_where_they_are_seen(tmp_path: Path) -> None:
    # From 50 degrees on, a disc on a can of this radius turns out of sight: such draws are made again.
    cans = (
        "frames: 4\nmarkers: {count: 3, tilt_deg: {uniform: [0, 80]}, kinds: [{kind: disc, diameter_m: 0.08, "
        "surface: {shape: cylinder, radius_m: 0.06}}]}"
    )
    frames = list(frames_of(small_study(tmp_path, FAR, (FRAMES, cans))))
    assert all(len(truth_of(frame)) == 4 for frame in frames)
    assert {row["surface"] for frame in frames for row in truth_of(frame)[1:]} == {"cylinder"}


def test_listed_markers_have_their_poses_and_draw_them(tmp_path: Path) -> None:
    listed = (
        "frames: 4\nmarkers:\n  - {pose: {distance_D: 30, tilt_deg: 20, azimuth_deg: 90, offset_x_px: -60}}\n"
        "  - {marker: {kind: ring, diameter_m: 0.05, inner_diameter_m: 0.02}, pose: {distance_m: {uniform: [1, 2]}, "
        "offset_x_px: 60}}"
    )
    frames = list(frames_of(small_study(tmp_path, FAR, (FRAMES, listed))))
    rows = [truth_of(frame) for frame in frames]
    assert all(r[1]["distance_D"] == pytest.approx(30) and r[1]["tilt_deg"] == pytest.approx(20) for r in rows)
    assert len({r[2]["distance_m"] for r in rows}) == 4
    assert frames[0].drawn["markers.others.1.pose.distance_m"] == pytest.approx(rows[0][2]["distance_m"])


def test_one_sheet_in_front_of_another_hides_it(tmp_path: Path) -> None:
    # Far in front and in the middle of the image, where the first marker is.
    before = ("frames: 4", "frames: 4\nmarkers: [{pose: {distance_m: 0.3}, marker: {kind: disc, diameter_m: 0.04}}]")
    hidden, free = truth_of(frame_of(small_study(tmp_path, FAR, before), 0))
    assert hidden["hidden_by"] == "sheet"
    assert hidden["visible_fraction"] < 0.5
    assert (free["visible_fraction"], free["hidden_by"]) == (1.0, "")


@pytest.mark.parametrize(
    ("markers", "said"),
    [
        ("markers: {count: 90}", r"markers.count: only \d+ of 90 find a place where none hides another"),
        ("markers: [{pose: {distance_D: 25}}]", r"markers.0.pose: its sheet meets sheet 0"),
        ("markers: [{pose: {distance_D: 25, offset_x_px: 900}}]", r"markers.0.pose.offset_x_px, offset_y_px: "),
        ("markers: {count: 2, tilt_deg: {grid: [1, 2]}}", r"markers: tilt_deg: a grid has one value for a frame"),
        ("markers: {count: 2, distance_D: 3, distance_m: 3}", r"markers: give distance_D or distance_m, not both"),
        ("markers: [{pose: {tilt_deg: 3}}]", r"markers.0.pose: give either distance_D or distance_m"),
        ("markers: {count: 2}\nmotion: {marker: {velocity_m_s: [1, 0, 0]}}", r"motion.marker: one of several markers"),
        ("markers: {count: 101}", r"markers.count: .*less than or equal to 100"),
        (
            "markers: {count: 2, kinds: [{kind: dics, diameter_m: 1}]}",
            r"markers.kinds.0.kind: unknown kind 'dics'; did",
        ),
    ],
)
def test_markers_that_cannot_be_are_refused(tmp_path: Path, markers: str, said: str) -> None:
    tilted = ("tilt_deg: {uniform: [10, 50]}", "tilt_deg: {uniform: [40, 50]}")
    far = ("distance_D: {uniform: [7, 9]}", "distance_D: 25")
    with pytest.raises(StudyError, match=said):
        frame_of(small_study(tmp_path, far, tilted, (FRAMES, f"frames: 4\n{markers}")), 0)


@given(shift=st.tuples(st.floats(-50, 50), st.floats(-50, 50)), turn=st.floats(0, 360), sides=st.integers(3, 12))
def test_the_gap_of_polygons_is_no_more_than_their_distance(shift, turn: float, sides: int) -> None:
    angle = np.radians(turn) + 2 * np.pi * np.arange(sides) / sides
    a = 10 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    b = a[::-1] + shift
    dense = np.concatenate([a + t * (np.roll(a, -1, axis=0) - a) for t in np.linspace(0, 1, 40)])
    nearest = np.linalg.norm(dense[:, None] - (dense + shift)[None], axis=-1).min()
    # A separating axis never overstates the distance; where the nearest points are inner to a side it is exact.
    assert gap_px(a, b) <= nearest + 1e-9
    assert gap_px(a, b) == pytest.approx(gap_px(b, a))
    assert gap_px(a, a) < 0
