"""Layers of a study: preset, shared keys, a group's own."""

from pathlib import Path

import pytest

from roundel.scenes.errors import StudyError
from roundel.scenes.study.layers import deep_merge, preset, preset_names
from roundel.scenes.study.study import load_study
from roundel.scenes.world.frame import frames_of


def test_mappings_merge_and_all_else_replaces() -> None:
    below = {"a": 1, "b": {"c": 2, "d": [1, 2]}, "s": {"uniform": [0, 1]}}
    own = {"b": {"d": [3]}, "s": {"normal": [0, 1]}, "e": 5}
    assert deep_merge(below, own) == {"a": 1, "b": {"c": 2, "d": [3]}, "s": {"normal": [0, 1]}, "e": 5}


def test_a_section_of_another_kind_replaces() -> None:
    assert deep_merge({"kind": "disc", "diameter_m": 1}, {"kind": "tags", "tag_m": 2}) == {"kind": "tags", "tag_m": 2}
    # One that says its kind first only adds to keys that are common to all kinds.
    assert deep_merge({"ink": 0.1}, {"kind": "disc"}) == {"ink": 0.1, "kind": "disc"}


@pytest.mark.parametrize(
    ("lower", "own"),
    [
        ("distance_D", "distance_m"),
        ("focal_mm", "focal_px"),
        ("frames", "frames_per_cell"),
        ("exposure_e", "exposure_ph"),
    ],
)
def test_of_two_that_exclude_each_other_the_upper_stands(lower, own) -> None:
    assert deep_merge({lower: 1, "x": 2}, {own: 3}) == {own: 3, "x": 2}
    assert deep_merge({lower: 1}, {own: 3, lower: 4}) == {own: 3, lower: 4}  # both said: for the schema to refuse


def study(folder: Path, text: str):
    path = folder / "study.yaml"
    path.write_text(f"schema: 1\nname: x\n{text}")
    return load_study(path)


@pytest.mark.parametrize("name", preset_names())
def test_a_preset_needs_a_marker_and_a_count_and_nothing_more(tmp_path: Path, name) -> None:
    loaded = study(tmp_path, f"preset: {name}\nmarker: {{kind: disc, diameter_m: 0.08}}\nframes: 40\n")
    # Every frame can be placed, wherever its numbers fall.
    assert len(list(frames_of(loaded))) == 40
    assert len(loaded.groups["main"].spreads) > 8
    # The resolved study stands on its own feet.
    assert "preset" not in loaded.resolved()["groups"]["main"]


def test_a_studys_own_keys_lie_over_the_preset(tmp_path: Path) -> None:
    text = (
        "preset: indoor\nmarker: {kind: ring, diameter_m: 0.05, inner_diameter_m: 0.02, paper: 0.5}\nframes: 4\n"
        "pose: {distance_m: 0.7}\ngroups: {a: {}, b: {preset: phone, sensor: {jpeg_quality: 50}}}\n"
    )
    groups = study(tmp_path, text).groups
    assert groups["a"].pose.distance_m == groups["b"].pose.distance_m == 0.7
    assert groups["a"].pose.distance_D is None
    assert groups["a"].marker.paper == 0.5
    assert groups["a"].world.kind == "room"
    assert groups["a"].sensor.jpeg_quality is None
    assert groups["b"].world.kind == preset("phone")["world"] == "tabletop"
    assert groups["b"].sensor.jpeg_quality == 50


def test_an_unknown_preset_is_named_with_the_nearest(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match="preset: unknown preset 'phones'; did you mean phone") as caught:
        study(tmp_path, "preset: phones\nmarker: {kind: disc, diameter_m: 0.08}\nframes: 4\n")
    assert caught.value.line == 3


VARIED = """
seed: 4
camera: {width_px: 96, height_px: 80, focal_px: 120}
pose: {distance_m: {uniform: [0.3, 0.4]}, tilt_deg: {uniform: [10, 40]}}
frames: 3
groups:
  near: {}
  far: {pose: {distance_m: {uniform: [0.5, 0.6]}}}
variants:
  disc: {marker: {kind: disc, diameter_m: 0.08}}
  tag: {marker: {kind: tags, tag_m: 0.07}}
"""


def test_every_variant_of_a_group_has_the_same_poses(tmp_path: Path) -> None:
    found = study(tmp_path, VARIED)
    assert list(found.groups) == ["near.disc", "near.tag", "far.disc", "far.tag"]
    assert [group.paired_with for group in found.groups.values()] == [None, "near.disc", None, "far.disc"]
    frames = frames_of(found)
    poses = {(f.group, f.index): f.camera_from_sheet for f in frames}
    for group in ("near", "far"):
        for i in range(3):
            assert (poses[f"{group}.disc", i] == poses[f"{group}.tag", i]).all()
    assert (poses["near.disc", 0] != poses["far.disc", 0]).any()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{a.b: {}}", r":11:\d+: variants.a.b: a variant name may contain only letters"),
        ("[a]", r":11:1: variants: needs at least one variant"),
        ("{a: 3}", r":11:\d+: variants.a: a variant is a mapping of keys"),
        ("{a: {marker: {kind: disc, diameter_m: -1}}}", r":11:37: marker.diameter_m: "),
    ],
)
def test_an_error_in_a_variant_has_its_position(tmp_path: Path, text: str, message: str) -> None:
    raw = VARIED[: VARIED.index("variants:")]
    with pytest.raises(StudyError, match=message):
        study(tmp_path, raw + f"variants: {text}\n")
