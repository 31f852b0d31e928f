"""Printed markers: the vectors of the page match the rendered sheet to a hundredth of a millimetre."""

from __future__ import annotations

import re
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.path import Path as Outline

from roundel.render.printing.board_file import calibrate_lines, described_marker
from roundel.render.printing.marker_layouts import marker_to_print, parse_set
from roundel.render.printing.print_page import PAPERS_MM, Page, _title, lay_out, print_marker
from roundel.scenes.errors import DataError, UsageError
from roundel.scenes.markers.ink_pattern import reflectance_at
from roundel.scenes.markers.outlines import outlines
from roundel.scenes.study.marker_section import KINDS

POINT_MM = 25.4 / 72.0
SMALL = {"dot_ring": 0.03, "disc_with_chessboard": 0.05, "disc_with_charuco": 0.05}


def section_of(kind: str, **keys):
    diameter = None if kind in ("chessboard", "circle_grid", "charuco", "tags", "stag") else SMALL.get(kind, 0.08)
    return marker_to_print(kind, diameter, keys)


def content_of(pdf: bytes) -> str:
    """The page's drawing operators."""
    for start in re.finditer(rb"stream\r?\n(?=x)", pdf):
        stream = zlib.decompressobj().decompress(pdf[start.end() :])
        if b" m\n" in stream:
            return stream.decode("latin-1")
    raise AssertionError("no drawing")


def paths_of(pdf: bytes) -> list[tuple[str, Outline, float]]:
    """Operator, path in millimetres from the page's lower left corner, and grey, in the order of painting."""
    out, fill, vertices, codes, stack, operands = [], 0.0, [], [], [], []
    for word in content_of(pdf).split():
        if re.fullmatch(r"-?[\d.]+", word):
            operands.append(float(word))
            continue
        if word == "q":
            stack.append(fill)
        elif word == "Q":
            fill = stack.pop()
        elif word in ("g", "rg"):
            fill = operands[-1]
        elif word in ("m", "l"):
            vertices.append(operands[-2:])
            codes.append(Outline.MOVETO if word == "m" else Outline.LINETO)
        elif word == "c":
            vertices += np.reshape(operands[-6:], (3, 2)).tolist()
            codes += [Outline.CURVE4] * 3
        elif word == "h":
            vertices.append(vertices[-1])
            codes.append(Outline.CLOSEPOLY)
        elif word in ("f", "S", "n"):
            if vertices and word != "n":
                out.append((word, Outline(np.array(vertices) * POINT_MM, codes), fill))
            vertices, codes = [], []
        operands = []
    return out


def fills_of(pdf: bytes) -> list[tuple[Outline, float]]:
    return [(path, fill) for operator, path, fill in paths_of(pdf) if operator == "f"]


def printed_grey(pdf: bytes, points_mm) -> np.ndarray:
    """What is printed at points: the last path that covers them, on white paper."""
    grey = np.ones(len(points_mm))
    for path, value in fills_of(pdf):
        inside = np.zeros(len(points_mm), dtype=bool)
        for polygon in path.to_polygons():
            inside |= Outline(polygon).contains_points(points_mm)
        grey[inside] = value
    return grey


def written(tmp_path: Path, section, suffix: str = ".pdf", paper: str = "a4") -> tuple[bytes, Page]:
    path = tmp_path / f"marker{suffix}"
    page = print_marker(section, path, paper)
    return path.read_bytes(), page


def distance_to_edges(sheet, points_m):
    """Distance from points to the nearest edge of the ink, in metres."""
    nearest = np.full(len(points_m), np.inf)
    for line in outlines(sheet):
        a, b = line[:-1], line[1:]
        along = b - a
        length2 = np.maximum(np.sum(along**2, axis=1), 1e-30)
        for p0, d, l2 in zip(a, along, length2, strict=True):
            t = np.clip((points_m - p0) @ d / l2, 0, 1)
            nearest = np.minimum(nearest, np.linalg.norm(points_m - p0 - t[:, None] * d, axis=1))
    return nearest


@pytest.mark.parametrize("kind", sorted(KINDS))
@pytest.mark.parametrize("inverted", [False, True])
def test_the_print_is_what_the_renderer_renders(tmp_path, kind, inverted):
    if inverted and kind in ("chessboard", "charuco", "disc_with_chessboard", "disc_with_charuco"):
        pytest.skip("boards are dark on light")
    section = section_of(kind, **({"inverted": True} if inverted else {}))
    pdf, page = written(tmp_path, section)
    sheet = page.sheet
    rng = np.random.default_rng(8)
    points = rng.uniform(sheet.low_m, sheet.high_m, (1500, 2))
    # 0.02 mm round the edges is left to the chords of the outlines and of the curves (8e-5 of a radius).
    points = points[distance_to_edges(sheet, points) > 2e-5]
    dark = reflectance_at(sheet, *points.T) < (section.ink + section.paper) / 2
    assert 0.05 < dark.mean() < 0.95
    grey = printed_grey(pdf, 1e3 * points + page.origin_mm)
    assert np.array_equal(grey < 0.5, dark)


def test_a_disc_is_round_and_of_its_size(tmp_path):
    pdf, page = written(tmp_path, section_of("disc"))
    assert (page.width_mm, page.height_mm) == PAPERS_MM["a4"]
    ((path, grey),) = [(p, g) for p, g in fills_of(pdf) if 50 < p.get_extents().width < 200]
    assert grey == 0
    box = path.get_extents()
    # Six decimals of a point.
    assert box.width == pytest.approx(80.0, abs=1e-3)
    assert box.height == pytest.approx(80.0, abs=1e-3)
    assert ((box.x0 + box.x1) / 2, (box.y0 + box.y1) / 2) == pytest.approx(page.origin_mm, abs=1e-3)
    # Points of the curve itself, from its control points: 16 in each arc.
    vertices = path.vertices[: 1 + 3 * 32]
    t = np.linspace(0, 1, 16)[:, None]
    for a, b, c, d in zip(vertices[:-1:3], vertices[1::3], vertices[2::3], vertices[3::3], strict=True):
        curve = (1 - t) ** 3 * a + 3 * (1 - t) ** 2 * t * b + 3 * (1 - t) * t**2 * c + t**3 * d
        assert np.allclose(np.linalg.norm(curve - page.origin_mm, axis=1), 40.0, atol=1e-4)
    media = re.search(rb"/MediaBox \[ ?0 0 ([\d.]+) ([\d.]+) ?\]", pdf)
    assert [float(v) * POINT_MM for v in media.groups()] == pytest.approx(PAPERS_MM["a4"], abs=1e-3)


def strokes_of(pdf: bytes) -> np.ndarray:
    """Straight lines (n, 2, 2), millimetres."""
    lines = [path.vertices.reshape(-1, 2, 2) for operator, path, _ in paths_of(pdf) if operator == "S"]
    return np.concatenate(lines)


def test_both_rulers_are_a_hundred_millimetres(tmp_path):
    pdf, page = written(tmp_path, section_of("disc"))
    lines = strokes_of(pdf)
    lengths = np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1)
    long = lines[lengths > 50]
    assert page.upright_ruler
    assert len(long) == 2
    assert sorted(np.abs(long[:, 1] - long[:, 0]).max(axis=1)) == pytest.approx([100.0, 100.0], abs=1e-3)
    # A tick at each of its ends, and all of it where printers print.
    assert long.min() > 5.0
    start, end = long[0]
    for at in (start, end):
        assert np.any(np.linalg.norm(lines[:, 0] - at, axis=1) < 1e-3)


def test_nothing_is_drawn_on_the_sheet_but_the_marker(tmp_path):
    for kind in ("disc", "chessboard", "dot_ring"):
        pdf, page = written(tmp_path, section_of(kind))
        low = 1e3 * np.array(page.sheet.low_m) + page.origin_mm
        high = 1e3 * np.array(page.sheet.high_m) + page.origin_mm
        for line in strokes_of(pdf):
            assert not np.all((line.max(axis=0) > low) & (line.min(axis=0) < high))


@pytest.mark.parametrize("suffix", [".pdf", ".svg"])
def test_the_same_bytes_every_time(tmp_path, suffix):
    one, two = (written(tmp_path, section_of("ring"), suffix)[0] for _ in range(2))
    assert one == two
    assert b"Date" not in one.replace(b"dc:date", b"")


def test_svg_is_to_scale(tmp_path):
    svg = written(tmp_path, section_of("disc"), ".svg", "letter")[0].decode()
    width, height = re.search(r'width="([\d.]+)pt" height="([\d.]+)pt"', svg).groups()
    assert float(width) * POINT_MM == pytest.approx(215.9, abs=1e-3)
    assert float(height) * POINT_MM == pytest.approx(279.4, abs=1e-3)
    spans = []
    for path in re.findall(r'<path d="([^"]+)"', svg):
        numbers = np.array(re.findall(r"-?[\d.]+", path), dtype=float)
        if "C" in path and len(numbers) > 20 and "z" in path:
            spans.append(np.ptp(numbers[0::2]) * POINT_MM)
    assert max(spans) == pytest.approx(80.0, abs=1e-3)


def test_the_page_turns_for_a_wide_marker():
    page = lay_out(section_of("chessboard"))
    assert (page.width_mm, page.height_mm) == (297.0, 210.0)
    assert lay_out(section_of("disc")).width_mm == 210.0


def test_the_quiet_zone_is_what_there_is_room_for():
    wide = lay_out(section_of("disc")).sheet
    assert wide.low_m[0] == pytest.approx(-0.04 - 0.08 / 3)
    tight = lay_out(marker_to_print("disc", 0.15, {})).sheet
    # 190 mm of room for 150 mm: 20 mm at each side, more than a tenth of it.
    assert tight.high_m[0] == pytest.approx(0.075 + 0.020)


def test_too_large_says_what_would_fit():
    with pytest.raises(UsageError, match=r"disc needs 240 x 240 mm .* does not fit on a4; use --paper a3 or "):
        lay_out(marker_to_print("disc", 0.2, {}))
    with pytest.raises(UsageError, match=r"reduce its diameter to at most 0.158 m"):
        lay_out(marker_to_print("disc", 0.2, {}))
    assert lay_out(marker_to_print("disc", 0.158, {}))
    assert lay_out(marker_to_print("disc", 0.2, {}), "a3")
    with pytest.raises(UsageError, match=r"to at most \d+ %"):
        lay_out(section_of("chessboard", square_m=0.05))
    # An asked-for margin is not made smaller.
    with pytest.raises(UsageError, match="does not fit on a4"):
        lay_out(marker_to_print("disc", 0.15, {"margin_m": 0.05}))


@pytest.mark.parametrize(
    ("kind", "diameter", "keys", "says"),
    [
        ("disk", 0.08, {}, "did you mean disc"),
        ("chessboard", 0.08, {}, "has no diameter"),
        ("ring", 0.08, {"iner_diameter_m": 0.02}, "did you mean inner_diameter_m"),
        ("disc", 0.08, {"ink": 0.1}, "applies to rendering only"),
        ("disc", 0.08, {"diameter_m": {"uniform": [0.1, 0.2]}}, "a printed marker has a fixed size"),
        ("disc", 0.08, {"diameter_m": "big"}, "marker disc: diameter_m"),
        ("chessboard", None, {"columns": 6, "rows": 4}, "upside down"),
        ("rings", 0.08, {"diameters_m": [0.08]}, "marker rings: diameters_m"),
    ],
)
def test_wrong_keys(kind, diameter, keys, says):
    with pytest.raises(UsageError, match=says):
        marker_to_print(kind, diameter, keys)


def test_sizes_that_contradict_each_other():
    with pytest.raises(UsageError, match="must be smaller than diameter_m"):
        lay_out(section_of("ring", inner_diameter_m=0.1))


def test_keys_from_the_command_line():
    assert parse_set(["a=1.5", "b=true", "c=[1, 2]", "d=aruco_4x4_50", "e.f=3"]) == {
        "a": 1.5,
        "b": True,
        "c": [1, 2],
        "d": "aruco_4x4_50",
        "e.f": 3,
    }
    board = marker_to_print("disc_with_chessboard", 0.05, parse_set(["chessboard.square_m=0.01"]))
    assert board.chessboard.square_m == 0.01
    assert board.chessboard.columns == 4
    for text in ("a", "a=", "=1"):
        with pytest.raises(UsageError, match="give KEY=VALUE"):
            parse_set([text])


def test_other_endings(tmp_path):
    with pytest.raises(UsageError, match=r"the file name must end in \.pdf or \.svg"):
        print_marker(section_of("disc"), tmp_path / "marker.png")
    with pytest.raises(UsageError, match="use a5, a4"):
        lay_out(section_of("disc"), "a9")


@pytest.mark.parametrize(
    ("kind", "words"), [("ring_code", "id 5, diameter 80 mm"), ("dot_code", "id 5, diameter 80 mm")]
)
def test_the_page_says_which_identity_is_printed(kind, words):
    assert words in _title(marker_to_print(kind, None, {"id": 5}))


@pytest.mark.parametrize("suffix", [".pdf", ".svg"])
@pytest.mark.parametrize(
    ("kind", "keys"),
    [
        ("chessboard", {"columns": 7, "square_m": 0.0201, "rows": 4}),
        ("charuco", {"family": "aruco_5x5_100"}),
        ("circle_grid", {"layout": "asymmetric", "columns": 4, "rows": 7, "spacing_m": 0.02, "diameter_m": 0.014}),
        ("disc_with_chessboard", {"chessboard.columns": 5, "chessboard.rows": 4}),
    ],
)
def test_a_print_says_which_marker_it_is(tmp_path: Path, kind: str, keys: dict[str, Any], suffix: str) -> None:
    section = marker_to_print(kind, None, keys)
    print_marker(section, tmp_path / f"board{suffix}")
    described = described_marker(tmp_path / f"board{suffix}")
    diameter_m = described.pop("diameter_m", None) if kind.startswith("disc") else None
    assert marker_to_print(described.pop("kind"), diameter_m, described) == section


def test_the_foot_of_a_board_has_the_command_of_its_calibration() -> None:
    plain = calibrate_lines(marker_to_print("chessboard", None, {}), 90)
    assert plain == ["roundel calibrate PHOTOS CAMERA --board chessboard"]
    own = calibrate_lines(
        marker_to_print("charuco", None, {"columns": 6, "square_m": 0.03, "family": "apriltag_36h11"}), 60
    )
    assert " ".join(own).endswith("--set columns=6 --set square_m=0.03 --set family=apriltag_36h11")
    assert all(len(line) <= 60 and not line.endswith("--set") for line in own)
    assert calibrate_lines(marker_to_print("disc", None, {}), 90) == []


def test_files_that_do_not_say_which_marker_they_are(tmp_path: Path) -> None:
    (tmp_path / "other.pdf").write_bytes(b"%PDF-1.4 roundel-marker {not json)")
    with pytest.raises(DataError, match="does not say which board it is"):
        described_marker(tmp_path / "other.pdf")
    with pytest.raises(UsageError, match="no such file"):
        described_marker(tmp_path / "none.pdf")
