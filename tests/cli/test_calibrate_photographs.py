"""`roundel calibrate PHOTOS... CAMERA --board ...` on rendered JPEG photographs, good ones and others."""

import json
import re
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from helpers_boards import board_image
from PIL import Image

from roundel.cli.main import main
from roundel.datasets.dataset import open_dataset
from roundel.render.run import render_study
from roundel.scenes.camera.camera_file import camera_file_text, read_camera_record
from roundel.scenes.camera.model import Camera
from roundel.scenes.camera.quarter_turns import turned_camera
from roundel.solver.detect.chessboard_corners import BoardLayout
from roundel.validate.calibration.opencv import read_camera

STUDY = """\
schema: 1
name: boards
seed: 4
camera:
  {width_px: 400, height_px: 300, focal_px: 380, principal_point_x_px: 203, principal_point_y_px: 147,
   distortion: [-0.15, 0.04, 0.001, -0.0008]}
marker: {kind: chessboard, columns: 8, rows: 5, square_m: 0.02}
pose:
  distance_m: {uniform: [0.26, 0.32]}
  tilt_deg: {uniform: [20, 40]}
  azimuth_deg: {uniform: [-180, 180]}
  roll_deg: {uniform: [-20, 20]}
  offset_x_px: {uniform: [-40, 40]}
  offset_y_px: {uniform: [-20, 20]}
light: {environment: 1.0}
sensor: {curve: srgb, jpeg_quality: 90}
render: {target_error: 0.03, radiance: false}
groups:
  chessboard: {frames: 7}
  charuco:
    frames: 7
    marker: {kind: charuco, columns: 8, rows: 5, square_m: 0.022, tag_m: 0.016}
  disc: {frames: 1, marker: {kind: disc, diameter_m: 0.06}}
"""
FRONT = Camera(400, 300, np.array([[380.0, 0, 203], [0, 380, 147], [0, 0, 1]]), (-0.15, 0.04, 0.001, -0.0008))
TRUTH = {"fx": 380.0, "fy": 380.0, "cx": 203.0, "cy": 147.0, "k1": -0.15, "k2": 0.04, "p1": 0.001, "p2": -0.0008}


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of photographs of each board."""
    folder = tmp_path_factory.mktemp("boards")
    (folder / "study.yaml").write_text(STUDY, encoding="utf-8")
    render_study(folder / "study.yaml", folder / "dataset")
    images = open_dataset(folder / "dataset").images
    for number, (frame, group) in enumerate(zip(images.frame_ids, images.groups, strict=True)):
        (folder / group).mkdir(exist_ok=True)
        shutil.copy(folder / "dataset" / "images" / f"{frame:06d}.jpg", folder / group / f"IMG_{number:02d}.jpg")
    return folder


@pytest.fixture
def some(photos: Path, tmp_path: Path) -> Path:
    """A copy of the chessboard's photographs, to be spoilt."""
    return shutil.copytree(photos / "chessboard", tmp_path / "photos")


@dataclass(frozen=True)
class Said:
    code: int
    out: str
    err: str


def calibrate(capsys: pytest.CaptureFixture[str], *argv: object) -> Said:
    capsys.readouterr()
    code = main(["calibrate", *map(str, argv)])
    said = capsys.readouterr()
    return Said(code, said.out, "\n".join(t for t in said.err.splitlines() if not t.startswith("calibrate:")))


@pytest.mark.parametrize("kind", ["chessboard", "charuco"])
def test_from_the_print_to_a_pose(photos: Path, tmp_path: Path, kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    board, file = tmp_path / "board.pdf", tmp_path / "camera.yaml"
    assert main(["marker", kind, str(board)]) == 0
    said = calibrate(capsys, photos / kind, file, "--board", board)
    assert said.code == 0, said.err
    assert "calibration: 7 of 7 views" in said.out
    assert "next: take at least 3 more photographs" in said.out
    record = read_camera_record(file)["calibration"]
    values = [*read_camera(file).K[[0, 1, 0, 1], [0, 1, 2, 2]], *read_camera(file).distortion]
    for (name, true), value in zip(TRUTH.items(), values, strict=True):
        # Sixteen numbers of one run: four standard deviations are exceeded in one run of 1,000.
        assert abs(value - true) < 4 * record["sigma"][name], name
    assert record["sigma"]["fx"] < 1.0
    assert (record["board"], record["views"], record["exif_orientation"]) == (kind, 7, 1)
    np.testing.assert_allclose(np.sqrt(np.diag(record["covariance"])), [record["sigma"][n] for n in TRUTH])

    page = (tmp_path / "camera.html").read_text(encoding="utf-8")
    assert "What to photograph next" in page
    assert page.count("IMG_") == 7
    assert not re.search(r"https?://(?!www\.w3\.org)|<script", page)

    # The file as it is, with the covariance: without it the pose is said to be more certain than it is.
    poses = {}
    for name in ("camera.yaml", "exact.json"):
        if name == "exact.json":
            bare = {k: v for k, v in read_camera_record(file).items() if k != "calibration"}
            (tmp_path / name).write_text(camera_file_text(bare, name), encoding="utf-8")
        out = tmp_path / f"out-{name}"
        argv = ["solve", photos / "disc", out, "--diameter-m", 0.06, "--intrinsics", tmp_path / name]
        assert main([str(a) for a in argv]) == 0
        poses[name] = _first_estimate(out)
    basis, sigma = poses["camera.yaml"]
    assert "with the covariance of its parameters" in basis
    assert "taken as exact" in poses["exact.json"][0]
    assert sigma > 1.05 * poses["exact.json"][1]


def _first_estimate(out: Path) -> tuple[str, float]:
    """What the camera is based on, and the standard deviation of the circle's distance."""
    photo = json.loads((out / "estimates.json").read_text(encoding="utf-8"))["photographs"][0]
    (camera,) = photo["cameras"].values()
    return camera["basis"], photo["detections"][0]["estimates"][0]["candidates"][0]["distance_sigma_m"]


def test_a_dataset_records_its_board(photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = calibrate(capsys, photos / "dataset", tmp_path / "camera.json", "--board", "chessboard")
    assert (said.code, said.err) == (
        2, "roundel: --board: goes with photographs; a dataset records its board; leave it out",
    )  # fmt: skip


def test_a_folder_without_photographs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "empty").mkdir()
    said = calibrate(capsys, tmp_path / "empty", tmp_path / "camera.json", "--board", "chessboard")
    assert said.code == 2
    assert said.err.endswith("empty: no photographs in this folder (its sub-folders are not searched)")


def test_a_phone_held_upright(photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # ChArUco boards are found ten times faster than chessboards.
    some = shutil.copytree(photos / "charuco", tmp_path / "photos")
    files = sorted(some.iterdir())
    plain, mixed, upright = (tmp_path / f"{name}.yaml" for name in ("plain", "mixed", "upright"))
    assert calibrate(capsys, some, plain, "--board", "charuco").code == 0
    for file, orientation in zip(files[:3], (6, 3, 8), strict=True):
        _write_orientation(file, orientation)
    assert calibrate(capsys, some, mixed, "--board", "charuco").code == 0
    same = read_camera_record(mixed), read_camera_record(plain)
    np.testing.assert_allclose(*(np.array(r["K"]) for r in same), rtol=1e-9)
    np.testing.assert_allclose(*(np.array(r["calibration"]["covariance"]) for r in same), rtol=1e-6, atol=1e-18)

    for file in files:
        _write_orientation(file, 6)
    assert calibrate(capsys, some, upright, "--board", "charuco").code == 0
    turned, _ = turned_camera(read_camera(plain), None, 1)
    found = read_camera(upright)
    assert (found.width_px, found.height_px) == (300, 400)
    np.testing.assert_allclose(found.K, turned.K, rtol=1e-9)
    assert found.distortion == pytest.approx(turned.distortion)

    # The camera file of photographs taken across solves one that was taken upright, and says the same distance.
    shutil.copytree(photos / "disc", tmp_path / "disc")
    sigmas = {}
    for name in ("across", "upright"):
        if name == "upright":
            _write_orientation(next((tmp_path / "disc").iterdir()), 6)
        argv = ["solve", tmp_path / "disc", tmp_path / name, "--diameter-m", 0.06, "--intrinsics", plain]
        assert main([str(a) for a in argv]) == 0
        sigmas[name] = _first_estimate(tmp_path / name)[1]
    assert sigmas["upright"] == pytest.approx(sigmas["across"], rel=1e-2)


def _write_orientation(path: Path | str, orientation: int, focal_35mm_mm: int = 26) -> None:
    """Set the EXIF orientation, with the pixels as they are: a phone's file when it was held otherwise."""
    data = Path(path).read_bytes()
    exif = Image.Exif()
    exif[274] = orientation
    exif.get_ifd(0x8769)[0xA405] = focal_35mm_mm
    body = exif.tobytes()
    # An APP1 segment after the start of the image; an earlier one is replaced.
    rest = data[2:]
    if rest[:2] == b"\xff\xe1":
        rest = rest[2 + int.from_bytes(rest[2:4], "big") :]
    Path(path).write_bytes(data[:2] + b"\xff\xe1" + (len(body) + 2).to_bytes(2, "big") + body + rest)


def test_what_is_left_out_is_named(some: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files, file = sorted(some.iterdir()), tmp_path / "camera.json"
    shutil.copy(files[0], some / "copy.jpg")
    with Image.open(files[1]) as image:
        image.resize((800, 600)).save(some / "larger.jpg", quality=95)
        # Cut by the border of the picture: a chessboard has to be whole.
        image.crop((0, 0, 200, 300)).resize((400, 300)).save(some / "part.jpg", quality=95)
        image.transpose(Image.Transpose.ROTATE_90).save(some / "turned.jpg", quality=95)
        # The same view once more, in another file.
        image.save(some / "resaved.png")
    (some / "broken.jpg").write_bytes(files[2].read_bytes()[:300])
    _write_orientation(shutil.copy(files[3], some / "mirrored.jpg"), 2)
    for other in files[1:]:
        _write_orientation(other, 1)
    _write_orientation(shutil.copy(files[6], some / "wide.jpg"), 1, 13)
    said = calibrate(capsys, some, file, "--board", "chessboard")
    assert said.code == 0, said.err
    assert "calibration: 7 of 15 views" in said.out
    lines = {Path(line.split(": ")[1]).name: line for line in said.err.splitlines()}
    # By name a copy comes after IMG_00, of which it is one.
    for name, why in {
        "copy.jpg": "is the same file as",
        "larger.jpg": "has 800x600 px, but most have 400x300: it was scaled",
        "part.jpg": "no chessboard of 8 by 5 inner corners found: all of it has to be in the picture",
        "turned.jpg": "has 300x400 px, but most have 400x300: it was turned without a note in its EXIF",
        "resaved.png": "shows the board exactly where",
        "mirrored.jpg": "is stored mirrored (EXIF orientation 2)",
        "broken.jpg": "",
        "wide.jpg": "its EXIF has a focal length of 13 mm, most have 26 mm",
    }.items():
        assert why in lines[name], name
    assert len(lines) == 8
    page = (tmp_path / "camera.html").read_text(encoding="utf-8")
    assert page.count("not used: ") == 8


def test_too_few_and_all_from_the_front(some: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "camera.json"
    said = calibrate(capsys, some, file, "--board", "chessboard", "--views", 3)
    assert (said.code, "the board counts in 3 of 3 photographs, which is too few: take 10 or more" in said.err) == (
        3,
        True,
    )
    assert not file.exists()
    assert "No camera follows" in (tmp_path / "camera.html").read_text(encoding="utf-8")

    front = tmp_path / "front"
    front.mkdir()
    for i in range(8):
        shift = np.array([[0.08 * i, 0.02 * (i % 3), 0.28 + 0.01 * i]]) - [[0.28, 0.02, 0.0]]
        pose = np.diag([1.0, -1.0, -1.0, 1.0])
        pose[:3, 3] = shift * [0.1, 0.1, 1.0]
        Image.fromarray(board_image(FRONT, pose, BoardLayout(8, 5, 0.02), 4, 0.7)).save(front / f"{i}.png")
    said = calibrate(capsys, front, file, "--board", "chessboard")
    if said.code == 0:  # whatever is stated covers the truth, and is said to be weak
        sigma = read_camera_record(file)["calibration"]["sigma"]["fx"]
        assert abs(read_camera(file).K[0, 0] - 380) < 4 * sigma
        assert "warning: the photographs leave the focal length open" in said.out
    else:
        assert (said.code, "determine the focal length" in said.err) == (3, True)


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ([], "photographs need --board"),
        (["--board", "chesboard"], "did you mean chessboard?"),
        (["--board", "disc"], "a disc is no board to calibrate from"),
        (["--board", "chessboard", "--set", "columns=6", "--set", "rows=4"], "look the same upside down"),
        (["--board", "chessboard", "--set", "square=0.02"], "square"),
        (["--board", "chessboard", "--bend", "2"], "--bend: is fitted to circle grids"),
        (["--board", "chessboard", "--grid", "7x5"], "leave them or --board out"),
        (["--board", "none.pdf"], "no such file"),
        (["--board", "none.yaml"], "no such file"),
        (["--board", "chessboard", "--group", "x"], "photographs have no groups"),
        (["--grid", "7x5"], "a circle grid needs --grid COLUMNSxROWS, --spacing-m and --diameter-m"),
    ],
)
def test_what_is_refused_on_one_line(
    photos: Path, tmp_path: Path, options: list[str], why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    said = calibrate(capsys, photos / "chessboard", tmp_path / "camera.json", *options)
    assert (said.code, why in said.err, said.err.count("\n")) == (2, True, 0), said.err
    assert not (tmp_path / "camera.json").exists()


@pytest.mark.parametrize(
    ("kind", "wrong", "hint"),
    [
        (
            "chessboard",
            ["columns=9", "rows=6"],
            "8 by 5 inner corners, which are what counts: give --set columns=8 --set rows=5",
        ),
        ("charuco", ["family=aruco_5x5_100"], "tags of the family aruco_4x4_50: give --set family=aruco_4x4_50"),
    ],
)
def test_another_board_is_recognised(
    photos: Path, tmp_path: Path, kind: str, wrong: list[str], hint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    options = [part for one in wrong for part in ("--set", one)]
    file = next((photos / kind).iterdir())
    said = calibrate(capsys, file, tmp_path / "camera.json", "--board", kind, *options)
    assert (said.code, hint in said.err, "is in none of the 1 photographs" in said.err) == (3, True, True), said.err


def test_a_board_in_yaml(photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "board.yaml"
    file.write_text("marker: {kind: charuco, columns: 8, rows: 5, square_m: 0.022, tag_m: 0.016}\n", encoding="utf-8")
    said = calibrate(capsys, photos / "charuco", tmp_path / "camera.json", "--board", file, "--set", "square_m=0.0222")
    assert said.code == 0, said.err
    # The size that was measured scales the distances, not the camera.
    assert "squares of 0.0222 m" in (tmp_path / "camera.html").read_text(encoding="utf-8")
    assert read_camera(tmp_path / "camera.json").K[0, 0] == pytest.approx(380, abs=2)
