"""The league: outcomes frame by frame, standings, the page, submissions, and a part that is held back."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
import pytest
from helpers_reports import make_dataset

from roundel.cli.main import main
from roundel.datasets.dataset import open_dataset
from roundel.scenes.errors import DataError, NotComparableError, UsageError
from roundel.solver.estimates import Estimate, write_estimates
from roundel.validate.estimates.runs import read_runs
from roundel.validate.league.entries import ENTRIES, Entry
from roundel.validate.league.figure import league_pictures, winners
from roundel.validate.league.held_back import hold_back, open_held_back, salted
from roundel.validate.league.league import OUTCOMES, RECORD, Solved, outcomes_of_entries, write_league
from roundel.validate.league.outcomes import frames_of_league, outcomes_of
from roundel.validate.league.standings import standings_of
from roundel.validate.league.submission import published, submitted_outcomes

STUDY = """\
schema: 1
name: small league
seed: 8
camera: {width_px: 160, height_px: 120, focal_px: {grid: [130, 150]}}
pose: {distance_m: {uniform: [0.3, 0.4]}, tilt_deg: {uniform: [10, 40]}, azimuth_deg: {uniform: [-180, 180]}}
render: {target_error: 0.05, radiance: false}
frames: 2
groups:
  near: {}
  far: {pose: {distance_m: {uniform: [0.5, 0.6]}}}
variants:
  disc: {marker: {kind: disc, diameter_m: 0.08}}
  two_discs: {marker: {kind: two_discs, diameter_m: 0.04, second_diameter_m: 0.04, spacing_m: 0.06}}
  tag: {marker: {kind: tags, tag_m: 0.07, first_id: 9}}
"""


@pytest.fixture(scope="module")
def league(tmp_path_factory):
    """A dataset of twelve frames."""
    folder = tmp_path_factory.mktemp("league")
    return make_dataset(folder / "data", STUDY)


def estimate(dataset, frame_id, part=0, **changes):
    """The true pose of a part, as an estimate."""
    row = dataset.truth.filter(pa.compute.field("frame_id") == frame_id).to_pylist()[part]
    camera = dataset.images.camera(dataset.images.frame_ids.index(frame_id))
    given = {
        "normal": np.array([[row[f"normal_{a}"] for a in "xyz"]]),
        "centre_m": np.array([[row[f"centre_{a}_m"] for a in "xyz"]]),
        "camera": camera,
        "chosen": 0,
        **changes,
    }
    return Estimate(frame_id, given.pop("detection_id", part), "mine", "true", "ok", **given)


def run_of(dataset, folder: Path, estimates):
    write_estimates(estimates, folder / "estimates.parquet", dataset.manifest["dataset_id"])
    (run,) = read_runs([folder / "estimates.parquet"], dataset)
    return run


def frames_of(dataset, variant):
    return [f for f, shown in frames_of_league(dataset).items() if shown.variant == variant]


def test_every_frame_has_its_condition_marker_and_identity(league):
    truth = frames_of_league(league)
    assert [(s.condition, s.variant) for s in truth.values()] == [
        (c, v) for c in ("near", "far") for v in ("disc", "two_discs", "tag") for _ in range(2)
    ]
    assert {s.identity for s in truth.values() if s.variant == "tag"} == {9}
    assert {s.identity for s in truth.values() if s.variant != "tag"} == {None}
    assert [len(s.normal) for s in truth.values()][:6] == [1, 1, 2, 2, 1, 1]
    # A disc of 80 mm and a square of 70 mm have nearly the same area.
    radii = {v: np.mean([s.radius_px[0] for s in truth.values() if s.variant == v]) for v in ("disc", "tag")}
    assert radii["tag"] / radii["disc"] == pytest.approx(0.07 * (4 / np.pi) ** 0.5 / 0.08, rel=0.02)


def test_outcomes_of_right_wrong_and_missing_answers(league, tmp_path):
    first, second, third, fourth = frames_of(league, "tag")
    turned = estimate(league, second)
    off = np.array([[0.0, 0.6, -0.8]])
    away = estimate(league, third).centre_m + np.array([[0.2, 0.0, 0.0]])
    run = run_of(
        league,
        tmp_path,
        [
            estimate(league, first, identity=9, focal_px=130.0 * 1.02, focal_sigma_px=1.3),
            estimate(league, second, identity=8, normal=off, chosen=None),
            estimate(league, third, centre_m=away),
            Estimate(fourth, -1, "mine", "true", "failed", "nothing there"),
        ],
    )
    table = outcomes_of("mine", ("tag",), run, frames_of_league(league), {first: 12.5}).to_pylist()
    good, wrong, elsewhere, none = table
    assert (good["found"], good["false_detections"], good["identity_correct"], good["time_ms"]) == (True, 0, True, 12.5)
    assert good["normal_error_deg"] < 1e-5
    assert good["chosen_normal_error_deg"] < 1e-5
    assert good["position_error_pct"] < 1e-9
    assert good["focal_error_pct"] == pytest.approx(2.0, abs=1e-6)
    # One per cent against 11.5: the fusion stays near the measurement.
    assert good["fused_focal_error_pct"] < 2.4
    assert good["prior_focal_error_pct"] == pytest.approx(100 * abs(29.95 * 200 / 43.2666 / 130 - 1), rel=1e-4)
    assert (wrong["found"], wrong["identity_read"], wrong["identity_correct"]) == (True, True, False)
    true = turned.normal[0]
    assert wrong["normal_error_deg"] == pytest.approx(np.degrees(np.arccos(off[0] @ true)), rel=1e-6)
    assert wrong["chosen_normal_error_deg"] is None
    assert wrong["prior_focal_error_pct"] is None  # nothing was measured that it could be compared with
    assert (elsewhere["found"], elsewhere["false_detections"]) == (False, 1)
    assert (none["found"], none["false_detections"], none["reason"]) == (False, 0, "nothing there")


def test_detections_of_both_discs_are_no_false_ones(league, tmp_path):
    frame = frames_of(league, "two_discs")[0]
    stray = estimate(league, frame, part=1, detection_id=2)
    run = run_of(league, tmp_path, [estimate(league, frame, 1), estimate(league, frame, 0), stray])
    row = outcomes_of("mine", ("two_discs",), run, frames_of_league(league)).to_pylist()[0]
    assert (row["found"], row["false_detections"]) == (True, 1)
    assert row["position_error_pct"] < 1e-9


def test_of_two_poses_the_better_counts_and_the_choice_is_scored(league, tmp_path):
    frames = frames_of(league, "disc")
    both = []
    for frame in frames[:2]:
        one = estimate(league, frame)
        mirrored = one.normal[0] * np.array([-1.0, -1.0, 1.0])
        pair = sorted([(one.normal[0], True), (mirrored, False)], key=lambda n: n[0][2])
        right = next(i for i, (_, is_right) in enumerate(pair) if is_right)
        both.append((frame, np.array([n for n, _ in pair]), np.repeat(one.centre_m, 2, axis=0), right))
    run = run_of(
        league,
        tmp_path,
        [
            estimate(league, frame, normal=normal, centre_m=centre, chosen=right if i == 0 else 1 - right)
            for i, (frame, normal, centre, right) in enumerate(both)
        ],
    )
    good, wrong = outcomes_of("mine", ("disc",), run, frames_of_league(league)).to_pylist()[:2]
    assert (good["branch_correct"], wrong["branch_correct"]) == (True, False)
    assert wrong["normal_error_deg"] < 1e-5 < wrong["chosen_normal_error_deg"]


def test_a_method_with_one_pose_has_chosen_too(league, tmp_path):
    frames = frames_of(league, "disc")[:2]
    right, wrong = (estimate(league, frame) for frame in frames)
    normal, sight = wrong.normal[0], wrong.centre_m[0] / np.linalg.norm(wrong.centre_m[0])
    turned = estimate(league, frames[1], normal=(2 * (normal @ sight) * sight - normal)[None])
    run = run_of(league, tmp_path, [right, turned])
    rows = outcomes_of("mine", ("disc",), run, frames_of_league(league)).to_pylist()[:2]
    assert [row["branch_correct"] for row in rows] == [True, False]


@pytest.fixture(scope="module")
def made(league, tmp_path_factory):
    """The page of two entries: a perfect one, and one that finds half."""
    folder = tmp_path_factory.mktemp("made")
    solved = []
    for name, step in (("perfect", 1), ("half", 2)):
        (folder / name).mkdir()
        frames = frames_of(league, "disc")[::step]
        write_estimates(
            [estimate(league, f) for f in frames], folder / name / "estimates.parquet", league.manifest["dataset_id"]
        )
        solved.append(Solved(Entry(name, "mine", ("disc",), ""), folder / name))
    outcomes = outcomes_of_entries(league, solved)
    return folder, outcomes, write_league(league, outcomes, folder / "page", ["absent"])


def test_standings_count_every_frame(made):
    _, outcomes, _ = made
    standings = standings_of(outcomes)
    assert [(s.entry, s.condition, s.frames) for s in standings] == [
        (e, c, n) for e in ("perfect", "half") for c, n in (("all", 4), ("near", 2), ("far", 2))
    ]
    perfect, half = standings[0], standings[3]
    assert (perfect.rates["found"].value, half.rates["found"].value) == (1.0, 0.5)
    assert half.rates["found"].low < 0.5 < half.rates["found"].high
    assert half.errors["normal_error_deg"].n == 2


def test_the_winner_is_the_better_one(made):
    standings = standings_of(made[1])
    assert winners(standings, "recall")["near"][0] == "disc: perfect"
    # An entry that finds too little wins nothing by what it found.
    few = [s for s in standings if s.entry == "half"]
    assert set(winners(few, "position")) == {"near", "far"}
    assert len(league_pictures(standings)) == 1


def test_the_page_and_what_machines_read(league, made):
    folder, _, record = made
    page = (folder / "page" / "league.html").read_text(encoding="utf-8")
    assert "Who wins where" in page
    assert "absent" in page
    assert "://" not in page.replace("http://www.w3.org", "")
    assert json.loads((folder / "page" / RECORD).read_text()) == record
    assert record["dataset"]["dataset_id"] == league.manifest["dataset_id"]
    assert (folder / "page" / "tables" / "overall.csv").is_file()


def csv_of(league, file: Path, frames, dataset_id=None, **more):
    rows = []
    for f in frames:
        e = estimate(league, f)
        row = {"frame_id": f, **dict(zip(("normal_x", "normal_y", "normal_z"), e.normal[0].tolist(), strict=True))}
        row |= dict(zip(("centre_x_m", "centre_y_m", "centre_z_m"), e.centre_m[0].tolist(), strict=True))
        rows.append(row | {"dataset_id": dataset_id or league.manifest["dataset_id"][:12]} | more)
    pa_csv.write_csv(pa.Table.from_pylist(rows), file)
    return file


def test_a_submission_stands_beside_the_published_table(league, made, tmp_path, capsys):
    file = csv_of(league, tmp_path / "outside.csv", frames_of(league, "disc"))
    where = ["--dataset", str(league.path), "--against", str(made[0] / "page"), "--out", str(tmp_path / "page")]
    code = main(["league", "score", str(file), *where])
    said = capsys.readouterr().out
    assert code == 0
    assert "outside" in said
    assert "perfect" not in said
    standings = json.loads((tmp_path / "page" / RECORD).read_text())["standings"]
    assert {s["entry"] for s in standings} == {"outside", "perfect", "half"}


def test_submissions_that_cannot_be_compared(league, made, tmp_path):
    frames = frames_of(league, "disc")
    short = csv_of(league, tmp_path / "short.csv", frames[1:])
    with pytest.raises(NotComparableError, match=r"no row for 1 of the 4 frames of disc, the first 0;"):
        submitted_outcomes(short, league)
    other = csv_of(league, tmp_path / "other.csv", frames, dataset_id="0123456789ab")
    with pytest.raises(NotComparableError, match=r"of dataset 0123456789ab, but .* is [0-9a-f]{12}; give"):
        submitted_outcomes(other, league)
    table = pa_csv.read_csv(other).drop_columns(["dataset_id"])
    pa_csv.write_csv(table, tmp_path / "bare.csv")
    with pytest.raises(UsageError, match=r"does not say of which dataset it is; add a column dataset_id"):
        submitted_outcomes(tmp_path / "bare.csv", league)
    assert main(["league", "score", str(short), "--dataset", str(league.path), "--out", str(tmp_path / "x")]) == 3
    assert main(["league", "score", str(other), "--dataset", str(league.path), "--out", str(tmp_path / "x")]) == 3
    assert not (tmp_path / "x").exists()


def test_one_name_for_two_methods_is_refused(league, tmp_path):
    frames = frames_of(league, "disc")
    one, other = (pa_csv.read_csv(csv_of(league, tmp_path / f"{m}.csv", frames, method=m)) for m in ("one", "other"))
    pa_csv.write_csv(pa.concat_tables([one, other]), tmp_path / "both.csv")
    assert set(submitted_outcomes(tmp_path / "both.csv", league)["entry"].to_pylist()) == {"one", "other"}
    with pytest.raises(UsageError, match=r"holds 2 methods \(one, other\); leave out --name, or split it"):
        submitted_outcomes(tmp_path / "both.csv", league, "mine")


def test_what_is_no_league_is_refused_before_any_work(league, tmp_path, capsys):
    plain = STUDY.partition("groups:")[0] + "marker: {kind: disc, diameter_m: 0.08}\n"
    (tmp_path / "plain.yaml").write_text(plain)
    assert main(["league", "run", str(tmp_path / "out"), "--study", str(tmp_path / "plain.yaml")]) == 2
    assert "no group is named CONDITION.VARIANT; add `variants`" in capsys.readouterr().err
    assert main(["league", "run", str(tmp_path / "out"), "--truth", str(tmp_path)]) == 2
    assert "give them with --dataset" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    data = make_dataset(tmp_path / "data", plain)
    with pytest.raises(NotComparableError, match=r"no group is named CONDITION\.VARIANT"):
        hold_back(data.path, tmp_path / "public", tmp_path / "kept")
    points = STUDY.replace("frames: 2\n", "frames: 2\nmode: points\n").partition("  two_discs:")[0]
    with pytest.raises(NotComparableError, match="frames of points, without images"):
        hold_back(make_dataset(tmp_path / "points", points).path, tmp_path / "public", tmp_path / "kept")
    assert not (tmp_path / "public").exists()


def test_a_league_of_another_truth_is_refused(league, made, tmp_path):
    page = tmp_path / "page"
    page.mkdir()
    record = json.loads((made[0] / "page" / RECORD).read_text())
    data = (made[0] / "page" / OUTCOMES).read_bytes()
    (page / OUTCOMES).write_bytes(data)
    record["dataset"]["truth_sha256"] = "0" * 64
    (page / RECORD).write_text(json.dumps(record))
    with pytest.raises(NotComparableError, match=r"its truth is 000000000000, that of"):
        published(page, league)
    (page / OUTCOMES).write_bytes(data[:-1])
    with pytest.raises(DataError, match="not the folder of a league"):
        published(page, league)
    with pytest.raises(DataError, match="not the folder of a league"):
        published(tmp_path, league)


def test_a_part_is_held_back(league, tmp_path, capsys):
    both = hold_back(league.path, tmp_path / "public", tmp_path / "kept")
    public = b"".join(p.read_bytes() for p in sorted(both.public.rglob("*.json")))
    assert sorted(p.name for p in both.public.iterdir()) == ["cameras.json", "images", "manifest.json"]
    # Neither the seed's hash nor an identity is in it, and nothing of the truth.
    assert league.manifest["dataset_id"].encode() not in public
    assert b"first_id" not in public
    opened = open_held_back(both.public, both.kept)
    assert opened.truth.equals(league.truth)
    assert {s.identity for s in frames_of_league(opened).values() if s.variant == "tag"} == {9}
    # It is solved like every dataset, and scored with the truth alone.
    assert main(["solve", str(both.public), str(tmp_path / "est"), "--method", "ml", "--group", "near.disc"]) == 0
    with pytest.raises(DataError):
        open_dataset(both.public)
    csv = csv_of(league, tmp_path / "mine.csv", frames_of(league, "disc"), opened.manifest["dataset_id"])
    arguments = ["league", "score", str(csv), "--dataset", str(both.public), "--out", str(tmp_path / "page")]
    assert main([*arguments, "--truth", str(both.kept)]) == 0
    assert main(arguments) == 4
    capsys.readouterr()


def test_another_truth_than_the_published_one_is_refused(league, tmp_path):
    both = hold_back(league.path, tmp_path / "public", tmp_path / "kept")
    with pytest.raises(UsageError, match="is there already"):
        hold_back(league.path, tmp_path / "public", tmp_path / "kept2")
    shifted = league.truth.set_column(
        league.truth.column_names.index("tilt_deg"), "tilt_deg", pa.array(np.zeros(league.truth.num_rows))
    )
    pq.write_table(shifted, both.kept / "truth.parquet")
    with pytest.raises(NotComparableError, match="not the truth that"):
        open_held_back(both.public, both.kept)
    with pytest.raises(NotComparableError, match="nothing is held back"):
        open_held_back(league.path, both.kept)


def test_the_commitment_hides_by_its_salt():
    assert salted("00" * 32, b"truth") != salted("01" * 32, b"truth")


def test_every_entry_names_variants_of_the_study_and_every_catalogue_name_is_in():
    from roundel.scenes.study.yaml_reader import read_yaml
    from roundel.solver.catalogue import CATALOGUE

    house = Path(__file__).resolve().parents[3]
    raw, _ = read_yaml(house / "configs" / "league.yaml")
    variants = set(raw["variants"])
    assert all(set(entry.variants) <= variants for entry in ENTRIES)
    assert {entry.name for entry in CATALOGUE} - {"circles_grid"} <= {entry.method for entry in ENTRIES}
    kinds = {name: keys["marker"]["kind"] for name, keys in raw["variants"].items()}
    for entry in ENTRIES:
        listed = next((one for one in CATALOGUE if one.name == entry.method), None)
        if listed is not None:
            assert {kinds[v] for v in entry.variants} <= set(listed.markers), entry.name
