"""Photographs as phones write them: every container, orientation and trouble with metadata, in one folder."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest
from helpers_images import picture
from helpers_phones import Shot, write_dng, write_shots
from PIL import Image

from roundel.cli.main import main
from roundel.scenes.errors import UsageError
from roundel.solver.intrinsics.exif import ExifFocal, focal_of_exif
from roundel.solver.photos.photo_file import read_photo
from roundel.solver.photos.photo_inputs import find_photographs, pages_of
from roundel.solver.photos.photographs import solve_photographs

WIDTH, HEIGHT = 192, 144
# Off the middle and not round, so that every wrong orientation moves or turns it.
ELLIPSE = (70.0, 90.0, 30.0, 22.0, 25.0)


def view() -> np.ndarray:
    """The upright view in colour: a dark disc on light paper."""
    grey = np.asarray(picture([(ELLIPSE, 30)], WIDTH, HEIGHT, blur_px=0.8))
    return np.repeat(grey[..., None], 3, axis=2)


@pytest.fixture(scope="module")
def shots(tmp_path_factory: pytest.TempPathFactory) -> list[Shot]:
    return write_shots(tmp_path_factory.mktemp("phone"), view())


def test_sixty_photographs_are_read_upright_with_their_exif(shots: list[Shot]) -> None:
    assert len(shots) >= 60
    upright = view()[..., 1].astype(float)
    wrong = []
    for shot in shots:
        photo = read_photo(shot.path)
        # Lossy codecs move levels by some units; a wrong orientation by a hundred.
        if (photo.width_px, photo.height_px) != (WIDTH, HEIGHT) or np.abs(photo.picture[..., 1] - upright).mean() > 3:
            wrong.append(f"{shot.path.name}: pixels")
        focal = focal_of_exif(photo.exif, photo.width_px, photo.height_px)
        if shot.focal_35mm_mm is None:
            if isinstance(focal, ExifFocal) or shot.why_not not in focal.reason:
                wrong.append(f"{shot.path.name}: {focal}")
        elif not focal or focal.focal_px != pytest.approx(
            shot.focal_35mm_mm * math.hypot(WIDTH, HEIGHT) / math.hypot(36, 24), rel=1e-6
        ):
            wrong.append(f"{shot.path.name}: {focal}")
    assert wrong == []


def test_a_folder_is_one_command(shots: list[Shot], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = ("heic_6.HEIC", "jpeg_1.jpg", "cut.heic", "avif_3.avif")
    folder = tmp_path / "shots"
    folder.mkdir()
    for shot in shots:
        if shot.path.name in names:
            (folder / shot.path.name).write_bytes(shot.path.read_bytes())
    (folder / "._jpeg_1.jpg").write_bytes(b"a Mac's resource fork")
    (folder / "notes.txt").write_text("no photograph")
    out = tmp_path / "out"
    assert main(["solve", str(folder), str(out), "--diameter-m", "0.08", "--knowledge", "normal:0,0,-1:1"]) == 0
    said = capsys.readouterr().out
    assert "4 photographs, 4 circles, 0 failed" in said
    # Both poses of each circle, with tilt and distance; the tilt is 43 degrees, and the knowledge says 0 within 1.
    assert said.count("pose 1: ") == said.count("pose 2: ") == 4
    assert said.count(" deg, azimuth ") == 8
    assert said.count("the knowledge does not help: the declared normal") == 4
    assert said.count("it fits neither") == 4
    # Why EXIF was not believed: on the terminal, and in both files.
    assert said.count("the image was cut after its EXIF was written") == 1
    photographs = json.loads((out / "estimates.json").read_text())["photographs"]
    assert [bool(one["exif_problem"]) for one in photographs] == [False, True, False, False]
    rows = list(csv.DictReader((out / "estimates.csv").read_text().splitlines()))
    assert [(Path(row["file"]).name, row["candidate"]) for row in rows] == [
        (name, k) for name in sorted(names) for k in "01"
    ]
    assert {row["exif_problem"] != "" for row in rows if "cut.heic" in row["file"]} == {True}
    first = photographs[0]["detections"][0]["estimates"][0]["candidates"][0]
    for name in ("distance_m", "tilt_deg", "azimuth_deg", "probability"):
        assert float(rows[0][name]) == pytest.approx(first[name], rel=1e-12)


def test_patterns_and_missing_ones(tmp_path: Path) -> None:
    for name in ("b.JPG", "a.jpg", "c.txt"):
        (tmp_path / name).write_bytes(b"x")
    assert [p.path.name for p in find_photographs([tmp_path / "*"])] == ["a.jpg", "b.JPG"]
    assert [p.path.name for p in find_photographs([tmp_path, tmp_path / "none.jpg"])] == ["a.jpg", "b.JPG", "none.jpg"]
    with pytest.raises(UsageError, match="no photographs match this pattern"):
        find_photographs([tmp_path / "*.heic"])
    (tmp_path / "empty").mkdir()
    with pytest.raises(UsageError, match="no photographs in this folder"):
        find_photographs([tmp_path / "empty"])
    # A file whose name looks like a pattern is that file.
    (tmp_path / "shot[1].jpg").write_bytes(b"x")
    assert [p.path.name for p in find_photographs([tmp_path / "shot[1].jpg"])] == ["shot[1].jpg"]


def test_every_page_of_a_tiff_is_a_photograph(tmp_path: Path) -> None:
    path, blank = tmp_path / "scan.tif", Image.new("RGB", (WIDTH, HEIGHT), "white")
    turned = Image.fromarray(np.ascontiguousarray(view()[::-1, ::-1]))
    Image.fromarray(view()).save(path, save_all=True, append_images=[blank, turned])
    assert pages_of(path) == [0, 1, 2]
    results = solve_photographs([path], tmp_path / "out", 0.08)
    assert [(r.file.removeprefix(str(path)), r.status) for r in results] == [
        ("", "ok"),
        (", page 2", "no circle"),
        (", page 3", "ok"),
    ]
    first, third = results[0].estimates[0].ellipse, results[2].estimates[0].ellipse
    assert first is not None
    assert third is not None
    assert (WIDTH - 1 - first.x_px, HEIGHT - 1 - first.y_px) == pytest.approx((third.x_px, third.y_px), abs=0.02)
    assert sorted(p.name for p in (tmp_path / "out" / "overlays").iterdir()) == [
        "scan-page2.png",
        "scan-page3.png",
        "scan.png",
    ]


def test_a_thumbnail_in_a_tiff_is_no_photograph(tmp_path: Path) -> None:
    small = Image.new("RGB", (16, 12), "white")
    small.encoderinfo = {"tiffinfo": {254: 1}}
    Image.fromarray(view()).save(tmp_path / "a.tif", save_all=True, append_images=[small])
    assert pages_of(tmp_path / "a.tif") == [0]


def test_sixteen_bit_pages_keep_all_bits(tmp_path: Path) -> None:
    import cv2

    deep = [np.random.default_rng(i).integers(0, 65536, (24, 32, 3), dtype=np.uint16) for i in range(2)]
    cv2.imwritemulti(str(tmp_path / "deep.tif"), deep)
    for page, expected in enumerate(deep):
        assert np.array_equal(read_photo(tmp_path / "deep.tif", page=page).levels, expected[..., ::-1])


@pytest.mark.parametrize("orientation", [1, 6])
def test_a_dng_is_linear_and_upright(tmp_path: Path, orientation: int) -> None:
    from roundel.solver.photos.photo_file import as_stored

    light = np.full((HEIGHT, WIDTH), 40_000, np.uint16)
    light[:50, :60] = 10_000
    write_dng(tmp_path / "raw.dng", as_stored(light, orientation), orientation)
    photo = read_photo(tmp_path / "raw.dng")
    assert photo.photometry.curve.known
    assert (photo.width_px, photo.height_px) == (WIDTH, HEIGHT)
    assert photo.exif.focal_35mm_mm == 28
    # Linear: a quarter of the light is a quarter of the level, away from the edge.
    dark, bright = photo.grey[10:40, 10:50].mean(), photo.grey[70:130, 80:180].mean()
    assert dark / bright == pytest.approx(0.25, abs=0.005)
