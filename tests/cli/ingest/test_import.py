"""`roundel import`: photographs of a sheet become a dataset that is solved and validated."""

import io
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from helpers_albums import CAMERA, chi_square, jpeg_of, make_album, pose_error, sheet_study, with_exif
from helpers_reports import sheet_image
from PIL import Image

from roundel.cli.main import main
from roundel.datasets.dataset import open_dataset
from roundel.scenes.camera.model import camera_to_json
from roundel.scenes.study.study import load_study
from roundel.scenes.world.frame import frames_of
from roundel.validate.metrics.ground_truth import poses_of


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return sheet_study(tmp_path_factory.mktemp("sheet"))


@pytest.fixture(scope="module")
def album(study, tmp_path_factory):
    """Twelve photographs of the sheet; and, sorted among them, what else there is in a folder."""
    folder = tmp_path_factory.mktemp("holiday") / "photos"
    make_album(folder, study)
    noise = np.random.default_rng(0).integers(0, 255, (48, 64), dtype=np.uint8)
    Image.fromarray(noise).resize((640, 480)).save(folder / "BEACH.jpg")
    (folder / "notes.jpg").write_text("buy paper\n")
    (folder / "notes.txt").write_text("buy paper\n")
    whole = (folder / "IMG_0002.jpg").read_bytes()
    (folder / "IMG_0002b.jpg").write_bytes(whole[: len(whole) // 2])
    (folder / "IMG_0003m.jpg").write_bytes(with_exif(jpeg_of(sheet_image(next(frames_of(study)), 2)), 30, 2))
    return folder


@pytest.fixture(scope="module")
def imported(album, study, tmp_path_factory):
    out = tmp_path_factory.mktemp("imported") / "dataset"
    assert main(["import", str(album), str(out), "--sheet", str(study.path), "--licence", "CC0-1.0"]) == 0
    return out


def reference_errors(dataset, frames):
    """Chi-square (6 degrees of freedom) of the reference pose of each circle, by the frame that it shows."""
    table = pq.read_table(dataset.path / "reference.parquet").to_pylist()
    rows = [i for i, row in enumerate(dataset.truth.to_pylist()) if row["radius_m"] is not None]
    poses, found = poses_of(dataset.truth), {}
    for i in rows:
        row, upper = table[i], np.zeros((6, 6))
        upper[np.triu_indices(6)] = [row[f"cov_{a}{b}"] for a in range(6) for b in range(a, 6)]
        covariance = upper + np.triu(upper, 1).T
        number = int(Path(row["photograph"]).stem.removeprefix("IMG_")) - 1
        truth = frames[number].camera_from_part(frames[number].sheet.parts[0])
        found[number] = chi_square(pose_error(poses[i], truth), covariance)
    return found


def test_photographs_become_a_dataset(imported, album, study):
    dataset = open_dataset(imported)
    assert dataset.verify(full=True) == []
    assert dataset.reference["photographs"] == [f"IMG_{i:04d}.jpg" for i in range(1, 13)]
    reasons = dataset.reference["left_out"]
    assert sorted(reasons) == ["BEACH.jpg", "IMG_0002b.jpg", "IMG_0003m.jpg", "notes.jpg"]
    assert reasons["BEACH.jpg"] == "no chessboard found"
    assert "truncated" in reasons["IMG_0002b.jpg"]
    assert "mirrored" in reasons["IMG_0003m.jpg"]
    assert "not an image" in reasons["notes.jpg"]
    # The bytes are those of the files, and the pixels those that they store, whatever the orientation tag says.
    assert dataset.images.image_bytes(2) == (album / "IMG_0003.jpg").read_bytes()
    assert dataset.images.image(2).shape == (480, 640)
    assert dataset.images.camera(2).focal_35mm_mm == 30.0
    assert dataset.manifest["licence"] == "CC0-1.0"
    found = reference_errors(dataset, list(frames_of(study)))
    assert len(found) == 12
    assert np.mean(list(found.values())) / 6 < 2.5


def test_its_camera_is_within_its_covariance(imported):
    record = json.loads((imported / "camera.json").read_text())
    calibration = record["calibration"]
    k = np.array(record["K"])
    found = [k[0, 0], k[1, 1], k[0, 2], k[1, 2], *record["distortion"]]
    true = [560, 560, 323, 236, *CAMERA.distortion]
    assert calibration["parameters"] == ["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"]
    # 8 degrees of freedom: 99.9 % are below 26.1.
    assert chi_square(np.subtract(found, true), np.array(calibration["covariance"])) < 26.1


def test_it_is_solved_and_validated(imported, tmp_path, capsys):
    estimates, report = tmp_path / "estimates", tmp_path / "report"
    assert main(["solve", str(imported), str(estimates), "--method", "ml", "--intrinsics", "true"]) == 0
    assert main(["validate", str(imported), str(estimates), "--out", str(report)]) == 0
    said = capsys.readouterr().out
    assert "a reference measured from the chessboard beside each circle" in said
    assert "chessboard_pnp" not in said
    summary = json.loads((report / "summary.json").read_text())
    (run,) = summary["runs"]
    assert (run["n"], run["solved"], run["reference"]) == (12, 12, "truth")
    assert run["oracle"]["normal_error_deg"]["median"] < 0.5
    assert summary["calibration"] is None
    assert summary["dataset"]["reference"]["camera"] == "photographs"
    html = (report / "report.html").read_text()
    assert "and no truth" in html
    assert "roundel import PHOTOS DATASET" in html
    assert main(["validate", str(imported), str(estimates), "--out", str(report), "--camera", "camera.json"]) == 2
    assert main(["verify", str(imported)]) == 0
    assert "no truth" in capsys.readouterr().out


def test_the_same_photographs_give_the_same_bytes(imported, album, study, tmp_path):
    again = tmp_path / "again"
    assert main(["import", str(album), str(again), "--sheet", str(study.path), "--licence", "CC0-1.0"]) == 0
    for file in imported.rglob("*"):
        if file.is_file():
            assert file.read_bytes() == (again / file.relative_to(imported)).read_bytes(), file.name


def test_a_given_camera_needs_few_photographs(album, study, tmp_path, capsys):
    few = tmp_path / "few"
    few.mkdir()
    for name in ("IMG_0001.jpg", "IMG_0004.jpg"):
        (few / name).write_bytes((album / name).read_bytes())
    camera = tmp_path / "camera.json"
    camera.write_text(json.dumps(camera_to_json(CAMERA)))
    arguments = ["import", str(few), str(tmp_path / "out"), "--sheet", str(study.path)]
    assert main(arguments) == 3
    assert "2 photographs with the board are too few" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert main([*arguments, "--camera", str(camera)]) == 0
    assert "has no covariance: the camera is taken as exact" in capsys.readouterr().err
    dataset = open_dataset(tmp_path / "out")
    assert dataset.reference["camera"] == "file"
    found = reference_errors(dataset, [f for i, f in enumerate(frames_of(study)) if i in (0, 1, 2, 3)])
    assert max(found.values()) < 60
    # Of a printed kind, with a ruler that measured two percent too long: so is every distance.
    kind = ["--sheet", "disc_with_chessboard", "--diameter-m", "0.06", "--set", "chessboard.columns=5"]
    kind += ["--set", "chessboard.rows=4", "--set", "chessboard.square_m=0.02", "--ruler-mm", "102"]
    assert main(["import", str(few), str(tmp_path / "long"), *kind, "--camera", str(camera)]) == 0
    longer = open_dataset(tmp_path / "long").truth["distance_m"].to_numpy() / dataset.truth["distance_m"].to_numpy()
    np.testing.assert_allclose(longer, 1.02, rtol=1e-6)


def test_errors_are_one_line_and_write_nothing(album, study, tmp_path, capsys):
    def fails(*arguments, code=2):
        assert main(["import", *map(str, arguments)]) == code
        (line,) = [
            text for text in capsys.readouterr().err.splitlines() if "warning" not in text and "boards:" not in text
        ]
        return line

    out, sheet = tmp_path / "out", ["--sheet", study.path]
    assert "is no folder" in fails(tmp_path / "nowhere", out, *sheet)
    empty = tmp_path / "empty"
    empty.mkdir()
    assert "has no photographs" in fails(empty, out, *sheet)
    assert "is not empty" in fails(album, album, *sheet)
    assert "no group has a sheet with a circle and a board" in fails(album, out, "--sheet", "demo")
    assert "the study says what was printed" in fails(album, out, *sheet, "--diameter-m", "0.06")
    assert "needs a circle with one" in fails(album, out, "--sheet", "chessboard")
    mixed = tmp_path / "mixed"
    mixed.mkdir()
    for name in ("IMG_0001.jpg", "IMG_0002.jpg", "IMG_0004.jpg"):
        (mixed / name).write_bytes((album / name).read_bytes())
    sink = io.BytesIO()
    Image.open(album / "IMG_0004.jpg").resize((800, 600)).save(sink, format="JPEG")
    (mixed / "IMG_0003.jpg").write_bytes(sink.getvalue())
    assert "IMG_0003.jpg: has 800x600 px, but others have 640x480" in fails(mixed, out, *sheet)
    (mixed / "IMG_0003.jpg").unlink()
    camera = tmp_path / "camera.json"
    camera.write_text(json.dumps({**camera_to_json(CAMERA), "width_px": 641}))
    assert "is for 641x480 px" in fails(mixed, out, *sheet, "--camera", camera)
    assert not out.exists()


@pytest.mark.slow
def test_rendered_photographs_and_their_truth(tmp_path):
    """25 rendered photographs of a phone-like camera: pose and camera within their covariance, and all the way."""
    text = """\
schema: 1
name: phone
seed: 7
camera: {width_px: 1280, height_px: 960, focal_px: 1050, principal_point_x_px: 645, principal_point_y_px: 474,
         distortion: [0.06, -0.11, 0.0006, -0.0004]}
marker: {kind: disc_with_chessboard, diameter_m: 0.06, gap_m: 0.015, chessboard: {columns: 6, rows: 5, square_m: 0.02}}
light: {environment: 0.7, lamps: [{position_m: [-0.6, -0.8, -0.2], size_m: 0.3, radiance: 12}]}
sensor: {full_well_e: 6000, read_noise_e: 4, mosaic: rggb, curve: srgb, isp: phone, jpeg_quality: 92}
render: {target_error: 0.004, radiance: false}
pose:
  distance_m: {uniform: [0.36, 0.55]}
  tilt_deg: {uniform: [8, 42]}
  azimuth_deg: {uniform: [-180, 180]}
  roll_deg: {uniform: [-25, 25]}
  offset_x_px: {uniform: [-400, -180]}
  offset_y_px: {uniform: [-140, 140]}
frames: 25
"""
    path = tmp_path / "phone.yaml"
    path.write_text(text)
    rendered, album, out = tmp_path / "rendered", tmp_path / "album", tmp_path / "dataset"
    assert main(["render", str(path), str(rendered)]) == 0
    album.mkdir()
    for i, file in enumerate(sorted((rendered / "images").iterdir()), start=1):
        (album / f"IMG_{i:04d}.jpg").write_bytes(with_exif(file.read_bytes(), 28, 6 if i % 5 == 3 else 1))
    assert main(["import", str(album), str(out), "--sheet", str(path)]) == 0
    dataset = open_dataset(out)
    assert len(dataset) >= 23
    found = np.array(list(reference_errors(dataset, list(frames_of(load_study(path)))).values()))
    assert np.mean(found < 16.81) >= 0.95  # the ellipsoid of 99 %
    # All share the error of one camera, of 8 degrees of freedom: their mean scatters by a half.
    assert 0.4 < np.mean(found) / 6 < 2.0
    record = json.loads((out / "camera.json").read_text())
    k = np.array(record["K"])
    error = np.array([k[0, 0], k[1, 1], k[0, 2], k[1, 2], *record["distortion"]])
    error -= [1050, 1050, 645, 474, 0.06, -0.11, 0.0006, -0.0004]
    assert chi_square(error, np.array(record["calibration"]["covariance"])) < 26.1
    command = [Path(sys.executable).parent / "roundel"]
    for arguments in (["solve", out, tmp_path / "est"], ["validate", out, tmp_path / "est", "--out", tmp_path / "rep"]):
        subprocess.run([*command, *arguments], check=True, capture_output=True, timeout=600)
    runs = {r["intrinsics"]: r for r in json.loads((tmp_path / "rep" / "summary.json").read_text())["runs"]}
    assert set(runs) == {"true", "exif", "default"}
    medians = {label: run["oracle"]["position_error_pct"]["median"] for label, run in runs.items()}
    assert medians["true"] < 0.3 < medians["exif"] < medians["default"]
