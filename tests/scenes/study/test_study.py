"""Reading studies: what is accepted, and the one-line error for what is not."""

import json
import pickle
from pathlib import Path

import jsonschema
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from roundel.scenes.errors import StudyError
from roundel.scenes.study.schema import json_schema
from roundel.scenes.study.study import load_study
from roundel.scenes.study.yaml_reader import read_yaml
from roundel.scenes.world.frame import frame_of, frames_of, total_frames

CONFIGS = sorted((Path(__file__).resolve().parents[3] / "configs").glob("*.yaml"))

STUDY = """\
schema: 1
name: tiny
seed: 3
camera: {width_px: 640, height_px: 480, focal_px: 640}
marker: {kind: disc, diameter_m: 0.08}
pose:
  distance_D: {grid: [8, 12]}
  tilt_deg: {grid: [15, 40]}
  azimuth_deg: {uniform: [-180, 180]}
  offset_x_px: {uniform: [-1, 1]}
frames_per_cell: 2
"""


@pytest.fixture
def write(tmp_path: Path):
    def put(text: str) -> Path:
        path = tmp_path / "study.yaml"
        path.write_text(text, encoding="utf-8")
        return path

    return put


# What is wrong, as an edit of STUDY: old text, new text, line and column of the complaint, words in it.
WRONG = [
    ("focal_px", "focl_px", (4, 41), "camera.focl_px: unknown key; did you mean focal_px?"),
    ("name: tiny", "nmae: tiny", (2, 1), "nmae: unknown key; did you mean name?"),
    ("width_px: 640", "width_px: wide", (4, 10), "camera.width_px"),
    ("width_px: 640", "width_px: 1.5", (4, 10), "camera.width_px"),
    ("0.08", "-0.08", (5, 22), "marker.diameter_m: -0.08 is out of range; it must be positive"),
    ("0.08", ".nan", (5, 22), "marker.diameter_m: nan is not finite"),
    ("0.08", "true", (5, 22), "marker.diameter_m: True is not a number"),
    ("kind: disc", "kind: disk", (5, 10), "unknown kind 'disk'; did you mean disc?"),
    ("kind: disc", "kind: disc, colour: 3", (5, 22), "marker.colour: unknown key"),
    ("{grid: [8, 12]}", "-3", (7, 3), "pose.distance_D: -3 is out of range"),
    ("{grid: [8, 12]}", "{grid: []}", (7, 3), "grid takes a list of numbers"),
    ("{grid: [8, 12]}", "{range: [8, 12]}", (7, 3), "a distribution is one of"),
    ("{uniform: [-1, 1]}", "{uniform: [1, -1]}", (10, 3), "the first number must be the smaller one"),
    ("40]", "95]", (8, 3), "95 is out of range; a tilt must be between 0 and 85 degrees"),
    ("frames_per_cell: 2", "frames: 7", (11, 1), "7 frames is not a multiple of the 4 grid cells"),
    ("seed: 3", "seed: 3\nseed: 4", (4, 1), "seed: duplicate key"),
    ("name: tiny", "name: &a tiny", (2, 7), "anchors and aliases are not supported"),
    ("name: tiny", "name: !!python/name:os.system tiny", (2, 7), "tag"),
    ("schema: 1", "schema: 2", (1, 1), "schema"),
    ("frames_per_cell: 2", "frames_per_cell: 2\nframes: 8", (1, 1), "give either frames or frames_per_cell"),
    ("  distance_D", "  distance_m: 3\n  distance_D", (6, 1), "give either distance_D or distance_m"),
    ("marker: {kind: disc, diameter_m: 0.08}\n", "", (1, 1), "marker: required key is missing"),
    ("pose:", "pose: [", (8, 3), "not YAML"),
    ("frames_per_cell: 2", "frames_per_cell: 2\nsolve: {groups: [mian]}", (12, 9), "did you mean main?"),
    ("frames_per_cell: 2", "frames_per_cell: 2\nsolve: {intrinsics: [calibrated]}", (12, 9), "calibrate_from"),
    (
        "frames_per_cell: 2",
        "frames_per_cell: 2\nsolve: {intrinsics: ['calibrated:5']}",
        (12, 9),
        "`calibrated:5` needs solve.calibrate_from",
    ),
    ("frames_per_cell: 2", "frames_per_cell: 2\nsolve: {intrinsics: ['calibrated:2']}", (12, 9), "needs 3 views"),
]


@pytest.mark.parametrize(("old", "new", "place", "words"), WRONG, ids=[w[1][:40] for w in WRONG])
def test_what_is_wrong_is_said_with_its_place(write, old, new, place, words) -> None:
    assert old in STUDY
    path = write(STUDY.replace(old, new, 1))
    with pytest.raises(StudyError) as caught:
        total_frames(load_study(path))
    assert words in str(caught.value)
    assert (caught.value.line, caught.value.column) == place
    assert str(caught.value).startswith(f"{path}:{place[0]}:{place[1]}: ")
    assert "\n" not in str(caught.value)


# Frames that cannot be: only placing them shows it.
IMPOSSIBLE = [
    ("{uniform: [-1, 1]}", "900", "outside the image"),
    ("{uniform: [-1, 1]}", "{uniform: [-1000, -990]}", "outside the image"),
    ("{grid: [8, 12]}", "0.3", "outline of marker 0 lies outside the image"),
    ("{grid: [8, 12]}\n  tilt_deg: {grid: [15, 40]}", "0.4\n  tilt_deg: {grid: [80, 80, 80, 80]}", "behind the camera"),
    ("focal_px: 640", "focal_px: 640, distortion: [-3, 0, 0, 0]", "folds inside the image"),
    ("focal_px: 640", "focal_mm: 50, pixel_pitch_um: 5, focus_m: 0.05", "inside the focal length"),
    ("kind: disc, diameter_m: 0.08", "kind: chessboard, columns: 5, rows: 4, square_m: 0.01", "give distance_m"),
    ("kind: disc", "kind: ring, inner_diameter_m: 0.09", "must be smaller than diameter_m"),
    (
        "kind: disc",
        "kind: disc_with_chessboard, inverted: true, gap_m: 0.01, chessboard: {columns: 5, rows: 4, square_m: 0.01}",
        "a chessboard cannot be inverted",
    ),
]


@pytest.mark.parametrize(("old", "new", "words"), IMPOSSIBLE, ids=[w[2] for w in IMPOSSIBLE])
def test_a_frame_that_cannot_be_is_refused_with_its_number(write, old, new, words) -> None:
    study = load_study(write(STUDY.replace(old, new, 1)))
    with pytest.raises(StudyError, match=words) as caught:
        list(frames_of(study))
    assert "frame 0 of group main" in str(caught.value) or "frame 1 of group main" in str(caught.value)


@pytest.mark.parametrize(
    "data", [b"", b"[1, 2]", b"\xff\xfe\x00", b"a" * 1_000_001, b"{" * 40 + b"}" * 40, b"just a word", b"\x00"]
)
def test_what_is_no_study_at_all(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "study.yaml"
    path.write_bytes(data)
    with pytest.raises(StudyError):
        load_study(path)
    with pytest.raises(StudyError, match="cannot read"):
        load_study(tmp_path / "none.yaml")


@given(st.text(max_size=200))
def test_any_text_is_read_or_refused_in_one_line(tmp_path_factory, text: str) -> None:
    path = tmp_path_factory.mktemp("any") / "study.yaml"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    message = ""
    try:
        load_study(path)
    except StudyError as error:
        message = str(error)
    assert "\n" not in message


def test_a_study_error_survives_the_way_between_processes() -> None:
    error = StudyError("no such key", "study.yaml", 3, 5)
    back = pickle.loads(pickle.dumps(error))
    assert str(back) == str(error) == "study.yaml:3:5: no such key"
    assert (back.line, back.column) == (3, 5)


def test_scalars_are_those_of_yaml_1_2(write) -> None:
    path = write("a: 1e-3\nb: no\nc: 012\nd: 0o14\ne: '1'\nf: on\ng: 1:30\nh: -.inf\ni: true\nj: ~\nk: 2001-01-01\n")
    value, _ = read_yaml(path)
    expected = {"a": 1e-3, "b": "no", "c": 12, "d": 12, "e": "1", "f": "on", "g": "1:30", "h": float("-inf"), "i": True}
    assert value == {**expected, "j": None, "k": "2001-01-01"}


def test_groups_share_what_stands_above_them(write) -> None:
    text = STUDY.replace(
        "frames_per_cell: 2", "frames_per_cell: 2\ngroups:\n  a: {}\n  b:\n    pose: {tilt_deg: 30}\n    frames: 2\n"
    )
    study = load_study(write(text))
    assert study.groups["a"].pose.azimuth_deg == study.groups["b"].pose.azimuth_deg
    assert study.groups["b"].pose.tilt_deg == 30
    assert study.groups["b"].frames_per_cell is None
    assert total_frames(study) == 8 + 2


def test_a_group_may_change_the_kind_of_marker(write) -> None:
    text = STUDY + "groups:\n  b:\n    marker: {kind: chessboard, columns: 5, rows: 4, square_m: 0.01}\n"
    assert load_study(write(text)).groups["b"].marker.kind == "chessboard"


def test_resolved_study_reads_back_the_same(write, tmp_path: Path) -> None:
    study = load_study(write(STUDY))
    again = tmp_path / "again.yaml"
    again.write_text(yaml.safe_dump(study.resolved(), sort_keys=False))
    back = load_study(again)
    assert back.resolved() == study.resolved()
    assert back.digest() == study.digest()


def test_digest_tells_frames_apart_and_nothing_else(write) -> None:
    study = load_study(write(STUDY))
    assert load_study(write(STUDY.replace("tiny", "other"))).digest() == study.digest()
    assert load_study(write(STUDY + "solve: {intrinsics: [default]}\n")).digest() == study.digest()
    assert load_study(write(STUDY.replace("seed: 3", "seed: 4"))).digest() != study.digest()


def test_sweep_repeats_the_same_frames(write) -> None:
    study = load_study(write(STUDY + "sweep: {key: sensor.read_noise_e, levels: [0, 5, 20]}\n"))
    frames = list(frames_of(study))
    assert len(frames) == 3 * 8
    assert [f.settings.sensor.read_noise_e for f in frames[::8]] == [0, 5, 20]
    for one, other in zip(frames[:8], frames[8:16], strict=True):
        assert (one.camera_from_sheet == other.camera_from_sheet).all()
        assert one.noise_seed == other.noise_seed


def test_sweep_of_a_key_that_is_not_there(write) -> None:
    study = load_study(write(STUDY + "sweep: {key: sensor.raed_noise_e, levels: [0]}\n"))
    with pytest.raises(StudyError, match="sensor"):
        frame_of(study, 0)


@pytest.fixture(scope="module")
def schema() -> jsonschema.Draft202012Validator:
    """The published schema, itself checked once: it is large."""
    published = json.loads(json.dumps(json_schema()))
    jsonschema.Draft202012Validator.check_schema(published)
    return jsonschema.Draft202012Validator(published)


@pytest.mark.parametrize("path", CONFIGS, ids=[p.stem for p in CONFIGS])
def test_shipped_studies_are_well(path: Path, schema: jsonschema.Draft202012Validator) -> None:
    study = load_study(path)
    frame_of(study, 0)
    frame_of(study, total_frames(study) - 1)
    schema.validate(yaml.safe_load(path.read_text()))


def test_json_schema_refuses_a_misspelt_key(schema: jsonschema.Draft202012Validator) -> None:
    raw = yaml.safe_load(STUDY)
    schema.validate(raw)
    raw["camera"]["focl_px"] = 3
    with pytest.raises(jsonschema.ValidationError):
        schema.validate(raw)


def _properties(node: object, where: str = "") -> list[tuple[str, dict]]:
    if isinstance(node, list):
        return [found for i, item in enumerate(node) for found in _properties(item, f"{where}[{i}]")]
    if not isinstance(node, dict):
        return []
    own = node.get("properties")
    mine = [(f"{where}.{key}", value) for key, value in own.items()] if isinstance(own, dict) else []
    return mine + [found for key, value in node.items() for found in _properties(value, f"{where}/{key}")]


def test_every_key_of_the_schema_is_described() -> None:
    properties = _properties(json_schema())
    assert len(properties) > 1000  # with the five kinds of distribution at each number
    assert [where for where, value in properties if not value.get("description")] == []
