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
