"""A study's id and the values of its frames: neither changes unless SAMPLING_VERSION does."""

import json
from pathlib import Path

import pytest
from helpers_golden import GOLDEN, STUDIES, record_of, schema_defaults
from helpers_studies import finished_frames

from roundel.datasets.numbers import check_resumable, other_numbers
from roundel.datasets.verify import verify_dataset
from roundel.render.run import render_study
from roundel.scenes.errors import DataError
from roundel.scenes.study import identity, sampling
from roundel.scenes.study.identity import frame_digest
from roundel.scenes.study.study import load_study
from roundel.scenes.world.frame import frame_of

REMEDY = "other frames than before: raise SAMPLING_VERSION and run tests/helpers/make_golden.py"

STUDY = """\
schema: 1
name: small
seed: 5
camera: {width_px: 96, height_px: 80, focal_px: 120}
marker: {kind: disc, diameter_m: 0.08}
pose: {distance_D: {uniform: [2.5, 3]}, tilt_deg: {uniform: [10, 40]}, azimuth_deg: {uniform: [-180, 180]}}
render: {band_samples: 64, radiance: false}
frames: 4
"""


def golden(name: str) -> dict:
    return json.loads((GOLDEN / f"{name}.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", STUDIES)
def test_a_shipped_study_means_the_same_frames(name: str) -> None:
    record, now = golden(name), json.loads(json.dumps(record_of(name)))
    assert now["dataset_id"] == record["dataset_id"], REMEDY
    assert now["groups"] == record["groups"], REMEDY
    assert now["frames"].keys() == record["frames"].keys()
    for frame_id, numbers in record["frames"].items():
        found = now["frames"][frame_id]
        assert found["seeds"] == numbers["seeds"], REMEDY
        assert [found[k] for k in ("group", "index", "level")] == [numbers[k] for k in ("group", "index", "level")]
        # The numbers are rounded to nine digits; one unit of the ninth may fall either way on another machine.
        assert found["drawn"] == pytest.approx(numbers["drawn"], rel=2e-9), REMEDY
        assert found.get("world") == numbers.get("world"), REMEDY
        for key in ("K", "camera_from_sheet"):
            assert found[key] == pytest.approx(numbers[key], abs=2e-9, rel=0), REMEDY


def test_no_default_changed() -> None:
    now = json.loads(json.dumps(schema_defaults()))
    changed = {key: (value, now.get(key)) for key, value in golden("_defaults").items() if now.get(key) != value}
    # A section within another may have a key more: its own keys are records, too.
    changed = {key: (a, b) for key, (a, b) in changed.items() if not _has_more(a, b)}
    assert {key: pair for key, pair in changed.items() if not key.startswith("GroupSection.")} == {}, REMEDY


def _has_more(old: object, new: object) -> bool:
    return isinstance(old, dict) and isinstance(new, dict) and {k: new.get(k) for k in old} == old


def test_no_golden_record_is_left_over() -> None:
    assert {path.stem for path in GOLDEN.glob("*.json")} == {*STUDIES, "_defaults"}


def test_a_key_at_its_default_is_no_other_study(tmp_path: Path) -> None:
    plain, spelled = tmp_path / "a.yaml", tmp_path / "b.yaml"
    plain.write_text(STUDY)
    default = load_study(plain).groups["main"].sensor.read_noise_e
    spelled.write_text(STUDY + f"sensor: {{read_noise_e: {default}}}\n")
    assert load_study(plain).digest() == load_study(spelled).digest()


def test_groups_in_another_order_are_another_study(tmp_path: Path) -> None:
    # Frame ids follow the order of the groups.
    base = STUDY.replace("frames: 4\n", "")
    one, other = tmp_path / "a.yaml", tmp_path / "b.yaml"
    one.write_text(base + "groups: {a: {frames: 1}, b: {frames: 2}}\n")
    other.write_text(base + "groups: {b: {frames: 2}, a: {frames: 1}}\n")
    assert load_study(one).digest() != load_study(other).digest()


def test_the_sampling_version_is_part_of_the_id(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.yaml"
    path.write_text(STUDY)
    before = load_study(path).digest()
    monkeypatch.setattr(identity, "SAMPLING_VERSION", identity.SAMPLING_VERSION + 1)
    assert load_study(path).digest() != before


@pytest.fixture
def draws_otherwise(monkeypatch: pytest.MonkeyPatch):
    """Code whose sequence is scrambled with another seed, as a later release, or SciPy's, might have it."""

    def change() -> None:
        plain = sampling.stream
        sampling._points.cache_clear()
        monkeypatch.setattr(sampling, "stream", lambda seed, group, *purpose: plain(seed + 1, group, *purpose))

    yield change
    sampling._points.cache_clear()


def test_frames_drawn_otherwise_are_not_added(tmp_path: Path, draws_otherwise) -> None:
    path, dataset = tmp_path / "study.yaml", tmp_path / "ds"
    path.write_text(STUDY)
    assert render_study(path, dataset, frames=range(2)) is None
    kept = finished_frames(dataset, load_study(path))
    assert len(kept) == 2
    draws_otherwise()
    with pytest.raises(DataError, match="frame 0 was rendered with other values"):
        render_study(path, dataset)
    assert finished_frames(dataset, load_study(path)) == kept


def test_verify_draws_the_numbers_again(tmp_path: Path, draws_otherwise) -> None:
    path, dataset = tmp_path / "study.yaml", tmp_path / "ds"
    path.write_text(STUDY)
    assert render_study(path, dataset) is not None
    study = load_study(path)
    assert [e["numbers_sha256"] for e in finished_frames(dataset, study).values()] == [
        frame_digest(frame_of(study, i)) for i in range(4)
    ]
    assert verify_dataset(dataset, full=True) == []
    draws_otherwise()
    (finding,) = verify_dataset(dataset, full=True)
    assert "4 frames (the first is 0) were rendered with other values" in str(finding)


def test_datasets_without_checksums_of_numbers_are_read_and_not_added_to(tmp_path: Path) -> None:
    path, dataset = tmp_path / "study.yaml", tmp_path / "ds"
    path.write_text(STUDY)
    assert render_study(path, dataset, frames=range(2)) is None
    study = load_study(path)
    entries = finished_frames(dataset, study)
    for entry in entries.values():
        del entry["numbers_sha256"]
    with pytest.raises(DataError, match="did not record the values"):
        check_resumable(dataset, study, entries)
    assert other_numbers(study, entries) == []
