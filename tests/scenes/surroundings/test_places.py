"""Worlds are built around the sheet: they change no pose, hide no marker, and are what gravity allows."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from helpers_studies import SMALL, small_study
from hypothesis import given, settings
from hypothesis import strategies as st

from roundel.scenes.errors import StudyError
from roundel.scenes.geometry.pose import camera_from_marker_of, normal_of, transform_points
from roundel.scenes.study.identity import frame_digest, frame_numbers
from roundel.scenes.study.study import load_study
from roundel.scenes.study.world_section import WORLDS
from roundel.scenes.surroundings.bodies import Body, Material, blocks
from roundel.scenes.surroundings.gravity import UPRIGHT_DEG, footing_of, roll_deg
from roundel.scenes.surroundings.places import surroundings_of
from roundel.scenes.surroundings.sheet_place import SheetPlace
from roundel.scenes.truth.truth import truth_of
from roundel.scenes.world.frame import frames_of

PLACES = WORLDS[1:]
WORLDS_STUDY = Path(__file__).resolve().parents[3] / "configs" / "worlds.yaml"
LIGHT = "light: {environment: 0.7, lamps: [{position_m: [-0.3, -0.5, 0.0], size_m: 0.2, radiance: 6}]}\n"


def in_world(folder: Path, world: str, name: str = "w.yaml"):
    """The small study in a world, which has its own lights."""
    return small_study(folder, (LIGHT, f"world: {world}\n"), name=name)


CORNERS = 0.12 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
TURN = np.linspace(0, 2 * np.pi, 32, endpoint=False)
OUTLINE = 0.08 * np.column_stack([np.cos(TURN), np.sin(TURN), 0 * TURN])


def sheet_at(tilt_deg: float, azimuth_deg: float, roll: float, distance_m: float) -> SheetPlace:
    pose = camera_from_marker_of(normal_of(tilt_deg, azimuth_deg), [0.0, 0.0, distance_m], roll)
    return SheetPlace(pose, transform_points(pose, CORNERS), transform_points(pose, OUTLINE), 0.0003)


poses = st.tuples(st.floats(0, 75), st.floats(-180, 180), st.floats(-180, 180), st.floats(0.3, 6))


@settings(max_examples=60, deadline=None)
@given(pose=poses, kind=st.sampled_from(PLACES), seed=st.integers(0, 2**32 - 1))
def test_a_marker_is_seen_in_every_world(pose, kind: str, seed: int) -> None:
    sheet = sheet_at(*pose)
    around = surroundings_of(kind, [sheet], 6, np.random.default_rng(seed))
    seen = sheet.seen + 1e-3 * sheet.normal
    assert not any(blocks(body, np.zeros(3), seen).any() for body in around.bodies)
    assert np.linalg.norm(around.up) == pytest.approx(1.0)
    for body in around.bodies:
        rotation = body.camera_from_body[:3, :3]
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(rotation) == pytest.approx(1.0)
        # The camera is in no body, and neither is the sheet's middle.
        for point in (np.zeros(3), sheet.centre + 1e-3 * sheet.normal):
            inside = np.abs(rotation.T @ (point - body.camera_from_body[:3, 3])) < body.half_m
            assert not inside.all()
    assert all(panel.radiance > 0 for panel in around.panels)
    assert bool(around.panels) != (around.sun is not None)


@settings(max_examples=200, deadline=None)
@given(tilt=st.floats(0, 85), azimuth=st.floats(-180, 180), seed=st.integers(0, 1000))
def test_the_camera_is_held_upright(tilt: float, azimuth: float, seed: int) -> None:
    normal = normal_of(tilt, azimuth)
    footing = footing_of(normal, np.array([0.0, 0.0, 1.0]), 0.15, np.random.default_rng(seed), "flat")
    assert roll_deg(footing.up) <= UPRIGHT_DEG + 1e-6
    along = {"flat": 1.0, "upright": 0.0}.get(footing.posture)
    if along is not None:
        assert footing.up @ normal == pytest.approx(along, abs=1e-9)


def test_a_table_lies_under_a_sheet_that_is_seen_from_above() -> None:
    # The camera looks down by 50 degrees: the sheet faces up.
    found = {
        surroundings_of("tabletop", [sheet_at(40.0, -90.0, 0.0, 1.0)], 0, np.random.default_rng(i)).support
        for i in range(8)
    }
    assert found == {"table"}
    # Seen squarely by a level camera it hangs on a wall.
    assert surroundings_of("room", [sheet_at(5.0, 0.0, 0.0, 1.0)], 0, np.random.default_rng(0)).support == "wall"


def test_blocking_is_decided_by_the_box() -> None:
    body = Body("box", np.diag([1.0, 1, 1, 1]) + np.pad([[0, 0, 0, 0]] * 2 + [[0, 0, 0, 1.0]], ((0, 1), (0, 0))),
                np.array([0.1, 0.2, 0.05]), Material("matte", (1, 1, 1)))  # fmt: skip
    points = np.array([[0.0, 0, 2], [0.15, 0, 2], [0.25, 0, 2], [0, 0, 0.9], [0, 0.5, 2], [0.0, 0, -2]])
    assert blocks(body, np.zeros(3), points).tolist() == [True, True, False, False, False, False]


@pytest.mark.parametrize("kind", PLACES)
def test_a_world_changes_no_pose(tmp_path: Path, kind: str) -> None:
    plain = list(frames_of(small_study(tmp_path)))
    placed = list(frames_of(in_world(tmp_path, kind)))
    again = list(frames_of(in_world(tmp_path, f"{{kind: {kind}}}", "v.yaml")))
    for a, b, c in zip(plain, placed, again, strict=True):
        assert a.surroundings is None
        np.testing.assert_array_equal(a.camera_from_sheet, b.camera_from_sheet)
        assert (a.drawn, a.noise_seed, a.ray_seed, a.sheet_seed) == (b.drawn, b.noise_seed, b.ray_seed, b.sheet_seed)
        assert frame_digest(b) == frame_digest(c)
        assert frame_digest(a) != frame_digest(b)
        moved = dataclasses.replace(b.surroundings, bodies=b.surroundings.bodies[1:])
        assert frame_numbers(dataclasses.replace(b, surroundings=moved)) != frame_numbers(b)


def truth_in(folder: Path, world: str) -> list[dict]:
    """Truth of the shipped study `worlds` in one world; the group keeps its name, which is part of what it draws."""
    text = WORLDS_STUDY.read_text(encoding="utf-8")
    before, after = text.index("groups:"), text.index("solve:")
    path = folder / f"{world}.yaml"
    path.write_text(text[:before] + f"groups: {{main: {{world: {world}}}}}\n" + text[after:])
    return [row for frame in frames_of(load_study(path)) for row in truth_of(frame)]


def test_the_truth_is_that_of_the_plain_wall_in_every_world(tmp_path: Path) -> None:
    plain = truth_in(tmp_path, "plain")
    assert len(plain) == 8
    for world in PLACES:
        for expected, found in zip(plain, truth_in(tmp_path, world), strict=True):
            assert found.keys() == expected.keys()
            # Number for number, in every column: poses, conic, contour, vanishing line, the other pose, visibility.
            for column, value in expected.items():
                assert np.array_equal(found[column], value), column


@pytest.mark.parametrize(
    ("world", "sentence"),
    [
        ("kitchen", "world.kind: Input should be 'plain', 'tabletop'"),
        ("{kind: room, objects: -1}", "world.objects"),
        ("{kind: room, objects: 2000}", "world.objects"),
        ("{kind: room, thickness: 1}", "world.thickness"),
        ("[room]", "world"),
    ],
)
def test_a_wrong_world_is_one_line(tmp_path: Path, world: str, sentence: str) -> None:
    with pytest.raises(StudyError) as caught:
        list(frames_of(in_world(tmp_path, world)))
    assert sentence.split(":", maxsplit=1)[0] in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        (("", ""), "world room has its own lights; leave out light, or set world: plain"),
        (("0.08}", "0.08, clutter: {cell_m: 0.1, contrast: 0.2}}"), "has no bare wall"),
        (("frames: 4", "motion: {marker: {velocity_m_s: [0.1, 0, 0]}}\nframes: 4"), "the sheet is at rest"),
    ],
)
def test_what_a_world_does_not_take_is_refused(tmp_path: Path, keys: tuple[str, str], sentence: str) -> None:
    study = SMALL if "lights" in sentence else SMALL.replace(LIGHT, "")
    (tmp_path / "study.yaml").write_text(study.replace(*keys) + "world: room\n")
    with pytest.raises(StudyError, match=sentence):
        load_study(tmp_path / "study.yaml")


@settings(max_examples=30, deadline=None)
@given(pose=poses, kind=st.sampled_from(["room", "outdoor"]), seed=st.integers(0, 2**32 - 1))
def test_things_on_a_wall_hang_beside_the_sheet(pose, kind: str, seed: int) -> None:
    sheet = sheet_at(*pose)
    around = surroundings_of(kind, [sheet], 0, np.random.default_rng(seed))
    if around.support != "wall":
        return
    inward = (sheet.corners - sheet.centre) @ np.stack([np.cross(around.up, sheet.normal), around.up]).T
    flat = [b for b in around.bodies if b.half_m[2] < 0.06 and abs(b.camera_from_body[:3, 2] @ sheet.normal) > 0.999]
    if pose[3] > 1.5:
        assert flat  # from nearer, the wall in view may have no room for them
    for body in flat:
        local = body.camera_from_body[:3, :3].T @ (sheet.centre - body.camera_from_body[:3, 3])
        # Rectangles of paper and thing do not overlap.
        apart = np.abs(local[:2]) - body.half_m[:2] - np.ptp(inward, axis=0) / 2
        assert apart.max() > 0
        assert not blocks(body, np.zeros(3), sheet.seen + 1e-3 * sheet.normal).any()
