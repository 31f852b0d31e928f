"""Sheets: what each kind prints, its edges, and its reflectance."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from helpers_markers import MARKERS, sheet
from hypothesis import given
from hypothesis import strategies as st

from roundel.scenes.markers.ink_pattern import coverage, reflectance_at
from roundel.scenes.markers.marker import Bar, Cells, Checker, Disc, Sheet, is_smooth
from roundel.scenes.markers.outlines import edge_reach_m, outlines
from roundel.scenes.markers.value_noise import GRAIN_AMPLITUDE, clutter_at, grain_at
from roundel.scenes.study.marker_section import KINDS

INK, PAPER, WALL = 0.05, 0.80, 0.35


def at(made: Sheet, *points: tuple[float, float]) -> list[float]:
    x, y = np.array(points).T
    return reflectance_at(made, x, y).tolist()


def test_every_kind_is_printed_with_part_0_at_the_origin() -> None:
    assert set(MARKERS) == set(KINDS)
    for kind in KINDS:
        made = sheet(kind)
        # The pose that a study asks for is the sheet's, and that of record is part 0's: they are one.
        assert (made.parts[0].x_m, made.parts[0].y_m) == (0.0, 0.0)
        assert [part.marker_id for part in made.parts] == list(range(len(made.parts)))
        for part in made.parts:
            w, h = part.half_size_m()
            assert made.low_m[0] <= part.x_m - w < part.x_m + w <= made.high_m[0]
            assert made.low_m[1] <= part.y_m - h < part.y_m + h <= made.high_m[1]
        assert at(made, (9.0, 9.0)) == [WALL]
        assert is_smooth(made)
        assert edge_reach_m(made) == 0


def test_the_tick_is_paper_along_x() -> None:
    made = sheet("disc_with_tick")
    assert made.parts[0].layout == {"tick_from_m": 0.02, "tick_to_m": 0.9 * 0.04, "tick_width_m": 0.12 * 0.04}
    inside = [(0.0201, 0.0), (0.0359, 0.0), (0.028, 0.0023), (0.028, -0.0023)]
    outside = [(0.0199, 0.0), (0.0361, 0.0), (0.028, 0.0025), (0.028, -0.0025), (-0.028, 0.0), (0.0, 0.028), (0.0, 0.0)]
    assert at(made, *inside) == [PAPER] * 4
    assert at(made, *outside) == [INK] * 7


def test_rings_are_ink_and_paper_by_turns() -> None:
    made = sheet("rings")
    assert made.parts[0].radius_m == 0.04
    assert at(made, (0.041, 0), (0, 0.035), (-0.028, 0), (0, -0.02), (0.009, 0)) == [PAPER, INK, PAPER, INK, PAPER]
    dark = sheet("rings", inverted=True)
    assert at(dark, (0.041, 0), (0, 0.035), (-0.028, 0), (0, -0.02), (0.009, 0)) == [INK, PAPER, INK, PAPER, INK]


def test_dots_stand_evenly_on_their_circle() -> None:
    made = sheet("dot_ring")
    assert len(made.parts) == 7
    assert {part.kind for part in made.parts} == {"disc"}
    places = np.array([[part.x_m, part.y_m] for part in made.parts])
    centre = places.mean(axis=0)
    np.testing.assert_allclose(np.linalg.norm(places - centre, axis=1), 0.05, rtol=1e-12)
    first, second = (np.degrees(np.arctan2(*(p - centre)[::-1])) for p in places[:2])
    assert first == pytest.approx(30)
    assert second == pytest.approx(30 + 360 / 7)
    assert at(made, *map(tuple, places)) == [INK] * 7
    assert at(made, tuple(centre)) == [PAPER]


REFUSED = [
    ("ring", {"inner_diameter_m": 0.08}, "inner_diameter_m: must be smaller"),
    ("rings", {"diameters_m": [0.08, 0.03, 0.05]}, "diameters_m: 0.05 after 0.03"),
    ("two_discs", {"spacing_m": 0.06}, "spacing_m: neighbours touch"),
    ("dot_ring", {"dots": 16}, "ring_diameter_m: neighbours touch"),
    ("coded_rings", {"disc": 0.4}, "disc: needs hole < disc <= code_from"),
    ("coded_rings", {"code": ["1010", "10101"]}, "code: every ring needs the same number of cells"),
    ("chessboard", {"inverted": True}, "a chessboard cannot be inverted"),
    ("charuco", {"inverted": True}, "a ChArUco board cannot be inverted"),
    ("charuco", {"tag_m": 0.03}, "tag_m: a tag must be smaller"),
    ("charuco", {"first_id": 41}, "10 tags from id 41 need ids up to 50, but aruco_4x4_50 ends at 49"),
    ("tags", {"first_id": 582}, "6 tags from id 582 need ids up to 587, but apriltag_36h11 ends at 586"),
    (
        "tags",
        {"edge_softness_m": 0.006},
        "edge_softness_m: 0.006 m is wider than the finest detail of the print, 0.005",
    ),
    ("coded_rings", {"hole": 0.3}, "disc: needs hole < disc"),
    ("stag", {"id": 12}, "id 12 is not in STag's library HD21; use 0 to 11"),
    ("disc", {"edge_softness_m": 0.1}, "wider than the finest detail"),
    ("disc", {"grain_m": 1e-9}, "grain_m: 1e-09 m is too fine"),
    ("disc", {"clutter": {"cell_m": 1e-9}}, "clutter.cell_m: 1e-09 m is too fine"),
]


@pytest.mark.parametrize(("kind", "keys", "words"), REFUSED, ids=[f"{r[0]}-{next(iter(r[1]))}" for r in REFUSED])
def test_what_cannot_be_printed_is_refused_in_one_line(kind: str, keys: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words) as caught:
        sheet(kind, **keys)
    assert str(caught.value).startswith("marker.")
    assert "\n" not in str(caught.value)


def test_a_code_is_read_clockwise_from_x() -> None:
    # 8 cells a ring from 0.30 to 0.78 of the radius; ring 0 is 11010010, ring 2 is 10011100.
    made = sheet("coded_rings")

    def cell(ring: int, sector: int) -> tuple[float, float]:
        radius, angle = 0.04 * (0.30 + (ring + 0.5) * 0.16), -np.radians(45 * (sector + 0.5))
        return float(radius * np.cos(angle)), float(radius * np.sin(angle))

    for ring, code in enumerate(("11010010", "01101001", "10011100")):
        seen = at(made, *(cell(ring, sector) for sector in range(8)))
        assert seen == [INK if bit == "1" else PAPER for bit in code]
    assert at(made, (0.0, 0.0), (0.0, 0.0104), (0.0, 0.0328), (0.0, 0.036)) == [INK, PAPER, PAPER, INK]


def stretches(lines: list[np.ndarray]) -> list[tuple[np.ndarray, np.ndarray]]:
    return [(a, b) for line in lines for a, b in pairwise(line)]


@pytest.mark.parametrize("kind", KINDS)
def test_outlines_are_where_the_reflectance_jumps_and_nowhere_else(kind: str) -> None:
    made = sheet(kind)
    lines = outlines(made)
    a, b = map(np.array, zip(*stretches(lines), strict=True))
    # Points at random: the segment from one to its neighbour changes level only if it crosses an outline.
    rng = np.random.default_rng(5)
    low, high = np.array(made.low_m), np.array(made.high_m)
    p = low + (high - low) * rng.uniform(-0.1, 1.1, (20_000, 2))
    q = p + rng.uniform(-1, 1, p.shape) * 0.002
    jumps = reflectance_at(made, *p.T) != reflectance_at(made, *q.T)
    assert jumps.sum() > 50

    def distance(x: np.ndarray) -> np.ndarray:
        along = b - a
        t = np.clip(np.sum((x[:, None] - a) * along, axis=-1) / np.sum(along**2, axis=-1), 0, 1)
        return np.linalg.norm(x[:, None] - (a + t[..., None] * along), axis=-1).min(axis=1)

    step = np.linalg.norm(q - p, axis=1)[jumps]
    # The chords of a circle leave it by 8e-5 of its radius, 3e-6 m here.
    assert np.all(distance(p[jumps]) <= step + 4e-6)
    if kind in ("charuco", "tags"):
        # The tags' lines: each is an edge along all of its length, and none is there twice.
        cells = outlines(Sheet((-1, -1), (1, 1), PAPER, WALL, made.shapes[-1:], made.parts))[1:]
        for start, end in stretches(cells):
            across = np.array([start[1] - end[1], end[0] - start[0]]) / np.linalg.norm(end - start) * 1e-6
            for t in np.linspace(0.001, 0.999, 40):
                x = start + t * (end - start)
                both = coverage(made.shapes[-1], *np.stack([x + across, x - across], axis=-1))
                assert both[0] != both[1]
        keys = {tuple(sorted(map(tuple, np.round(line, 9).tolist()))) for line in cells}
        assert len(keys) == len(cells)


SHAPES = [
    Disc(0.01, -0.02, 0.03, INK),
    Bar(0.01, 0.0, 0.05, 0.02, 30.0, INK),
    Checker(0.0, 0.01, 0.01, 4, 3, INK),
    Cells(0.0, 0.0, 2, 2, 0.05, 0.04, 4, bytes([1, 0, 1, 1] * 16), INK),
    Cells(0.0, 0.0, 2, 2, 0.04, 0.04, 4, bytes([1, 1, 0, 1] * 16), INK),  # tags that touch
]


@pytest.mark.parametrize("shape", SHAPES, ids=lambda s: type(s).__name__)
def test_soft_edges_are_linear_ramps_centred_on_the_sharp_ones(shape: Any) -> None:
    rng = np.random.default_rng(2)
    x, y = rng.uniform(-0.06, 0.06, (2, 2000))
    w = 0.004
    soft = coverage(shape, x, y, w)
    assert soft.min() >= 0
    assert soft.max() <= 1 + 1e-12
    if isinstance(shape, Disc):
        inside = shape.radius_m - np.hypot(x - shape.x_m, y - shape.y_m)
        np.testing.assert_allclose(soft, np.clip(0.5 + inside / w, 0, 1), atol=1e-12)
        return
    # The sharp pattern averaged over a square of side w, by 40 x 40 points of it: each edge is off by half a step.
    t = np.radians(shape.turn_deg) if isinstance(shape, Bar) else 0.0
    steps = ((np.arange(40) + 0.5) / 40 - 0.5) * w
    mean = np.zeros_like(soft)
    for a in steps:
        for b in steps:
            mean += coverage(shape, x + a * np.cos(t) - b * np.sin(t), y + a * np.sin(t) + b * np.cos(t)) / 1600
    assert np.abs(soft - mean).max() < 0.03


def test_softness_stops_at_the_border_of_the_sheet() -> None:
    made = sheet("disc", margin_m=0.0, edge_softness_m=0.01)
    assert edge_reach_m(made) == 0.005
    beside, at_edge = at(made, (0.0400001, 0.0), (0.0399999, 0.0))
    assert beside == WALL
    assert at_edge == pytest.approx((INK + PAPER) / 2, abs=1e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_nowhere_and_beyond_all_numbers_are_wall_or_clutter(kind: str) -> None:
    for keys in ({}, {"edge_softness_m": 0.001, "grain": 0.1, "clutter": {"cell_m": 0.02}}):
        value = reflectance_at(
            sheet(kind, **keys), np.array([np.nan, np.inf, -1e30, 1e5]), np.array([0.0, 1.0, -1e30, 0])
        )
        assert np.all((value >= 0) & (value <= 1))
        assert np.shape(reflectance_at(sheet(kind, **keys), 0.0, 0.0)) == ()


def test_grain_has_the_rms_that_was_asked_for() -> None:
    x, y = np.random.default_rng(0).uniform(-0.5, 0.5, (2, 400_000))
    noise = grain_at(x, y, 0.001, 12345)
    # 10^6 independent lattice values among 4 * 10^5 points: the RMS scatters by 0.1 %.
    assert noise.mean() == pytest.approx(0, abs=0.01)
    assert noise.std() == pytest.approx(1, abs=0.01)
    assert np.abs(noise).max() <= GRAIN_AMPLITUDE
    # No structure from one cell to the next but one, and another seed is another paper.
    assert abs(np.mean(noise * grain_at(x + 0.002, y, 0.001, 12345))) < 0.01
    assert abs(np.mean(noise * grain_at(x, y, 0.001, 12346))) < 0.01
    made = sheet("disc", grain=0.05)
    paper, ink = (reflectance_at(made, *p) for p in ((0.05 + x / 100, y / 10), (x / 50, y / 50)))
    assert paper.std() / PAPER == pytest.approx(0.05, rel=0.05)  # some 4,000 grains
    assert ink.std() / INK == pytest.approx(0.05, rel=0.1)  # 1,600
    assert not is_smooth(sheet("disc", grain=0.05))
    extreme = reflectance_at(sheet("disc", grain=1.0), x / 10, y / 10)
    assert (extreme.min(), extreme.max()) == (0.0, 1.0)


@given(st.integers(0, 2**32 - 1), st.floats(-1e3, 1e3), st.floats(-1e3, 1e3))
def test_grain_is_continuous_and_negative_places_are_places_too(seed: int, x: float, y: float) -> None:
    edge = np.floor([x, y])
    # A step of 1e-7 cells across a lattice line changes what is smooth by less than 1e-6.
    around = edge[:, None] + np.array([[-1e-7, 1e-7, 1e-7, -1e-7], [-1e-7, -1e-7, 1e-7, 1e-7]])
    assert np.ptp(grain_at(*around, 1.0, seed)) < 1e-6


def test_clutter_is_one_thing_a_cell_and_wholly_within_it() -> None:
    made = sheet("disc", seed=9, clutter={"cell_m": 0.1, "contrast": 0.3})
    assert not is_smooth(made)
    x, y = np.meshgrid(np.arange(-40, 40, 0.1) + 0.05, np.arange(-40, 40, 0.1) + 0.05)
    inside, level = clutter_at(x, y, 1.0, 9)
    # Things keep off the lines between cells by nothing but chance; they never cross them.
    on_line = np.stack([np.arange(-40, 40, 0.01), np.zeros(8000)])
    assert not clutter_at(*on_line, 1.0, 9)[0].any()
    blocks = lambda a: a.reshape(80, 10, 80, 10).swapaxes(1, 2).reshape(6400, 100)  # noqa: E731
    assert blocks(inside).any(axis=1).all()
    assert np.all(np.ptp(blocks(level), axis=1) == 0)
    assert level[::10, ::10].mean() == pytest.approx(0, abs=0.03)  # 6,400 uniform levels: 0.58 / 80
    value = reflectance_at(made, x, y)
    assert value[np.hypot(x, y) > 1].min() >= WALL - 0.3
    assert value[np.hypot(x, y) > 1].max() <= WALL + 0.3
    assert np.any(value != reflectance_at(sheet("disc", seed=10, clutter={"cell_m": 0.1}), x, y))
    # On the sheet there is none.
    assert at(made, (0.0, 0.0), (0.05, 0.05)) == [INK, PAPER]
