"""Imported photographs as a dataset: what is written, that it is all or nothing, and what refuses it."""

import json
from functools import partial

import numpy as np
import pyarrow.parquet as pq
import pytest
from helpers_albums import CAMERA, jpeg_of, sheet_study
from helpers_reports import sheet_image

from roundel.datasets.dataset import open_dataset
from roundel.datasets.export.check import check_against, read_export
from roundel.datasets.export.export import export_dataset
from roundel.datasets.ingest.photographs import Photograph, suffix_of
from roundel.datasets.ingest.sheet import marker_of_study, parts_of, scaled_marker, study_of_photographs
from roundel.datasets.ingest.write import Import, write_import
from roundel.datasets.merge import merge_datasets
from roundel.datasets.pull import pull_dataset
from roundel.datasets.repair import study_to_repair
from roundel.datasets.store.folder import Folder
from roundel.datasets.stream.splits import Splits
from roundel.datasets.verify import verify_dataset
from roundel.scenes.camera.model import camera_to_json
from roundel.scenes.camera.response_curve import SRGB
from roundel.scenes.errors import DataError, UsageError
from roundel.scenes.study.study import load_study
from roundel.scenes.truth.truth import truth_of
from roundel.scenes.world.frame import frame_of, frames_of
from roundel.scenes.world.sheets import sheet_of


@pytest.fixture(scope="module")
def frames(tmp_path_factory):
    return list(frames_of(sheet_study(tmp_path_factory.mktemp("study"))))[:3]


@pytest.fixture(scope="module")
def imported(frames):
    marker = frames[0].settings.marker
    photos = [
        Photograph(
            f"IMG_{i}.jpg",
            partial(jpeg_of, sheet_image(frame, 2)),
            ".jpg",
            8,
            SRGB,
            30.0 if i else None,
            1,
            np.stack([frame.camera_from_part(part) for part in frame.sheet.parts]),
            np.stack([np.diag([1e-3] * 3 + [2e-3] * 3) ** 2] * 2),
            20,
            0.05,
            0.07,
        )
        for i, frame in enumerate(frames)
    ]
    sheet = sheet_of(marker)
    study = study_of_photographs(marker, CAMERA, photos, sheet, "walk", "CC-BY-4.0")
    return Import(study, sheet, CAMERA, camera_to_json(CAMERA), "chessboard", True, photos, {"notes.jpg": "no image"})


def test_a_dataset_with_reference_poses(tmp_path, imported, frames):
    out = tmp_path / "walk"
    write_import(out, imported)
    assert verify_dataset(out, full=True) == []
    dataset = open_dataset(out)
    assert dataset.reference["photographs"] == ["IMG_0.jpg", "IMG_1.jpg", "IMG_2.jpg"]
    assert dataset.reference["left_out"] == {"notes.jpg": "no image"}
    assert dataset.reference["sigma"]["normal_deg"] == pytest.approx(np.degrees(2e-3 * np.sqrt(2)))
    assert dataset.reference["sigma"]["position_m"] == pytest.approx(1e-3 * np.sqrt(3))
    assert dataset.manifest["fidelity"]["circles"] == 0
    assert dataset.images.image_bytes(1) == imported.photographs[1].load()
    assert dataset.images.camera(1).focal_35mm_mm == 30.0
    assert dataset.images.camera(0).focal_35mm_mm is None
    assert dataset.images.curve(0).kind == "srgb"
    # The rows are those of the truth, without what only a renderer knows.
    rows = {(row["frame_id"], row["marker_id"]): row for row in dataset.truth.to_pylist()}
    for expected in (row for frame in frames for row in truth_of(frame)):
        row = rows[expected["frame_id"], expected["marker_id"]]
        for key, value in expected.items():
            if key.startswith(("open_", "close_", "edge_")) or key in ("group", "hidden_by"):
                continue
            if isinstance(value, float):
                assert row[key] == pytest.approx(value, abs=1e-9), key
            elif not isinstance(value, list):
                assert row[key] == value, key
        np.testing.assert_allclose(row["contour_x_px"], expected["contour_x_px"], atol=1e-6)
        assert row["edge_contrast_dn"] is None
    table = pq.read_table(out / "reference.parquet").to_pylist()
    assert [r["photograph"] for r in table[::2]] == ["IMG_0.jpg", "IMG_1.jpg", "IMG_2.jpg"]
    assert table[0]["cov_00"] == pytest.approx(1e-6)
    assert table[0]["cov_55"] == pytest.approx(4e-6)


def test_the_study_renders_frames_like_the_photographs(tmp_path, imported):
    write_import(tmp_path / "walk", imported)
    study = load_study(tmp_path / "walk" / "study.yaml")
    frame = frame_of(study, 0)
    assert frame.settings.marker == imported.study.groups["photographs"].marker
    np.testing.assert_allclose(frame.camera.K, CAMERA.K)
    assert study.solve.intrinsics == ["true", "default"]  # one photograph has no EXIF


def test_the_same_photographs_give_the_same_bytes(tmp_path, imported):
    one, two = tmp_path / "one", tmp_path / "two"
    write_import(one, imported)
    write_import(two, imported)
    names = sorted(str(p.relative_to(one)) for p in one.rglob("*") if p.is_file())
    assert names == sorted(str(p.relative_to(two)) for p in two.rglob("*") if p.is_file())
    assert all((one / name).read_bytes() == (two / name).read_bytes() for name in names)


def test_all_or_nothing(tmp_path, imported):
    out = tmp_path / "walk"
    out.mkdir()
    (out / "mine").write_text("x")
    with pytest.raises(UsageError, match="is not empty"):
        write_import(out, imported)
    assert [p.name for p in out.iterdir()] == ["mine"]

    def fails():
        raise DataError("changed while it was being imported")

    broken = Photograph(**{**vars(imported.photographs[2]), "load": fails})
    with pytest.raises(DataError, match="changed"):
        write_import(tmp_path / "new", Import(**{**vars(imported), "photographs": [*imported.photographs[:2], broken]}))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["walk"]


def test_what_needs_a_renderer_refuses(tmp_path, imported):
    out = tmp_path / "walk"
    write_import(out, imported)
    before = sorted(p.name for p in out.rglob("*"))
    with pytest.raises(UsageError, match="holds imported photographs"):
        merge_datasets([out], tmp_path / "merged")
    with pytest.raises(UsageError, match="holds imported photographs"):
        study_to_repair(Folder(out), None)
    # Even if its manifest is lost: repairing would take all images for litter.
    (out / "manifest.json").rename(tmp_path / "manifest.json")
    with pytest.raises(UsageError, match="holds imported photographs"):
        study_to_repair(Folder(out), out / "study.yaml")
    (tmp_path / "manifest.json").rename(out / "manifest.json")
    with pytest.raises(UsageError, match="without --frames"):
        pull_dataset(out, tmp_path / "pulled", range(1))
    assert sorted(p.name for p in out.rglob("*")) == before


def test_an_altered_reference_is_refused(tmp_path, imported):
    from roundel.datasets.store.records import document_of, record_of_document

    out = tmp_path / "walk"
    write_import(out, imported)
    manifest = record_of_document((out / "manifest.json").read_bytes())
    assert json.dumps(manifest["reference"])
    manifest["reference"]["kind"] = "guess"
    (out / "manifest.json").write_bytes(document_of(manifest))
    with pytest.raises(DataError, match=r"reference\.kind"):
        open_dataset(out)


def test_the_sheet_of_a_study(tmp_path):
    study = sheet_study(tmp_path)
    marker = marker_of_study(study)
    board, (circle,) = parts_of(sheet_of(marker))
    assert (board.kind, circle.radius_m) == ("chessboard", 0.03)
    stretched, (wider,) = parts_of(sheet_of(scaled_marker(marker, 1.01)))
    assert wider.radius_m == pytest.approx(0.0303)
    assert stretched.layout["square_m"] == pytest.approx(0.0202)
    assert stretched.x_m == pytest.approx(1.01 * board.x_m)
    with pytest.raises(UsageError, match="--group other"):
        marker_of_study(study, "other")
    plain = sheet_study(tmp_path, (CHESS, "kind: disc, diameter_m: 0.06"))
    with pytest.raises(UsageError, match="no group has a sheet with a circle and a board"):
        marker_of_study(plain)
    drawn = sheet_study(tmp_path, ("gap_m: 0.015", "gap_m: {uniform: [0.01, 0.02]}"))
    with pytest.raises(UsageError, match=r"no group|gap_m is drawn"):
        marker_of_study(drawn)


CHESS = "kind: disc_with_chessboard, diameter_m: 0.06, gap_m: 0.015, chessboard: {columns: 5, rows: 4, square_m: 0.02}"


def test_images_are_known_by_their_first_bytes():
    assert suffix_of(b"\xff\xd8\xff\xe1....") == ".jpg"
    assert suffix_of(b"\x89PNG\r\n") == ".png"
    assert suffix_of(b"GIF89a") is None


def test_exports_and_the_card_say_that_poses_are_a_reference(tmp_path, imported):
    write_import(tmp_path / "walk", imported)
    dataset = open_dataset(tmp_path / "walk")
    for name in ("coco", "huggingface", "croissant"):
        export_dataset(dataset, tmp_path / name, name, Splits())
        record = read_export(tmp_path / name)
        assert record["dataset"]["poses"] == "reference"
        assert check_against(tmp_path / name, record, dataset) == []
        card = json.loads((tmp_path / name / "card.json").read_text())
        assert card["poses"] == "reference"
        assert "no truth" in card["description"]
        assert not any("render" in line for line in card["reproduce"])
    assert "no truth" in (tmp_path / "huggingface" / "README.md").read_text()
