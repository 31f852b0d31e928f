"""Values in a wrong unit are warned of, with their place; plausible studies are left alone."""

from pathlib import Path

import pytest
from helpers_studies import SMALL

from roundel.configs.shipped import starting_point, study_names, study_path
from roundel.scenes.study.layers import preset_names
from roundel.scenes.study.study import load_study
from roundel.scenes.world.plausibility import angle_of_view_deg, implausible_values

PRESET = "schema: 1\nname: p\npreset: {}\nmarker: {{kind: disc, diameter_m: 0.08}}\nframes: 1\n"
LENS = "camera: {width_px: 160, height_px: 120, focal_mm: 4, pixel_pitch_um: 3}"
CAMERA = "camera: {width_px: 160, height_px: 120, focal_px: 320}"


def lines_of(folder: Path, text: str) -> list[str]:
    path = folder / "study.yaml"
    path.write_text(text)
    return [line.removeprefix(f"{path}:") for line in implausible_values(load_study(path))]


@pytest.mark.parametrize("name", study_names())
def test_no_shipped_study_is_warned_of(name: str) -> None:
    assert implausible_values(load_study(study_path(name))) == []


@pytest.mark.parametrize("name", preset_names())
def test_no_preset_is_warned_of(name: str, tmp_path: Path) -> None:
    assert lines_of(tmp_path, PRESET.format(name)) == []


def test_nor_is_the_starting_point(tmp_path: Path) -> None:
    assert lines_of(tmp_path, starting_point()) == []


@pytest.mark.parametrize(
    ("old", "new", "place", "words"),
    [
        ("diameter_m: 0.08", "diameter_m: 80", "5:", "marker.diameter_m: a print of 80 m;"),
        ("disc, diameter_m: 0.08", "chessboard, columns: 6, rows: 5, square_m: 20", "5:", "square_m: a print of 20 m"),
        ("{uniform: [10, 50]}", "{uniform: [0.2, 0.9]}", "8:", "pose.tilt_deg: the largest tilt is 0.9 degrees"),
        ("{uniform: [10, 50]}", "{grid: [0.26, 0.52]}", "8:", "0.52 rad are 30"),
        ("{uniform: [10, 50]}", "0.785", "8:", "0.785 rad are 45"),
        ("[-180, 180]", "[-3.14159, 3.14159]", "9:", "pose.azimuth_deg: angles up to 3.142 degrees"),
        ("focal_px: 320", "focal_px: 26", "4:", "if the lens has 26 mm, give focal_mm and pixel_pitch_um"),
        ("focal_px: 320", "focal_px: 0.5", "4:", "a field of view of 179 degrees at 160x120 px"),
        (CAMERA, LENS.replace("3}", "0.003}"), "4:", "camera.focal_mm: a field of view of"),
        ("{uniform: [7, 9]}", "{loguniform: [7, 2000]}", "7:", "pose.distance_D: up to 2000 marker diameters"),
        ("distance_D: {uniform: [7, 9]}", "distance_m: 640", "7:", "pose.distance_m: up to 8000 marker diameters"),
    ],
)  # fmt: skip
def test_a_wrong_unit_is_one_line_with_its_place(tmp_path: Path, old: str, new: str, place: str, words: str) -> None:
    assert old in SMALL
    lines = lines_of(tmp_path, SMALL.replace(old, new))
    assert len(lines) == 1
    assert lines[0].startswith(place)
    assert words in lines[0]
    assert "\n" not in lines[0]


def test_a_sweep_has_the_wrong_unit_in_its_levels(tmp_path: Path) -> None:
    swept = SMALL + "sweep: {key: pose.tilt_deg, levels: [0, 0.4, 0.8]}\n"
    assert "0.8 rad are 46" in lines_of(tmp_path, swept)[0]
    assert lines_of(tmp_path, swept.replace("[0, 0.4, 0.8]", "[0, 20, 40]")) == []


def test_groups_that_share_a_key_share_its_line(tmp_path: Path) -> None:
    wrong = SMALL.replace("0.08", "80") + "groups: {near: {}, far: {pose: {distance_D: 20}}}\n"
    assert len(lines_of(tmp_path, wrong)) == 1


def test_further_markers_are_looked_at_too(tmp_path: Path) -> None:
    several = SMALL + "markers: {count: 1, kinds: [{kind: disc, diameter_m: 60}]}\n"
    assert "markers.kinds.0.diameter_m: a print of 60 m" in lines_of(tmp_path, several)[0]


def test_slight_curvature_and_a_head_on_view_are_no_wrong_units(tmp_path: Path) -> None:
    bent = SMALL.replace("diameter_m: 0.08}", "diameter_m: 0.08, surface: {shape: cylinder, radius_m: 50}}")
    assert lines_of(tmp_path, bent) == []
    assert lines_of(tmp_path, SMALL.replace("{uniform: [10, 50]}", "0")) == []


def test_a_fisheye_of_140_degrees_is_no_wrong_unit(tmp_path: Path) -> None:
    # 200 px of diagonal at 2.44 rad of equidistant projection.
    fisheye = SMALL.replace("focal_px: 320", "focal_px: 82, distortion_model: fisheye, distortion: [0, 0, 0, 0]")
    assert lines_of(tmp_path, fisheye) == []
    assert "160 degrees" in lines_of(tmp_path, fisheye.replace("focal_px: 82", "focal_px: 71.6"))[0]


def test_field_of_view_of_a_known_lens() -> None:
    # 35-mm film (43.27 mm across) behind a lens of 26 mm: 79.52 degrees.
    assert angle_of_view_deg(26.0, 43.2666) == pytest.approx(79.52, abs=0.01)
    assert angle_of_view_deg(1.0, 3.14159265, fisheye=True) == pytest.approx(180.0, abs=1e-6)
