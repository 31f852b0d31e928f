"""`roundel calibrate` and `calibrate_from` on rendered circle grids, and what is said where they cannot be used."""

import json
from pathlib import Path

import numpy as np
import pytest
from helpers_boards import GRID, GRID_CAMERA, grid_image, grid_poses
from PIL import Image

from roundel.cli.main import main
from roundel.render.run import render_study
from roundel.validate.calibration.opencv import read_camera

STUDY = """\
schema: 1
name: grids
seed: 4
camera: {width_px: 320, height_px: 240, focal_px: 350, distortion: [-0.2, 0.05, 0.0005, -0.0005]}
marker: {kind: circle_grid, columns: 5, rows: 4, spacing_m: 0.03, diameter_m: 0.02}
pose:
  distance_m: {uniform: [0.28, 0.34]}
  tilt_deg: {uniform: [15, 40]}
  azimuth_deg: {uniform: [-180, 180]}
  offset_x_px: {uniform: [-30, 30]}
  offset_y_px: {uniform: [-15, 15]}
light: {environment: 1.0}
sensor: {}
render: {target_error: 0.01, radiance: false}
groups:
  grid: {frames: 5}
  asymmetric:
    frames: 3
    marker: {kind: circle_grid, columns: 3, rows: 7, spacing_m: 0.018, diameter_m: 0.016, layout: asymmetric}
  disc: {frames: 2, marker: {kind: disc, diameter_m: 0.06}}
solve: {groups: [disc], intrinsics: [calibrated, "calibrated:4"], calibrate_from: grid}
"""


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("grids")
    (folder / "study.yaml").write_text(STUDY, encoding="utf-8")
    render_study(folder / "study.yaml", folder / "out" / "dataset")
    return folder / "out" / "dataset"


def error_of(capsys: pytest.CaptureFixture[str], *argv: object) -> tuple[int, str]:
    capsys.readouterr()
    code = main([str(a) for a in argv])
    lines = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("calibrate:")]
    assert len(lines) == 1, lines
    return code, lines[0]


@pytest.mark.parametrize(("group", "views"), [(None, 5), ("asymmetric", 3)])
def test_a_rendered_camera(
    dataset: Path, tmp_path: Path, group: str | None, views: int, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "camera.json"
    assert main(["calibrate", str(dataset), str(file), *(["--group", group] if group else [])]) == 0
    said = capsys.readouterr().out
    assert f"calibration: {views} of {views} views" in said
    assert "against the true camera: fx" in said
    record = json.loads(file.read_text(encoding="utf-8"))["calibration"]
    camera, sigma = read_camera(file), record["sigma"]
    found = [camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2]]
    for name, value, true in zip(("fx", "fy", "cx", "cy"), found, (350.0, 350.0, 159.5, 119.5), strict=True):
        # Eight numbers of one run, each within four standard deviations but for one run in 2,000.
        assert abs(value - true) < 4 * sigma[name], name
        assert sigma[name] < 0.2, name
    assert record["parameters"] == ["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "diameter_m", "edge_px"]
    np.testing.assert_allclose(np.sqrt(np.diag(record["covariance"])), [sigma[n] for n in record["parameters"]])
    assert record["group"] == (group or "grid")


def test_first_views_and_k3(dataset: Path, tmp_path: Path) -> None:
    file = tmp_path / "camera.json"
    assert main(["calibrate", str(dataset), str(file), "--views", "4", "--k3", "--group", "grid"]) == 0
    record = json.loads(file.read_text(encoding="utf-8"))
    assert record["calibration"]["frames"] == [0, 1, 2, 3]
    assert len(record["distortion"]) == 5


def test_a_study_calibrates_from_its_grids(dataset: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = dataset.parent
    assert main(["run", str(out.parent / "study.yaml"), str(out)]) == 0
    assert "calibration: 4 of 4 views" in capsys.readouterr().out
    assert read_camera(out / "circle_grid.json").K[0, 0] == pytest.approx(350, abs=0.5)
    runs = json.loads((out / "report" / "summary.json").read_text(encoding="utf-8"))["runs"]
    assert {run["intrinsics"] for run in runs} >= {"calibrated:circle_grid", "calibrated:4"}


def test_what_cannot_be_calibrated_from(dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "camera.json"
    code, line = error_of(capsys, "calibrate", dataset, file, "--views", 2)
    assert (code, "found in 2 of 2 views; a calibration needs 3" in line) == (3, True)
    code, line = error_of(capsys, "calibrate", dataset, file, "--views", 9)
    assert (code, line) == (
        2, "roundel: 9 views are requested, but 5 show a circle grid; request at most that many",
    )  # fmt: skip
    code, line = error_of(capsys, "calibrate", dataset, file, "--group", "disc")
    assert (code, "no frame shows a" in line) == (3, True)
    code, line = error_of(capsys, "calibrate", dataset, file, "--group", "gird")
    assert (code, "no group 'gird'" in line) == (2, True)
    code, line = error_of(capsys, "calibrate", dataset, file, "--grid", "5x4")
    assert (code, line) == (2, "roundel: --grid: goes with photographs; a dataset records its board; leave it out")
    assert not file.exists()


def test_photographs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    photos = []
    for i, pose in enumerate(grid_poses(4)):
        photos.append(tmp_path / f"{i}.png")
        Image.fromarray(grid_image(GRID_CAMERA, pose, GRID, seed=i)).save(photos[-1])
    file = tmp_path / "camera.json"
    printed = ["--grid", "6x5", "--spacing-m", "0.03", "--diameter-m", "0.018"]
    assert main([*map(str, ["calibrate", *photos, file]), *printed, "--curve", "linear"]) == 0
    assert "calibration: 4 of 4 views" in capsys.readouterr().out
    assert read_camera(file).K[0, 0] == pytest.approx(700, abs=1.0)
    # Taken for sRGB, linear levels displace every edge: this is seen, and the camera hardly changes.
    assert main([*map(str, ["calibrate", *photos, file]), *printed, "--curve", "srgb"]) == 0
    assert "px outward: the response curve of the images is another" in capsys.readouterr().out
    assert read_camera(file).K[0, 0] == pytest.approx(700, abs=1.0)

    code, line = error_of(capsys, "calibrate", *photos, file, "--grid", "6x5")
    assert (code, "a circle grid needs --grid COLUMNSxROWS, --spacing-m and --diameter-m" in line) == (2, True)
    code, line = error_of(capsys, "calibrate", *photos, file, *printed[:4], "--diameter-m", "0.04")
    assert (code, "neighbours touch or overlap" in line) == (2, True), line
    code, line = error_of(capsys, "calibrate", tmp_path / "none.png", photos[0], file, *printed)
    assert (code, "none.png" in line) == (4, True)
    # Another size is left out by name; that leaves three, which circles allow.
    Image.fromarray(np.zeros((100, 100), dtype=np.uint8)).save(photos[1])
    capsys.readouterr()
    assert main([*map(str, ["calibrate", *photos, file]), *printed, "--curve", "linear"]) == 0
    said = capsys.readouterr()
    assert "calibration: 3 of 4 views" in said.out
    assert "1.png: fewer than six dots of the circle grid found" in said.err
    page = (tmp_path / "camera.html").read_text(encoding="utf-8")
    assert "take at least 7 more photographs" in page.lower()
