"""Exports: every format is read back as the dataset, errors planted in each are found, and bad input is one line."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from helpers_reports import make_dataset

from roundel.cli.main import main
from roundel.datasets.dataset import Dataset, open_dataset
from roundel.datasets.export.check import check_against, check_files, read_export
from roundel.datasets.export.export import FORMATS, export_dataset
from roundel.datasets.export.output import MANIFEST
from roundel.datasets.store.records import document_of
from roundel.datasets.stream.frames import KEYPOINTS, frame_source
from roundel.datasets.stream.masks import mask_of_runs, run_lengths
from roundel.datasets.stream.splits import Splits
from roundel.scenes.errors import DataError

STUDY = """\
schema: 1
name: exported
seed: 3
camera: {width_px: 160, height_px: 120, focal_px: 160}
marker: {kind: two_discs, diameter_m: 0.05, second_diameter_m: 0.03, spacing_m: 0.06}
pose:
  distance_m: {uniform: [0.3, 0.5]}
  tilt_deg: {uniform: [10, 50]}
  azimuth_deg: {uniform: [-180, 180]}
  offset_x_px: {uniform: [-60, 20]}
frames: 8
"""


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return make_dataset(tmp_path_factory.mktemp("exported") / "ds", STUDY)


@pytest.fixture(scope="module")
def exports(dataset: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Every format, split."""
    folder = tmp_path_factory.mktemp("exports")
    for name in FORMATS:
        export_dataset(dataset, folder / name, name, Splits((0.5, 0.25, 0.25), seed=3))
    return folder


def problems(folder: Path, dataset: Dataset) -> list[str]:
    """What is found without looking at checksums, as where somebody made them right."""
    return [str(finding) for finding in check_against(folder, read_export(folder), dataset)]


def problems_of(folder: Path, dataset: Dataset) -> list[str]:
    """All that is found; an error is one of them."""
    try:
        return [*map(str, check_files(folder, read_export(folder))), *problems(folder, dataset)]
    except DataError as error:
        return [str(error)]


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_is_read_back_as_the_dataset(name: str, exports: Path, dataset: Dataset, tmp_path: Path) -> None:
    folder = exports / name
    record = read_export(folder)
    assert check_files(folder, record) == []
    assert problems(folder, dataset) == []
    assert record["splits"]["frames"] == {"train": 4, "val": 2, "test": 2}
    assert record["left_out"]
    # And twice the same.
    export_dataset(dataset, tmp_path / name, name, Splits((0.5, 0.25, 0.25), seed=3))
    files = sorted(p.relative_to(folder) for p in folder.rglob("*") if p.is_file())
    assert files == sorted(p.relative_to(tmp_path / name) for p in (tmp_path / name).rglob("*") if p.is_file())
    for file in files:
        assert (folder / file).read_bytes() == (tmp_path / name / file).read_bytes(), file


def of_json(path: str, change: Callable[[Any], None]) -> Callable[[Path], None]:
    """Changes a file of JSON."""

    def planted(folder: Path) -> None:
        file = next(iter(sorted(folder.glob(path))))
        value = json.loads(file.read_text())
        change(value)
        file.write_text(json.dumps(value))

    return planted


def of_text(path: str, pattern: str, new: Callable[[re.Match[str]], str]) -> Callable[[Path], None]:
    """Changes the first match in a file of text."""

    def planted(folder: Path) -> None:
        file = next(iter(sorted(folder.glob(path))))
        text = file.read_text()
        changed = re.sub(pattern, new, text, count=1, flags=re.MULTILINE)
        assert changed != text
        file.write_text(changed)

    return planted


def of_table(path: str, column: str, change: Callable[[Any], Any]) -> Callable[[Path], None]:
    """Changes a column of a Parquet file."""

    def planted(folder: Path) -> None:
        file = next(iter(sorted(folder.glob(path))))
        table = pq.read_table(file)
        values = [change(v) for v in table[column].to_pylist()]
        at = table.column_names.index(column)
        pq.write_table(table.set_column(at, table.schema.field(column), pa.array(values, table[column].type)), file)

    return planted


def of_tar(change: Callable[[Any], None]) -> Callable[[Path], None]:
    """Changes the first object of JSON in a shard; it keeps its length."""

    def planted(folder: Path) -> None:
        file = next(iter(sorted(folder.glob("*.tar"))))
        data = file.read_bytes()
        start = data.index(b'{"frame_id"')
        end = start + data[start:].index(b"\0")
        value = json.loads(data[start:end])
        change(value)
        new = json.dumps(value, separators=(",", ":")).encode()
        assert len(new) <= end - start
        file.write_bytes(data[:start] + new.ljust(end - start) + data[end:])

    return planted


def first(scene: dict[str, Any]) -> Any:
    return next(iter(scene.values()))


def swapped_rows(pose: list[list[float]]) -> None:
    pose[0], pose[1] = pose[1], pose[0]


def set_at(value: Any, key: Any, new: Any) -> None:
    value[key] = new


def shifted(values: list[float], by: float = 0.5) -> list[float]:
    return [v + by for v in values]


HALF, AXES, UNIT = "half a pixel", "axes are exchanged|x and y are exchanged|differs by up to", "another unit"
NUMBER = r"(-?\d+\.\d+(?:e-?\d+)?)"

PLANTED = {
    "bop half a pixel": (of_json("train_pbr/*/scene_camera.json", lambda s: [
        set_at(c["cam_K"], i, c["cam_K"][i] + 0.5) for c in s.values() for i in (2, 5)]), HALF),
    "bop axes": (of_json("train_pbr/*/scene_gt.json", lambda s: first(s)[0].update(
        cam_R_m2c=[first(s)[0]["cam_R_m2c"][i] for i in (3, 4, 5, 0, 1, 2, 6, 7, 8)])), AXES),
    "bop unit": (of_json("train_pbr/*/scene_gt.json", lambda s: first(s)[0].update(
        cam_t_m2c=[v / 1000 for v in first(s)[0]["cam_t_m2c"]])), UNIT),
    "bop model in metres": (of_json("models/models_info.json", lambda m: m["1"].update(
        diameter=m["1"]["diameter"] / 1000)), UNIT),
    "coco half a pixel in boxes": (of_json("annotations/*.json", lambda c: [
        a.update(bbox=[a["bbox"][0] - 0.5, a["bbox"][1] - 0.5, *a["bbox"][2:]]) for a in c["annotations"]
        if min(a["bbox"][:2]) > 1]), HALF),
    "coco half a pixel in keypoints": (of_json("annotations/*.json", lambda c: [
        set_at(a["keypoints"], i, a["keypoints"][i] - 0.5) for a in c["annotations"] for i in (0, 1, 3, 4, 6, 7)
        if a["keypoints"][i] > 0]), "keypoints differ"),
    "coco half a pixel in K": (of_json("annotations/*.json", lambda c: [
        set_at(i["K"][r], 2, i["K"][r][2] - 0.5) for i in c["images"] for r in (0, 1)]), HALF),
    "coco axes": (of_json("annotations/*.json", lambda c: swapped_rows(
        c["annotations"][0]["camera_from_marker"])), AXES),
    "coco unit": (of_json("annotations/*.json", lambda c: [
        set_at(row, 3, 1000 * row[3]) for row in c["annotations"][0]["camera_from_marker"][:3]]), UNIT),
    "coco mask in rows": (of_json("annotations/*.json", lambda c: c["annotations"][0]["segmentation"].update(
        counts=run_lengths(mask_of_runs(c["annotations"][0]["segmentation"]["counts"], 120, 160)[::-1]))), "mask"),
    "coco category": (of_json("annotations/*.json", lambda c: c["annotations"][0].update(category_id=9)),
        "category_id 9"),
    "yolo half a pixel": (of_text("pose/labels/train/*.txt", rf"^0 {NUMBER}", lambda m:
        f"0 {float(m[1]) - 0.5 / 160:.10g}"), "box differ"),
    "yolo axes": (of_text("pose/labels/train/*.txt", rf"^0 {NUMBER} {NUMBER}", lambda m:
        f"0 {m[2]} {m[1]}"), "box differ"),
    "yolo pixels": (of_text("segment/labels/train/*.txt", rf"^0 {NUMBER}", lambda m: f"0 {160 * float(m[1]):.10g}"),
        "outside the image"),
    "yolo class": (of_text("pose/labels/train/*.txt", r"^0 ", lambda m: "7 "), "no class 7"),
    "webdataset half a pixel": (of_tar(lambda s: [
        set_at(s["K"][r], 2, s["K"][r][2] + 0.5) for r in (0, 1)]), HALF),
    "webdataset axes": (of_tar(lambda s: swapped_rows(s["markers"][0]["camera_from_marker"])), AXES),
    "webdataset unit": (of_tar(lambda s: s["markers"][0].update(
        diameter_m=round(1000 * s["markers"][0]["diameter_m"]))), UNIT),
    "huggingface half a pixel": (of_table("data/train*.parquet", "K", lambda k: [
        [*row[:2], row[2] + 0.5 * (r < 2)] for r, row in enumerate(k)]), HALF),
    "huggingface axes": (of_table("data/train*.parquet", "markers", lambda ms: [
        {**m, "camera_from_marker": [m["camera_from_marker"][i] for i in (1, 0, 2, 3)]} for m in ms]), AXES),
    "huggingface unit": (of_table("data/train*.parquet", "markers", lambda ms: [
        {**m, "diameter_m": 1000 * m["diameter_m"]} for m in ms]), UNIT),
    "croissant half a pixel": (of_table("frames.parquet", "cx_px", lambda v: v + 0.5), "checksum|sha256"),
    "croissant column": (of_json("croissant.json", lambda c: c["recordSet"][0]["field"][0]["source"]["extract"].update(
        column="nosuch")), "no column nosuch"),
    "croissant checksum": (of_json("croissant.json", lambda c: c["distribution"][0].update(sha256="0" * 64)), "sha256"),
    "croissant context": (of_json("croissant.json", lambda c: c["@context"].pop("containedIn")), "@context"),
    "colmap half a pixel": (of_text("sparse/0/cameras.txt", r"80\.0 60\.0", lambda m: "79.5 59.5"), HALF),
    "colmap axes": (of_text("sparse/0/images.txt", rf"^(\d+) {NUMBER} {NUMBER} {NUMBER} {NUMBER}", lambda m:
        f"{m[1]} {m[3]} {m[4]} {m[5]} {m[2]}"), "rotation differs"),
    "colmap unit": (of_text("sparse/0/images.txt", rf"{NUMBER} {NUMBER} {NUMBER} (\d+ \d+\.png)", lambda m:
        " ".join(repr(1000 * float(m[i])) for i in (1, 2, 3)) + f" {m[4]}"), UNIT),
    "kalibr half a pixel": (of_text("camchain.yaml", r"- 79\.5\n  - 59\.5", lambda m: "- 80.0\n  - 60.0"), HALF),
    "kalibr axes": (of_text("camchain.yaml", r"- 79\.5\n  - 59\.5", lambda m: "- 59.5\n  - 79.5"), AXES),
    "ros half a pixel": (of_text("camera_info.yaml", r"(?s)79\.5(.*?)59\.5(.*?)79\.5(.*?)59\.5", lambda m:
        f"80.0{m[1]}60.0{m[2]}80.0{m[3]}60.0"), HALF),
    "ros matrices": (of_text("camera_info.yaml", r"79\.5", lambda m: "80.0"), "projection_matrix"),
    "tum axes": (of_text("marker-0.tum", rf"^(\d+) {NUMBER} {NUMBER}", lambda m:
        f"{m[1]} {m[3]} {m[2]}"), "position differs"),
    "tum quaternion": (of_text("marker-0.tum", r"^(\d+ \S+ \S+ \S+) (\S+) (\S+) (\S+) (\S+)$", lambda m:
        f"{m[1]} {m[5]} {m[2]} {m[3]} {m[4]}"), "rotation differs"),
    "tum unit": (of_text("marker-0.tum", rf"^(\d+) {NUMBER} {NUMBER} {NUMBER}", lambda m:
        f"{m[1]} " + " ".join(repr(1000 * float(m[i])) for i in (2, 3, 4))), UNIT),
    "kitti inverse": (of_text("marker-0.kitti", r"^(\S+) (\S+) (\S+) (\S+) (\S+) (\S+) (\S+) (\S+) (\S+)", lambda m:
        " ".join(m[i] for i in (1, 5, 9, 4, 2, 6, 7, 8, 3))), "rotation differs"),
    "kitti unit": (of_text("marker-0.kitti", r"^(\S+ \S+ \S+) (\S+) (\S+ \S+ \S+) (\S+) (\S+ \S+ \S+) (\S+)$", lambda m:
        " ".join(m[i] if i % 2 else repr(1000 * float(m[i])) for i in range(1, 7))), UNIT),
}  # fmt: skip


@pytest.mark.parametrize("case", PLANTED)
def test_a_planted_error_is_found_and_named(
    case: str, exports: Path, dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name = case.partition(" ")[0]
    shutil.copytree(exports / name, tmp_path / name)
    change, words = PLANTED[case]
    change(tmp_path / name)
    assert any("altered" in str(f) for f in check_files(tmp_path / name, read_export(tmp_path / name)))
    try:
        found = " ".join(problems(tmp_path / name, dataset))
    except Exception as error:
        found = f"{type(error).__name__}: {error}"
        assert found.startswith("DataError")
    assert re.search(words, found), found
    assert main(["verify", str(tmp_path / name)]) == 4
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("name", ["bop", "coco", "webdataset", "huggingface"])
def test_a_frame_of_another_split_is_found(name: str, exports: Path, dataset: Dataset, tmp_path: Path) -> None:
    shutil.copytree(exports / name, tmp_path / name)
    record = read_export(tmp_path / name)
    record["splits"] = {**record["splits"], "seed": 4}
    found = [str(f) for f in check_against(tmp_path / name, record, dataset)]
    assert any("is in train, not in" in line for line in found)


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("how", ["cut", "no text", "empty", "removed"])
def test_a_damaged_file_is_found_in_lines(name: str, how: str, exports: Path, dataset: Dataset, tmp_path: Path) -> None:
    for number, file in enumerate(sorted(p for p in (exports / name).rglob("*") if p.is_file())):
        if file.suffix in (".png", ".ply") or file.name.startswith("card."):
            continue
        folder = tmp_path / str(number)
        shutil.copytree(exports / name, folder)
        mine = folder / file.relative_to(exports / name)
        data = mine.read_bytes()
        if how == "removed":
            mine.unlink()
        else:
            mine.write_bytes({"cut": data[: len(data) // 2], "no text": b"\xff" + data[1:], "empty": b""}[how])
        found = problems_of(folder, dataset)
        assert found, mine
        assert not any("\n" in line for line in found)
        shutil.rmtree(folder)


def test_keypoints_are_projected_as_the_truth_has_them(dataset: Dataset) -> None:
    source = frame_source(dataset, lambda index: "train")
    for index in range(len(dataset)):
        for marker in source(index).markers:
            row = marker.truth
            assert marker.keypoints_px[0] == pytest.approx(
                [row["centre_image_x_px"], row["centre_image_y_px"]], abs=1e-9
            )
            contour = np.column_stack([row["contour_x_px"], row["contour_y_px"]])
            # The contour begins on +X and turns toward +Y.
            np.testing.assert_allclose(marker.keypoints_px[1:], contour[::64], atol=1e-9)
            assert len(marker.keypoints_px) == len(KEYPOINTS)


def test_full_masks_are_exact_areas(dataset: Dataset) -> None:
    source = frame_source(dataset, lambda index: "train")
    checked = 0
    for index in range(len(dataset)):
        for marker in source(index).markers:
            row = marker.truth
            x0, y0, area = marker._areas
            # The area of the whole ellipse; the camera has no distortion.
            assert area.sum() == pytest.approx(np.pi * row["ellipse_a_px"] * row["ellipse_b_px"], rel=1e-5)
            centre = np.array([(area * (np.arange(area.shape[1]) + x0)).sum(),
                               (area * (np.arange(area.shape[0])[:, None] + y0)).sum()]) / area.sum()  # fmt: skip
            # What an edge pixel has of the area is not at its centre.
            assert centre == pytest.approx([row["ellipse_x_px"], row["ellipse_y_px"]], abs=0.01)
            checked += 1
    assert checked == 16


def test_bad_input_is_one_line_and_leaves_nothing(
    dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def refused(code: int, words: str, *arguments: str) -> None:
        assert main(["export", *arguments]) == code
        error = capsys.readouterr().err
        said = [line for line in error.splitlines() if not line.startswith("export: ")]
        assert len(said) == 1
        assert re.search(words, said[0]), error

    ds, out = str(dataset.path), str(tmp_path / "out")
    refused(2, "give one of bop, coco", ds, out, "--format", "excel")
    refused(2, "the dataset has main", ds, out, "--format", "coco", "--groups", "nosuch")
    refused(2, "is a dataset", ds, ds, "--format", "coco")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("mine")
    refused(2, "there are files already", ds, str(tmp_path / "full"), "--format", "coco")
    assert (tmp_path / "full" / "mine.txt").read_text() == "mine"
    lens = STUDY.replace(
        "focal_px: 160}", "focal_px: 160, distortion: [-0.1, 0.01, 0, 0, 0, 0.01, 0, 0, 0.001, 0, 0, 0]}"
    )
    distorted = make_dataset(tmp_path / "distorted", lens)
    for name, words in {
        "bop": "lens distortion",
        "colmap": "COLMAP has no model",
        "kalibr": "Kalibr has no model",
    }.items():
        refused(2, words, str(distorted.path), out, "--format", name)
    zoom = make_dataset(tmp_path / "zoom", STUDY.replace("focal_px: 160}", "focal_px: {uniform: [150, 170]}}"))
    refused(2, "is not that of frame 0", str(zoom.path), out, "--format", "ros")
    points = make_dataset(tmp_path / "points", STUDY.replace("frames: 8", "frames: 8\nmode: points"))
    refused(2, "without images", str(points.path), out, "--format", "coco")
    refused(4, "not a dataset|no manifest", str(tmp_path / "full"), out, "--format", "coco")
    assert not Path(out).exists()
    assert sorted(p.name for p in tmp_path.iterdir() if p.is_dir()) == ["distorted", "full", "points", "zoom"]
    assert main(["export", str(points.path), out, "--format", "tum"]) == 0
    assert main(["verify", out, "--against", str(points.path)]) == 0
    assert main(["verify", out, "--against", ds]) == 3
    assert "is of dataset" in capsys.readouterr().err


@pytest.mark.parametrize(
    "change",
    [
        {"splits": None},
        {"splits": {"fractions": [1.0], "by": "pose", "seed": 0}},
        {"splits": {"fractions": [0.5, 0.5, "a"], "by": "pose", "seed": 0}},
        {"splits": {"fractions": [0.5, 0.5, 0.5], "by": "pose", "seed": 0}},
        {"splits": {"fractions": [0.5, 0.5, 0.0], "by": "moon", "seed": 0}},
        {"dataset": "mine"},
        {"format": ["coco"]},
    ],
)
def test_a_manifest_that_says_nothing_usable_is_one_line(
    change: dict[str, Any], exports: Path, dataset: Dataset, tmp_path: Path
) -> None:
    folder = shutil.copytree(exports / "coco", tmp_path / "coco")
    record = read_export(folder) | change
    (folder / MANIFEST).write_bytes(document_of(record))
    with pytest.raises(DataError, match=MANIFEST):
        check_against(folder, read_export(folder), dataset)


def test_checksums_name_files_of_the_export_only(exports: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(exports / "coco", tmp_path / "coco")
    with (folder / "checksums.sha256").open("a") as file:
        file.write(f"{'0' * 64}  ../outside.txt\n")
    said = [str(finding) for finding in check_files(folder, read_export(folder))]
    assert len(said) == 2
    assert "not in the export: '../outside.txt'" in said[1]


def test_an_interrupted_export_leaves_no_half(
    dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(done: int, total: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export_dataset(dataset, tmp_path / "out", "coco", Splits(), progress=stop)
    assert list(tmp_path.iterdir()) == []
    # One that was killed left its folder: it is made anew.
    (tmp_path / ".out.partial").mkdir()
    (tmp_path / ".out.partial" / "old").write_text("old")
    export_dataset(dataset, tmp_path / "out", "coco", Splits())
    assert [p.name for p in tmp_path.iterdir()] == ["out"]
    assert not (tmp_path / "out" / "old").exists()
    assert open_dataset(dataset.path).images.dataset_id == read_export(tmp_path / "out")["dataset"]["dataset_id"]
