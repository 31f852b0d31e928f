"""Photographs to poses: the numbers, the record, the pictures, and the handling of bad files."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from helpers_images import coverage
from PIL import Image

from roundel.scenes.camera.model import Camera
from roundel.scenes.errors import UsageError
from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic
from roundel.scenes.geometry.pose import angle_deg, camera_from_marker_of, normal_of
from roundel.solver.ambiguity.normal_prior import NormalPrior
from roundel.solver.estimates import Estimate
from roundel.solver.photos.overlay import CANDIDATES, CONTOUR, Drawn, draw_overlay
from roundel.solver.photos.photo_report import line_of, with_sigma
from roundel.solver.photos.photographs import solve_photographs
from roundel.validate.estimates.reader import read_estimates

WIDTH, HEIGHT, F35 = 320, 240, 28.0
FOCAL_PX = F35 * math.hypot(WIDTH, HEIGHT) / math.hypot(36, 24)
K = np.array([[FOCAL_PX, 0, (WIDTH - 1) / 2], [0, FOCAL_PX, (HEIGHT - 1) / 2], [0, 0, 1.0]])
DIAMETER_M = 0.08
NORMAL, CENTRE = normal_of(35.0, 20.0), np.array([0.03, -0.02, 0.36])
DISTANCE = float(np.linalg.norm(CENTRE))


def light(width=WIDTH, height=HEIGHT, k=K) -> np.ndarray:
    """What a sensor collects of the disc, 0 to 1."""
    pose = camera_from_marker_of(NORMAL, CENTRE)
    ellipse = ellipse_of_conic(conic_of_circle(pose, DIAMETER_M / 2, k))
    return 0.75 - 0.7 * coverage(ellipse, width, height, blur_px=0.8)


def encoded(values: np.ndarray) -> np.ndarray:
    """sRGB, 8 bits."""
    srgb = np.where(values <= 0.0031308, 12.92 * values, 1.055 * values ** (1 / 2.4) - 0.055)
    return np.rint(255 * srgb).astype(np.uint8)


@pytest.fixture(scope="module")
def shots(tmp_path_factory) -> dict[str, Path]:
    """The same view as several files."""
    folder = tmp_path_factory.mktemp("shots")
    colour = np.repeat(encoded(light())[..., None], 3, axis=2)
    tags = Image.Exif()
    tags.get_ifd(0x8769).update({0xA405: 28, 0xA002: WIDTH, 0xA003: HEIGHT})
    Image.fromarray(colour).save(folder / "phone.jpg", quality=97, exif=tags)
    tags[0x0112] = 6
    Image.fromarray(np.rot90(colour)).save(folder / "turned.jpg", quality=97, exif=tags)
    Image.fromarray(colour).save(folder / "plain.png")
    Image.fromarray(np.rint(65535 * light()).astype(np.uint16)).save(folder / "linear.png")
    Image.new("L", (64, 48), 128).save(folder / "blank.png")
    (folder / "broken.jpg").write_bytes((folder / "phone.jpg").read_bytes()[:900])
    return {path.name: path for path in folder.iterdir()}


def best(estimate: Estimate) -> int:
    return int(np.argmin(angle_deg(estimate.normal, NORMAL)))


def test_exif_gives_the_pose(shots, tmp_path):
    (result,) = solve_photographs([shots["phone.jpg"]], tmp_path, DIAMETER_M)
    (estimate,) = result.estimates
    assert result.status == "ok"
    assert estimate.intrinsics == "exif"
    i = best(estimate)
    # A noiseless image in 8 bits after JPEG: some 0.02 px of 60, and a normal within tenths of a degree.
    assert np.linalg.norm(estimate.centre_m[i]) == pytest.approx(DISTANCE, rel=1e-3)
    assert angle_deg(estimate.normal[i], NORMAL) < 0.3
    assert estimate.probability == (0.5, 0.5)


def test_an_upright_photograph_is_measured_upright(shots, tmp_path):
    as_is, turned = solve_photographs([shots["phone.jpg"], shots["turned.jpg"]], tmp_path, DIAMETER_M)
    assert (turned.width_px, turned.height_px) == (WIDTH, HEIGHT)
    assert turned.estimates[0].ellipse[:4] == pytest.approx(as_is.estimates[0].ellipse[:4], abs=0.03)  # JPEG's blocks


def test_the_curve_is_undone(shots, tmp_path):
    # Behind the sRGB curve a dark disc looks smaller: its edge's middle is darker than the mean of its sides.
    right = solve_photographs([shots["phone.jpg"]], tmp_path / "a", DIAMETER_M)[0].estimates[0]
    wrong = solve_photographs([shots["phone.jpg"]], tmp_path / "b", DIAMETER_M, curve="linear")[0].estimates[0]
    linear = solve_photographs(
        [shots["linear.png"]], tmp_path / "c", DIAMETER_M, intrinsics=["focal35:28"], curve="linear"
    )[0].estimates[0]
    assert right.ellipse[2] == pytest.approx(linear.ellipse[2], abs=0.02)
    assert abs(wrong.ellipse[2] - linear.ellipse[2]) > 0.15


def test_default_intrinsics_say_their_spread(shots, tmp_path):
    (result,) = solve_photographs([shots["plain.png"]], tmp_path, DIAMETER_M)
    (estimate,) = result.estimates
    assert estimate.intrinsics == "default"
    one = json.loads((tmp_path / "estimates.json").read_text())["photographs"][0]["detections"][0]["estimates"][0]
    for candidate in one["candidates"]:
        # The focal length's 11.5 % is nearly all of it (the principal point and the edge add their share).
        assert candidate["distance_sigma_m"] / candidate["distance_m"] == pytest.approx(0.115, abs=0.005)
        assert abs(candidate["distance_m"] - DISTANCE) < candidate["distance_sigma_m"]
    assert "default phone model: 29.95 mm (35-mm equivalent, by diagonal), +- 11.5 %" in line_of(result)


def test_a_focal_length_that_is_exact_adds_nothing(shots, tmp_path):
    (result,) = solve_photographs([shots["plain.png"]], tmp_path, DIAMETER_M, intrinsics=["focal35:28", "default"])
    exact, default = result.estimates
    assert (exact.intrinsics, default.intrinsics) == ("focal35:28", "default")
    assert np.sqrt(exact.cov[0, 2, 2]) < 0.1 * np.sqrt(default.cov[0, 2, 2])


def test_one_bad_photograph_does_not_stop_the_others(shots, tmp_path):
    names = ["broken.jpg", "blank.png", "plain.png", "none.jpg"]
    paths = [shots.get(name, tmp_path / name) for name in names]
    seen = []
    results = solve_photographs(
        paths, tmp_path / "out", DIAMETER_M, progress=lambda done, total: seen.append((done, total))
    )
    assert [r.status for r in results] == ["failed", "no circle", "ok", "failed"]
    assert "truncated" in results[0].reason
    assert "No such file" in results[3].reason
    assert seen == [(0, 4), (1, 4), (2, 4), (3, 4), (4, 4)]
    rows = read_estimates(tmp_path / "out").to_pylist()
    assert [(r["frame_id"], r["detection_id"], r["status"]) for r in rows] == [
        (0, -1, "failed"),
        (1, -1, "failed"),
        (2, 0, "ok"),
        (2, 0, "ok"),
        (3, -1, "failed"),
    ]
    assert rows[1]["reason"] == "no circle found"
    record = json.loads((tmp_path / "out" / "estimates.json").read_text())
    assert record["diameter_m"] == DIAMETER_M
    assert [p["status"] for p in record["photographs"]] == ["failed", "no circle", "ok", "failed"]
    (detection,) = record["photographs"][2]["detections"]
    assert detection["estimates"][0]["confidence"] > 0.9
    # What was read has a picture, found or not.
    assert sorted(p.name for p in (tmp_path / "out" / "overlays").iterdir()) == ["blank.png", "plain.png"]


def test_exif_that_is_asked_for_and_not_there(shots, tmp_path):
    (result,) = solve_photographs([shots["plain.png"]], tmp_path, DIAMETER_M, intrinsics=["exif"])
    assert result.status == "failed"
    assert "the file has no EXIF; use default" in result.reason
    assert read_estimates(tmp_path).to_pylist()[0]["reason"] == result.reason
    (both,) = solve_photographs([shots["plain.png"]], tmp_path, DIAMETER_M, intrinsics=["exif", "default"])
    assert [bool(e) for e in both.estimates] == [True, False]


def test_equal_names_do_not_overwrite_each_other(shots, tmp_path):
    other = tmp_path / "more"
    other.mkdir()
    for name in ("blank.jpg", "BLANK.png", "blank.png"):
        Image.new("L", (32, 24), 99).save(other / name)
    paths = [shots["blank.png"], *sorted(other.iterdir())]
    results = solve_photographs(paths, tmp_path / "out", DIAMETER_M)
    assert len({r.overlay.lower() for r in results}) == 4
    assert all((tmp_path / "out" / r.overlay).is_file() for r in results)


@pytest.mark.parametrize("diameter", [0.0, -0.08, math.nan, math.inf])
def test_a_diameter_is_positive(shots, tmp_path, diameter):
    with pytest.raises(UsageError, match="positive number of metres"):
        solve_photographs([shots["blank.png"]], tmp_path, diameter)


def test_arguments_are_checked_before_anything_is_read(tmp_path):
    for arguments, says in (
        ({"intrinsics": ["true"]}, "camera is not known; use exif or default"),
        ({"intrinsics": ["scaled:0.7"]}, "not known"),
        ({"methods": ["mll"]}, "did you mean ml"),
        ({"knowledge": "same_sied"}, "did you mean same_side"),
    ):
        with pytest.raises(UsageError, match=says):
            solve_photographs([tmp_path / "none.jpg"], tmp_path / "out", DIAMETER_M, **arguments)
    assert not (tmp_path / "out").exists()


def drawn(chosen=None, scale=1.0) -> Drawn:
    camera = Camera(WIDTH, HEIGHT, K)
    pose = camera_from_marker_of(NORMAL, CENTRE)
    ellipse = ellipse_of_conic(conic_of_circle(pose, DIAMETER_M / 2, K))
    normal, centre = np.stack([NORMAL, normal_of(40.0, 200.0)]), np.stack([CENTRE, CENTRE])
    probability = (0.5, 0.5) if chosen is None else (1.0 - chosen, float(chosen))
    one = Estimate(0, 0, "ml", "default", "ok", "", ellipse, camera, normal, centre, probability, chosen)
    return Drawn(one, DIAMETER_M, "0.36 m")


def near(picture, colour):
    """Where a picture shows a colour, (n, 2) as x, y."""
    return np.argwhere(np.all(np.abs(picture.astype(int) - colour) < 12, axis=2))[:, ::-1]


def test_small_pictures_are_enlarged_and_large_ones_reduced():
    for (width, height), (expected, factor) in {
        (320, 240): (960, 3.0),
        (7, 5): (966, 138.0),
        (1000, 700): (1000, 1.0),
        (6400, 300): (3200, 0.5),
    }.items():
        picture = draw_overlay(np.full((height, width, 3), 90, dtype=np.uint8), [], "nothing")
        assert picture.shape[1] == expected
        assert picture.shape[0] > height * factor  # the strip with its line


def test_the_contour_is_drawn_where_it_is():
    picture = draw_overlay(np.full((HEIGHT, WIDTH, 3), 90, dtype=np.uint8), [drawn()], "footer")
    places = (near(picture, CONTOUR) + 0.5) / 3.0 - 0.5  # back to the image's pixels
    one = drawn().estimate.ellipse
    from roundel.solver.fit.ellipse_distance import foot_points

    assert len(places) > 200
    # The line is 2 thousandths of 960 px wide.
    assert np.max(np.abs(foot_points(one, places)[0])) < 1.5
    for colour in CANDIDATES:
        assert len(near(picture, colour)) > 50


def test_the_chosen_normal_is_the_thick_one():
    first, second = (draw_overlay(np.full((HEIGHT, WIDTH, 3), 90, dtype=np.uint8), [drawn(c)], "") for c in (0, 1))
    arrows = slice(0, 600)  # the label's letters have the same colours
    assert len(near(first[arrows], CANDIDATES[0])) > len(near(second[arrows], CANDIDATES[0]))


def test_overlays_survive_anything():
    blank = np.zeros((40, 60, 3), dtype=np.uint8)
    failed = Drawn(Estimate(0, 0, "ml", "default", "failed", "no ellipse fits"), DIAMETER_M, "no ellipse fits")
    behind = drawn()
    behind.estimate.centre_m[:] = [0.0, 0.0, 1e-6]
    assert draw_overlay(blank, [failed, behind, *([drawn()] * 40)], "words " * 80).shape[1] == 960


@pytest.mark.parametrize(
    ("value", "sigma", "says"),
    [
        (0.8304, 0.0951, "0.830 ± 0.095 m"),
        (12.34, 1.42, "12.3 ± 1.4 m"),
        (123.4, 25.0, "123 ± 25 m"),
        (0.5, None, "0.5 m"),
        (0.51234, 0.0, "0.5123 m"),
        (0.5, math.nan, "0.5 m"),
    ],
)
def test_values_with_two_digits_of_their_spread(value, sigma, says):
    assert with_sigma(value, sigma) == says


def test_knowledge_chooses(shots, tmp_path):
    told = NormalPrior(NORMAL, 5.0)
    (result,) = solve_photographs([shots["phone.jpg"]], tmp_path, DIAMETER_M, knowledge=told)
    (estimate,) = result.estimates
    assert estimate.chosen == best(estimate)
    assert estimate.probability[estimate.chosen] > 0.95
    assert "the declared normal" in estimate.choice_basis
    rows = read_estimates(tmp_path).to_pylist()
    assert [row["chosen"] for row in rows] == [i == estimate.chosen for i in range(2)]


def test_two_processes_give_the_same_files(shots, tmp_path):
    paths = [*shots.values(), tmp_path / "none.png"]
    for jobs in (1, 2):
        seen = []
        results = solve_photographs(
            paths, tmp_path / f"out{jobs}", 0.08, jobs=jobs, progress=lambda *now, seen=seen: seen.append(now)
        )
        assert [r.file for r in results] == [p.as_posix() for p in paths]
        assert seen == [(i, len(paths)) for i in range(len(paths) + 1)]
    first, second = (sorted((tmp_path / f"out{jobs}").rglob("*.*")) for jobs in (1, 2))
    assert len(first) == 3 + len(shots) - 1  # a broken file has no picture
    assert [p.name for p in first] == [p.name for p in second]
    assert [p.read_bytes() for p in first] == [p.read_bytes() for p in second]
