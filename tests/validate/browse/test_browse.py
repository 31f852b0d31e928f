"""The page of `roundel browse`: its files, its numbers against truth and scores, hostile names, and bad input."""

from __future__ import annotations

import io
import json
import re
import shutil
from html.parser import HTMLParser
from importlib import resources
from pathlib import Path
from typing import Any

import helpers_reports
import numpy as np
import pyarrow.parquet as pq
import pytest
from helpers_reports import POINTS, estimate_rows, failed_row, make_dataset, write_estimates
from PIL import Image

from roundel.cli.main import main
from roundel.datasets.dataset import Dataset, open_dataset
from roundel.datasets.pull import pull_dataset
from roundel.scenes.errors import DataError, NotComparableError, UsageError
from roundel.validate.browse import page_folder
from roundel.validate.browse.outlines import PER_PX, packed, packed_outline
from roundel.validate.browse.page import browse_dataset
from roundel.validate.browse.thumbnails import LONG_SIDE_PX, thumbnail
from roundel.validate.validate import validate_dataset

# Two groups; the second has a board and no circle.
IMAGES = """\
schema: 1
name: pictures
seed: 6
camera: {width_px: 320, height_px: 200, focal_px: 400, distortion: [-0.1, 0.02, 0.0005, -0.0007]}
groups:
  discs:
    marker: {kind: two_discs, diameter_m: 0.08, second_diameter_m: 0.08, spacing_m: 0.12}
    pose: {tilt_deg: {uniform: [10, 50]}, distance_D: {uniform: [6, 12]}, azimuth_deg: {uniform: [-180, 180]}}
    frames: 5
  boards:
    marker: {kind: chessboard, columns: 5, rows: 4, square_m: 0.02}
    pose: {tilt_deg: 20, distance_m: 0.6}
    frames: 2
solve: {groups: [discs], methods: [ml], intrinsics: ["true", "scaled:0.7"]}
"""
LOST = (3, 1)  # a frame and marker that no method solves


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return make_dataset(tmp_path_factory.mktemp("browse") / "ds", IMAGES)


@pytest.fixture(scope="module")
def report(dataset: Dataset) -> Path:
    rows = [
        *estimate_rows(dataset, ["true", "scaled:0.7"], 0.1, "ml"),
        *estimate_rows(dataset, ["true"], 0.3, "aa_other"),
    ]
    rows = [row for row in rows if (row["frame_id"], row["detection_id"]) != LOST]
    out = dataset.path.parent / "report"
    validate_dataset(dataset.path, [write_estimates(dataset.path.parent / "e.parquet", rows)], out)
    return out


@pytest.fixture(scope="module")
def points(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return make_dataset(tmp_path_factory.mktemp("points") / "ds", POINTS.replace("frames_per_cell: 4", "frames: 9"))


def data_of(page: Path) -> dict[str, Any]:
    """What data.js and the scripts of scores hold."""
    head, *rest = (page / "data.js").read_text(encoding="ascii").splitlines()
    data = json.loads(head.removeprefix("const ROUNDEL = ").removesuffix(";"))
    data["shards"] = [json.loads(line.removeprefix("ROUNDEL.shards.push(").removesuffix(");")) for line in rest]
    for number in range(len(data["runs"])):
        text = (page / "scores" / f"{number:03d}.js").read_text(encoding="ascii")
        data["scores"][number] = json.loads(text.removeprefix(f"ROUNDEL.scores[{number}] = ").removesuffix(";\n"))
    return data


def files_of(page: Path) -> dict[str, bytes]:
    return {str(p.relative_to(page)): p.read_bytes() for p in sorted(page.rglob("*")) if p.is_file()}


def unpacked(steps: list[int]) -> np.ndarray:
    return np.cumsum(np.reshape(steps, (-1, 2)), axis=0) / PER_PX


def curve_through(points: np.ndarray) -> np.ndarray:
    """The closed Catmull-Rom curve that pictures.js draws, densely."""
    before, after, later = (np.roll(points, shift, axis=0) for shift in (1, -1, -2))
    t = np.linspace(0, 1, 96, endpoint=False)[:, None, None]
    bezier = (points, points + (after - before) / 6, after - (later - points) / 6, after)
    weights = ((1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3)
    return sum(w * p for w, p in zip(weights, bezier, strict=True)).reshape(-1, 2)


def test_the_page_has_every_frame_and_marker(dataset: Dataset, tmp_path: Path) -> None:
    assert browse_dataset(dataset.path, tmp_path / "page") == 7
    assets = set(page_folder.ASSETS)
    thumbs = {f"thumbs/{i:06d}.jpg" for i in range(7)}
    assert set(files_of(tmp_path / "page")) == {"index.html", "data.js", *assets, *thumbs}
    (shard,) = data_of(tmp_path / "page")["shards"]
    assert shard["frames"]["id"] == list(range(7))
    assert shard["frames"]["group"] == ["discs"] * 5 + ["boards"] * 2
    assert set(shard["frames"]["suffix"]) == {".png"}
    truth = dataset.truth.to_pylist()
    assert [
        (shard["frames"]["id"][f], m) for f, m in zip(shard["markers"]["frame"], shard["markers"]["id"], strict=True)
    ] == [(row["frame_id"], row["marker_id"]) for row in truth]
    for key in ("distance_D", "tilt_deg", "visible_fraction", "edge_blur_px"):
        want = [np.nan if row[key] is None else row[key] for row in truth]
        got = [np.nan if value is None else value for value in shard["markers"][key]]
        np.testing.assert_allclose(got, want, rtol=1e-4)  # five digits


def test_outlines_are_the_true_contours(dataset: Dataset, tmp_path: Path) -> None:
    browse_dataset(dataset.path, tmp_path / "page")
    (shard,) = data_of(tmp_path / "page")["shards"]
    for i, row in enumerate(dataset.truth.to_pylist()):
        contour = np.stack([row["contour_x_px"], row["contour_y_px"]], axis=-1)
        drawn = unpacked(shard["markers"]["outline"][i])
        assert shard["markers"]["closed"][i]
        if row["radius_m"] is not None:
            assert len(drawn) <= 64
            off = np.linalg.norm(curve_through(drawn)[:, None] - contour, axis=-1)
            # The contour's own points are within 0.02 px of the curve, whose dense points are 0.07 px apart here.
            assert off.min(axis=0).max() < 0.06
        else:
            # A corner of a board is a corner of its outline.
            assert np.linalg.norm(drawn - contour[0], axis=-1).min() < 0.01


@pytest.mark.parametrize(("a", "b"), [(3.0, 2.0), (40.0, 10.0), (300.0, 220.0), (900.0, 80.0)])
def test_a_smooth_curve_through_few_points_is_the_ellipse(a: float, b: float) -> None:
    t = np.linspace(0, 2 * np.pi, 256, endpoint=False)
    steps, closed = packed_outline(400 + a * np.cos(t), 300 + b * np.sin(t))
    curve = curve_through(unpacked(steps)) - (400, 300)
    # Distance from the ellipse to first order: 0.02 px of the curve, 0.007 px of rounding.
    level = np.hypot(curve[:, 0] / a, curve[:, 1] / b) - 1
    slope = np.hypot(curve[:, 0] / a**2, curve[:, 1] / b**2)
    assert closed
    assert np.max(np.abs(level / slope)) < 0.03


def test_an_outline_behind_the_camera_is_open() -> None:
    x, y = np.arange(8.0), np.zeros(8)
    x[2:5] = np.nan
    steps, closed = packed_outline(x, y)
    assert not closed
    assert unpacked(steps)[:, 0].tolist() == [5, 6, 7, 0, 1]
    assert packed_outline(np.full(8, np.nan), y) == ([], False)
    assert packed_outline(np.empty(0), np.empty(0)) == ([], False)
    assert packed(np.empty((0, 2))) == []


def test_frames_of_points_have_dots_and_no_thumbnail(points: Dataset, tmp_path: Path) -> None:
    browse_dataset(points.path, tmp_path / "page", copy_images=True)
    (shard,) = data_of(tmp_path / "page")["shards"]
    assert set(shard["frames"]["suffix"]) == {None}
    assert list((tmp_path / "page" / "thumbs").iterdir()) == []
    for i, steps in enumerate(shard["markers"]["points"]):
        dots, known = unpacked(steps), points.images.points(i)[0]
        assert 0 < len(dots) <= 64
        assert np.linalg.norm(dots[:, None] - known, axis=-1).min(axis=1).max() < 0.01


def test_scores_are_those_of_the_report(dataset: Dataset, report: Path, tmp_path: Path) -> None:
    browse_dataset(dataset.path, tmp_path / "page", report)
    data = data_of(tmp_path / "page")
    # A board in the dataset is a reference of its own, which solves none of these discs.
    assert data["runs"] == ["aa_other, true", "ml, true", "ml, focal x 0.7", "the chessboard's own pose, true"]
    assert data["run"] == 0  # a method that is not Roundel's own is the user's, and leads
    assert '<script src="scores/000.js">' in (tmp_path / "page" / "index.html").read_text()
    (shard,) = data["shards"]
    keys = [
        (shard["frames"]["id"][f], m) for f, m in zip(shard["markers"]["frame"], shard["markers"]["id"], strict=True)
    ]
    runs = [("aa_other", "true"), ("ml", "true"), ("ml", "scaled:0.7")]
    scores = {
        (r["method"], r["intrinsics"], r["frame_id"], r["marker_id"]): r
        for r in pq.read_table(report / "scores.parquet").to_pylist()
    }
    for number, run in enumerate(runs):
        columns = data["scores"][number]
        for i, (frame_id, marker_id) in enumerate(keys):
            row = scores.get((*run, frame_id, marker_id))
            if row is None:
                assert frame_id >= 5  # boards have no scores
                assert columns["solved"][i] is columns["oracle_normal_error_deg"][i] is None
                continue
            assert columns["solved"][i] == row["solved"] == ((frame_id, marker_id) != LOST)
            assert bool(columns["reason"][i]) == (not row["solved"])
            for key in ("oracle_normal_error_deg", "oracle_position_error_pct"):
                assert columns[key][i] == (None if row[key] is None else pytest.approx(row[key], rel=1e-4))


def test_the_same_input_gives_the_same_bytes(dataset: Dataset, report: Path, tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    shutil.copytree(dataset.path, elsewhere)
    browse_dataset(dataset.path, tmp_path / "one", report, copy_images=True)
    browse_dataset(elsewhere, tmp_path / "other", report)
    # An earlier page is replaced, with what is no longer part of it.
    browse_dataset(elsewhere, tmp_path / "other", report, copy_images=True)
    one = files_of(tmp_path / "one")
    assert one == files_of(tmp_path / "other")
    assert one["images/000004.png"] == dataset.images.image_bytes(4)
    browse_dataset(elsewhere, tmp_path / "other")
    assert not any(name.startswith(("scores/", "images/")) for name in files_of(tmp_path / "other"))
    assert [name for name, data in one.items() if str(tmp_path).encode() in data] == []
    assert sorted(path.name for path in tmp_path.iterdir()) == ["elsewhere", "one", "other"]


@pytest.mark.slow
def test_shards_are_read_one_by_one(tmp_path: Path) -> None:
    text = POINTS.replace("{grid: [15, 30, 45]}", "{uniform: [15, 45]}").replace("{grid: [15, 25, 40]}", "20")
    dataset = make_dataset(tmp_path / "ds", text.replace("frames_per_cell: 4", "frames: 1003"))
    rows = estimate_rows(dataset, ["true"], 0.1)
    report = tmp_path / "report"
    validate_dataset(dataset.path, [write_estimates(tmp_path / "e.parquet", rows)], report)
    seen: list[tuple[int, int]] = []
    browse_dataset(dataset.path, tmp_path / "page", report, progress=lambda done, total: seen.append((done, total)))
    data = data_of(tmp_path / "page")
    assert [shard["frames"]["id"] for shard in data["shards"]] == [list(range(1000)), [1000, 1001, 1002]]
    assert data["shards"][1]["markers"]["frame"] == [0, 1, 2]
    assert len(data["scores"][0]["solved"]) == 1003
    assert seen == [(i, 1003) for i in range(1, 1004)]


# Thumbnails


def decoded(data: bytes) -> Image.Image:
    return Image.open(io.BytesIO(data))


def test_thumbnails_keep_contrast_and_colour() -> None:
    ramp = np.tile(np.linspace(0, 255, 480), (100, 1)).astype(np.uint8)
    grey = decoded(thumbnail(ramp, 255.0))
    assert (grey.mode, grey.size) == ("L", (LONG_SIDE_PX, 50))
    # JPEG of a smooth ramp: within two levels of the mean of its pixels.
    assert np.abs(np.asarray(grey, float).mean(axis=0) - ramp[0].reshape(-1, 2).mean(axis=1)).max() < 2.5
    # 10 bits in the upper bits of 16: half of the range is a middle grey, however dark the rest of the image.
    dark = np.full((60, 300), 511 << 6, dtype=np.uint16)
    assert abs(np.asarray(decoded(thumbnail(dark, float(1023 << 6))), float).mean() - 127) < 1.5
    assert abs(np.asarray(decoded(thumbnail(dark, None)), float).mean() - 127) < 1.5
    colour = np.zeros((500, 300, 3), np.uint8)
    colour[..., 0] = 200
    red = decoded(thumbnail(colour, 255.0))
    assert (red.mode, red.size) == ("RGB", (144, LONG_SIDE_PX))
    assert np.abs(np.asarray(red, float).mean(axis=(0, 1)) - (200, 0, 0)).max() < 3
    assert decoded(thumbnail(ramp[:, :40], 255.0)).size == (40, 100)
    assert decoded(thumbnail(ramp[:1], 255.0)).size == (LONG_SIDE_PX, 1)


# Hostile names

EVIL = (
    "</script><script>alert(1)</script>",
    '"><img src=x onerror=alert(1)>',
    "\u202egnp.exe\u2066\u2028",
    "{{ 7*7 }}",
)


class Page(HTMLParser):
    """Scripts, handlers and addresses of a page."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.scripts: list[str | None] = []
        self.found: set[str] = set()
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "script":
            self.scripts.append(dict(attrs).get("src"))
        elif tag in {"iframe", "img", "object", "embed", "base"}:
            self.found.add(tag)
        self.found |= {key for key, _ in attrs if key.startswith("on")}


def test_hostile_names_are_inert(tmp_path: Path) -> None:
    study, reason, method, label = EVIL
    text = IMAGES.replace("name: pictures", f"name: {json.dumps(study)}")
    text = text.replace("frames: 5", "frames: 2")
    dataset = make_dataset(tmp_path / "ds", text)
    rows = [row for row in estimate_rows(dataset, [f"calibrated:{label}"], 0.1, method) if row["frame_id"] == 0]
    rows.append(failed_row(1, f"calibrated:{label}", reason, method))
    report = tmp_path / "report"
    validate_dataset(dataset.path, [write_estimates(tmp_path / "e.parquet", rows)], report)
    browse_dataset(dataset.path, tmp_path / "page", report)
    data, html = data_of(tmp_path / "page"), (tmp_path / "page" / "index.html").read_text()
    page = Page(html)
    assert page.found == set()
    scripts = [name for name in page_folder.ASSETS if name.endswith(".js")]
    assert page.scripts == ["data.js", "scores/000.js", *scripts]
    # Texts are data of scripts, which set them as text: they never become a part of the HTML but for the title.
    assert reason in data["scores"][0]["reason"]
    bad = re.compile("[\u202a-\u202e\u2066-\u2069\u2028\x00-\x08]")
    assert not bad.search(html)
    assert not bad.search(json.dumps(data, ensure_ascii=False))
    code = "".join((resources.files("roundel.validate.browse") / name).read_text() for name in scripts)
    assert not re.search(
        r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|eval|new Function|fetch\(|http:",
        code.replace("http://www.w3.org/2000/svg", ""),
    )


# Bad input


def refused(capsys: pytest.CaptureFixture[str], code: int, words: str, *arguments: object) -> None:
    assert main(["browse", *map(str, arguments)]) == code
    captured = capsys.readouterr()
    assert words in captured.err
    assert captured.err.count("\n") == 1


def test_wrong_arguments_are_one_line(
    dataset: Dataset, points: Dataset, report: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "page"
    refused(capsys, 4, "not a dataset", tmp_path / "none", "--out", page)
    refused(capsys, 2, "not a report", dataset.path, tmp_path / "none", "--out", page)
    refused(capsys, 3, "the report is of dataset", points.path, report, "--out", page)
    refused(capsys, 2, "is a dataset", dataset.path, "--out", dataset.path)
    refused(capsys, 2, "is not empty", dataset.path, "--out", report)
    refused(capsys, 2, "is a file", dataset.path, "--out", report / "report.html")
    assert not page.exists()
    damaged = tmp_path / "damaged"
    shutil.copytree(report, damaged)
    (damaged / "scores.parquet").write_bytes(b"PAR1")
    refused(capsys, 4, "validate the dataset again", dataset.path, damaged, "--out", page)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["damaged"]


def test_a_report_of_other_images_is_refused(
    dataset: Dataset, report: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = helpers_reports.sheet_image
    monkeypatch.setattr(helpers_reports, "sheet_image", lambda frame: 255 - drawn(frame))
    again = make_dataset(tmp_path / "ds", IMAGES)
    assert again.images.dataset_id == dataset.images.dataset_id
    with pytest.raises(NotComparableError, match="other images of this dataset"):
        browse_dataset(again.path, tmp_path / "page", report)


def test_a_folder_of_somebody_is_left_alone(dataset: Dataset, tmp_path: Path) -> None:
    page = tmp_path / "page"
    page.mkdir()
    browse_dataset(dataset.path, page)  # an empty one is used
    (page / "notes.txt").write_text("mine")
    with pytest.raises(UsageError, match="is not empty and not a page"):
        browse_dataset(dataset.path, page)
    assert (page / "notes.txt").read_text() == "mine"
    other = tmp_path / "other"
    other.mkdir()
    (other / "index.html").write_text("mine")
    with pytest.raises(UsageError, match="is not empty and not a page"):
        browse_dataset(dataset.path, other)


def test_a_link_to_a_folder_stays_a_link(dataset: Dataset, tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "real")
    browse_dataset(dataset.path, tmp_path / "link")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real" / "index.html").is_file()


def test_an_interrupted_run_leaves_no_half_page(dataset: Dataset, report: Path, tmp_path: Path) -> None:
    def stop(done: int, total: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    page = tmp_path / "page"
    with pytest.raises(KeyboardInterrupt):
        browse_dataset(dataset.path, page, progress=stop)
    assert list(tmp_path.iterdir()) == []
    browse_dataset(dataset.path, page, report)
    earlier = files_of(page)
    with pytest.raises(KeyboardInterrupt):
        browse_dataset(dataset.path, page, progress=stop)
    assert files_of(page) == earlier
    # What a killed run has left is removed by the next.
    left = tmp_path / ".page.00000000-1-1.abcdef01.page"
    gone = tmp_path / ".page.not-a-process.abcdef01.page"
    for folder in (left, gone):
        folder.mkdir()
    browse_dataset(dataset.path, page)
    assert left.is_dir()  # of another host, of which nothing is known
    assert not gone.exists()


def test_a_damaged_image_leaves_no_page(dataset: Dataset, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(dataset.path, copy)
    (copy / "images" / "000002.png").write_bytes(b"")
    with pytest.raises(DataError, match=re.escape("000002.png")):
        browse_dataset(copy, tmp_path / "page")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["copy"]


def test_a_place_that_cannot_be_written_is_one_line(dataset: Dataset, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(DataError, match="cannot write"):
        browse_dataset(dataset.path, tmp_path / "file" / "page")


def test_a_part_of_a_dataset_has_its_frames(
    dataset: Dataset, report: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pull_dataset(dataset.path, tmp_path / "part", range(2, 5))
    assert main(["browse", str(tmp_path / "part"), str(report), "--out", str(tmp_path / "page")]) == 0
    captured = capsys.readouterr()
    assert "not finished" in captured.err
    assert f"{tmp_path / 'page' / 'index.html'}: 3 frames" in captured.out
    assert "not finished" in (tmp_path / "page" / "index.html").read_text()
    data = data_of(tmp_path / "page")
    assert data["shards"][0]["frames"]["id"] == [2, 3, 4]
    assert data["scores"][1]["solved"] == [1, 1, 1, 0, 1, 1]
    assert len(open_dataset(tmp_path / "part")) == 3


def test_every_script_of_the_page_is_shipped() -> None:
    here = resources.files("roundel.validate.browse")
    names = {path.name for path in here.iterdir() if path.name.endswith((".js", ".css"))}
    assert names == set(page_folder.ASSETS)
