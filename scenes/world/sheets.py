"""From a marker's section to the printed sheet: one function for each kind.

Each kind gives its shapes in the order they are painted, its parts (part 0 at the origin), and its finest detail, which
bounds how soft its edges may be.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from roundel.scenes.markers.circle_grid import circle_grid_centres_m
from roundel.scenes.markers.dot_codes import dots_of
from roundel.scenes.markers.marker import Bar, Cells, Checker, Clutter, Disc, Part, Sectors, Shape, Sheet
from roundel.scenes.markers.ring_codes import ring_code_radii
from roundel.scenes.markers.stag_codes import CIRCLE, DOT, DOTS_WITHIN, stag_dots
from roundel.scenes.markers.surfaces import Curve
from roundel.scenes.markers.tags import charuco_grid, tag_grid
from roundel.scenes.study import marker_section as sections

# The orientation tick, in radii.
TICK_FROM, TICK_TO, TICK_WIDTH = 0.5, 0.9, 0.12

# A wave of paper steeper than this is a fold; more waves than these from the centre would need more nodes.
STEEPEST_WAVE_RAD = 1.2
WAVES_FROM_CENTRE = 2.0

# Below this, cell indices would not fit the integers that are hashed.
MIN_GRAIN_M, MIN_CLUTTER_M = 1e-6, 1e-4


@dataclass(frozen=True)
class _Print:
    shapes: Sequence[Shape]
    parts: Sequence[Part]
    finest_m: float


def _disc(section: sections.DiscSection, ink: float, paper: float) -> _Print:
    radius = section.diameter_m / 2
    return _Print([Disc(0.0, 0.0, radius, ink)], [Part(0, "disc", 0.0, 0.0, radius)], 2 * radius)


def _disc_with_tick(section: sections.DiscWithTickSection, ink: float, paper: float) -> _Print:
    r = section.diameter_m / 2
    length, width = (TICK_TO - TICK_FROM) * r, TICK_WIDTH * r
    tick = Bar((TICK_FROM + TICK_TO) / 2 * r, 0.0, length, width, 0.0, paper)
    layout = {"tick_from_m": TICK_FROM * r, "tick_to_m": TICK_TO * r, "tick_width_m": width}
    return _Print([Disc(0.0, 0.0, r, ink), tick], [Part(0, "disc", 0.0, 0.0, r, layout)], (1 - TICK_TO) * r)


def _circles(diameters_m: Sequence[float], kind: str, layout: dict[str, Any], ink: float, paper: float) -> _Print:
    shapes = [Disc(0.0, 0.0, d / 2, paper if i % 2 else ink) for i, d in enumerate(diameters_m)]
    finest = min((a - b) / 2 for a, b in pairwise([*diameters_m, -diameters_m[-1]]))
    return _Print(shapes, [Part(0, kind, 0.0, 0.0, diameters_m[0] / 2, layout)], finest)


def _ring(section: sections.RingSection, ink: float, paper: float) -> _Print:
    if section.inner_diameter_m >= section.diameter_m:
        raise ValueError("marker.inner_diameter_m: must be smaller than diameter_m")
    both = [section.diameter_m, section.inner_diameter_m]
    return _circles(both, "ring", {"inner_diameter_m": section.inner_diameter_m}, ink, paper)


def _rings(section: sections.RingsSection, ink: float, paper: float) -> _Print:
    diameters = [float(d) for d in section.diameters_m]
    for a, b in pairwise(diameters):
        if b >= a:
            raise ValueError(f"marker.diameters_m: {b:g} after {a:g}; list the diameters in decreasing order")
    return _circles(diameters, "rings", {"diameters_m": diameters}, ink, paper)


def _coded_rings(section: sections.CodedRingsSection, ink: float, paper: float) -> _Print:
    hole = float(section.hole)
    shares = [float(v) for v in (section.disc, section.code_from, section.code_to, section.ring_from, 1.0)]
    # The bands of ringgrid touch its rings.
    if not (hole < shares[0] and 0 < shares[0] <= shares[1] < shares[2] <= shares[3] < 1):
        raise ValueError("marker.disc: needs hole < disc <= code_from < code_to <= ring_from < 1")
    if len({len(ring) for ring in section.code}) != 1:
        raise ValueError("marker.code: every ring needs the same number of cells")
    outer = section.diameter_m / 2
    disc, inner, last, ring, _ = (outer * share for share in shares)
    cells = bytes(int(bit) for row in section.code for bit in row)
    sectors = len(section.code[0])
    code = Sectors(0.0, 0.0, inner, last, len(section.code), sectors, cells, ink)
    shapes: list[Shape] = [Disc(0.0, 0.0, outer, ink), Disc(0.0, 0.0, ring, paper), code, Disc(0.0, 0.0, disc, ink)]
    layout: dict[str, Any] = dict(zip(("disc", "code_from", "code_to", "ring_from"), shares[:-1], strict=True))
    layout["code"] = list(section.code)
    if section.id is not None:
        layout["id"] = int(section.id)
    widths = [disc - outer * hole, outer - ring, inner - disc, ring - last, code.ring_m, 2 * np.pi * inner / sectors]
    if hole > 0:
        shapes.append(Disc(0.0, 0.0, outer * hole, paper))
        layout["hole"] = hole
        widths.append(2 * outer * hole)
    finest = min(width for width in widths if width > 1e-12 * outer)
    return _Print(shapes, [Part(0, "coded_rings", 0.0, 0.0, outer, layout)], float(finest))


def _ring_code(section: sections.RingCodeSection, ink: float, paper: float) -> _Print:
    try:
        radii = ring_code_radii(int(section.id))
    except ValueError as error:
        raise ValueError(f"marker.id: {error}") from error
    layout = {"id": int(section.id), "radii": list(radii)}
    return _circles([section.diameter_m * share for share in radii], "ring_code", layout, ink, paper)


def _dot_code(section: sections.DotCodeSection, ink: float, paper: float) -> _Print:
    try:
        dots = section.diameter_m / 2 * dots_of(int(section.id))
    except ValueError as error:
        raise ValueError(f"marker.id: {error}") from error
    shapes = [Disc(float(x), float(y), float(r), ink) for x, y, r in dots]
    x, y, r = dots.T
    gaps = np.hypot(x[:, None] - x, y[:, None] - y) - r[:, None] - r + np.diag(np.full(len(dots), np.inf))
    part = Part(0, "dot_code", 0.0, 0.0, section.diameter_m / 2, {"id": int(section.id)}, inked=False)
    return _Print(shapes, [part], float(min(2 * r.min(), gaps.min())))


def _apart(key: str, gap_m: float) -> float:
    """Softness that the gap between two neighbours allows; touching ones are refused: their contours would merge."""
    if gap_m <= 0:
        raise ValueError(f"marker.{key}: neighbours touch or overlap; move them apart or make them smaller")
    return gap_m


def _two_discs(section: sections.TwoDiscsSection, ink: float, paper: float) -> _Print:
    first, second, x = section.diameter_m / 2, section.second_diameter_m / 2, section.spacing_m
    finest = min(2 * first, 2 * second, _apart("spacing_m", x - first - second))
    parts = [Part(0, "disc", 0.0, 0.0, first), Part(1, "disc", x, 0.0, second)]
    return _Print([Disc(0.0, 0.0, first, ink), Disc(x, 0.0, second, ink)], parts, finest)


def _dot_ring(section: sections.DotRingSection, ink: float, paper: float) -> _Print:
    dot, ring, count = section.diameter_m / 2, section.ring_diameter_m / 2, section.dots
    finest = min(2 * dot, _apart("ring_diameter_m", 2 * ring * np.sin(np.pi / count) - 2 * dot))
    turn = np.radians(section.turn_deg)
    angle = turn + 2 * np.pi * np.arange(count) / count
    # The first dot is at the origin, because part 0 has the pose of record.
    xs, ys = ring * (np.cos(angle) - np.cos(turn)), ring * (np.sin(angle) - np.sin(turn))
    layout = {"dots": count, "ring_diameter_m": section.ring_diameter_m, "turn_deg": section.turn_deg}
    places = [(float(x), float(y)) for x, y in zip(xs, ys, strict=True)]
    parts = [Part(i, "disc", x, y, dot, layout) for i, (x, y) in enumerate(places)]
    return _Print([Disc(x, y, dot, ink) for x, y in places], parts, finest)


def _circle_grid(section: sections.CircleGridSection, ink: float, paper: float) -> _Print:
    step, radius, asymmetric = float(section.spacing_m), section.diameter_m / 2, section.layout == "asymmetric"
    # Dots of a row are two steps apart in an asymmetric grid: its nearest neighbours are diagonal.
    finest = min(2 * radius, _apart("spacing_m", step * (np.sqrt(2) if asymmetric else 1) - 2 * radius))
    centres = circle_grid_centres_m(section.columns, section.rows, step, asymmetric)
    layout: dict[str, Any] = {"columns": section.columns, "rows": section.rows, "spacing_m": step}
    layout |= {"diameter_m": section.diameter_m, "layout": section.layout}
    width, height = np.ptp(centres, axis=0) + 2 * radius
    part = Part(0, "circle_grid", 0.0, 0.0, None, layout, (float(width), float(height)))
    return _Print([Disc(x, y, radius, ink) for x, y in centres.tolist()], [part], float(finest))


def _board(keys: Any, marker_id: int, x: float, ink: float) -> tuple[Checker, Part]:
    square = float(keys.square_m)
    layout = {"columns": keys.columns, "rows": keys.rows, "square_m": square}
    size = ((keys.columns + 1) * square, (keys.rows + 1) * square)
    return (
        Checker(x, 0.0, square, keys.columns, keys.rows, ink),
        Part(marker_id, "chessboard", x, 0.0, None, layout, size),
    )


def _chessboard(section: sections.ChessboardSection, ink: float, paper: float) -> _Print:
    _refuse_inverted(section, "a chessboard")
    shape, part = _board(section, 0, 0.0, ink)
    return _Print([shape], [part], shape.square_m)


def _disc_with_chessboard(section: sections.DiscWithChessboardSection, ink: float, paper: float) -> _Print:
    _refuse_inverted(section, "a chessboard")
    radius, keys = section.diameter_m / 2, section.chessboard
    shape, part = _board(keys, 1, radius + section.gap_m + (keys.columns + 1) * keys.square_m / 2, ink)
    disc = Disc(0.0, 0.0, radius, ink)
    return _Print(
        [disc, shape], [Part(0, "disc", 0.0, 0.0, radius), part], min(2 * radius, shape.square_m, section.gap_m)
    )


def _refuse_inverted(section: Any, what: str) -> None:
    # Only the colour of its first square determines a board's orientation. A grid of tags has its bits for that, and
    # detectors support light tags on dark: those may be inverted.
    if section.inverted:
        raise ValueError(f"marker.inverted: {what} cannot be inverted; only circles and tags can")


def _tag_layout(section: Any, **sizes: float) -> dict[str, Any]:
    counts = {"columns": section.columns, "rows": section.rows}
    return {**counts, **sizes, "family": section.family, "first_id": section.first_id}


def _charuco_board(keys: Any, marker_id: int, x: float, ink: float) -> tuple[list[Shape], Part, float]:
    """Shapes of a ChArUco board, its part, and its finest detail."""
    columns, rows, square, tag = keys.columns, keys.rows, float(keys.square_m), float(keys.tag_m)
    if tag >= square:
        raise ValueError("marker.tag_m: a tag must be smaller than its square")
    grid = charuco_grid(keys.family, keys.first_id, columns, rows)
    cells = Cells(x, 0.0, columns, rows, square, tag, grid.shape[2], grid.tobytes(), ink)
    size = columns * square, rows * square
    part = Part(marker_id, "charuco", x, 0.0, None, _tag_layout(keys, square_m=square, tag_m=tag), size)
    checker = Checker(x, 0.0, square, columns - 1, rows - 1, ink)
    return [checker, cells], part, min(cells.cell_m, (square - tag) / 2)


def _charuco(section: sections.CharucoSection, ink: float, paper: float) -> _Print:
    _refuse_inverted(section, "a ChArUco board")
    shapes, part, finest = _charuco_board(section, 0, 0.0, ink)
    return _Print(shapes, [part], finest)


def _disc_with_charuco(section: sections.DiscWithCharucoSection, ink: float, paper: float) -> _Print:
    _refuse_inverted(section, "a ChArUco board")
    radius, keys = section.diameter_m / 2, section.charuco
    shapes, part, finest = _charuco_board(keys, 1, radius + section.gap_m + keys.columns * keys.square_m / 2, ink)
    disc = Disc(0.0, 0.0, radius, ink)
    return _Print([disc, *shapes], [Part(0, "disc", 0.0, 0.0, radius), part], min(2 * radius, finest, section.gap_m))


def _tags(section: sections.TagBoardSection, ink: float, paper: float) -> _Print:
    columns, rows, tag, gap = section.columns, section.rows, float(section.tag_m), float(section.gap_m)
    grid = tag_grid(section.family, section.first_id, columns, rows)
    cells = Cells(0.0, 0.0, columns, rows, tag + gap, tag, grid.shape[2], grid.tobytes(), ink)
    part = Part(0, "tags", 0.0, 0.0, None, _tag_layout(section, tag_m=tag, gap_m=gap), cells.span_m())
    return _Print([cells], [part], min(cells.cell_m, gap) if gap > 0 else cells.cell_m)


def _stag(section: sections.StagSection, ink: float, paper: float) -> _Print:
    side = float(section.tag_m)
    try:
        dots = side * stag_dots(int(section.id))
    except ValueError as error:
        raise ValueError(f"marker.id: {error}") from error
    shapes: list[Shape] = [Bar(0.0, 0.0, side, side, 0.0, ink), Disc(0.0, 0.0, side * CIRCLE, paper)]
    shapes += [Disc(float(x), float(y), side * DOT, ink) for x, y in dots]
    part = Part(0, "stag", 0.0, 0.0, None, {"tag_m": side, "id": int(section.id)}, (side, side))
    return _Print(shapes, [part], side * (CIRCLE - DOTS_WITHIN))


_KINDS: dict[str, Callable[[Any, float, float], _Print]] = {
    "disc": _disc,
    "disc_with_tick": _disc_with_tick,
    "ring": _ring,
    "rings": _rings,
    "coded_rings": _coded_rings,
    "ring_code": _ring_code,
    "dot_code": _dot_code,
    "two_discs": _two_discs,
    "dot_ring": _dot_ring,
    "circle_grid": _circle_grid,
    "chessboard": _chessboard,
    "disc_with_chessboard": _disc_with_chessboard,
    "charuco": _charuco,
    "disc_with_charuco": _disc_with_charuco,
    "tags": _tags,
    "stag": _stag,
}


def sheet_of(section: sections.Marker, seed: int = 0) -> Sheet:
    """The sheet described by a marker's section.

    Parameters
    ----------
    section : Marker
        With all values drawn.
    seed : int
        Seed of grain and clutter, 0 to 2^32 - 1.

    Raises
    ------
    ValueError
        If the marker cannot be printed: overlapping circles, too few tags in a family, edges softer than its details.
    """
    ink, paper = (section.paper, section.ink) if section.inverted else (section.ink, section.paper)
    made = _KINDS[section.kind](section, ink, paper)
    if section.edge_softness_m > made.finest_m:
        raise ValueError(
            f"marker.edge_softness_m: {section.edge_softness_m:g} m is wider than the finest detail of the print, "
            f"{made.finest_m:.3g} m; make the edges sharper or the marker larger"
        )
    if section.grain_m < MIN_GRAIN_M:
        raise ValueError(f"marker.grain_m: {section.grain_m:g} m is too fine; give {MIN_GRAIN_M:g} or more")
    clutter = section.clutter
    if clutter is not None and clutter.cell_m < MIN_CLUTTER_M:
        raise ValueError(f"marker.clutter.cell_m: {clutter.cell_m:g} m is too fine; give {MIN_CLUTTER_M:g} or more")
    boxes = [(p.x_m, p.y_m, *p.half_size_m()) for p in made.parts]
    low = (min(x - w for x, _, w, _ in boxes), min(y - h for _, y, _, h in boxes))
    high = (max(x + w for x, _, w, _ in boxes), max(y + h for _, y, _, h in boxes))
    margin = section.margin_m if section.margin_m is not None else min(high[0] - low[0], high[1] - low[1]) / 3
    sheet = Sheet(
        (low[0] - margin, low[1] - margin),
        (high[0] + margin, high[1] + margin),
        paper,
        section.wall,
        tuple(made.shapes),
        tuple(made.parts),
        edge_softness_m=section.edge_softness_m,
        grain=section.grain,
        grain_m=section.grain_m,
        clutter=None if clutter is None else Clutter(clutter.cell_m, clutter.contrast),
        seed=seed,
    )
    return replace(sheet, curve=_curve_of(section.surface, sheet))


def _curve_of(surface: sections.SurfaceSection, sheet: Sheet) -> Curve | None:
    """How the sheet's paper is bent.

    Raises
    ------
    ValueError
        If the paper would meet itself, or a wave would stand nearly upright.
    """
    if surface.shape == "flat":
        return None
    assert surface.radius_m is not None
    curve = Curve(surface.shape, surface.radius_m, surface.axis_deg, surface.wave_m or np.inf)
    (x0, y0), (x1, y1) = sheet.low_m, sheet.high_m
    across = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]) @ curve.axes()[0]
    half_m = float(np.abs(across).max())
    if surface.shape == "cylinder":
        if half_m > np.pi * curve.radius_m:
            raise ValueError(
                f"marker.surface.radius_m: a cylinder of {curve.radius_m:g} m is too small for a sheet of "
                f"{np.ptp(across):.3g} m around it; give {half_m / np.pi:.3g} or more, or a narrower margin_m"
            )
        return curve
    steepest = curve.wave_m / (2 * np.pi * curve.radius_m)
    if steepest > STEEPEST_WAVE_RAD:
        raise ValueError(
            f"marker.surface.wave_m: waves of {curve.wave_m:g} m with a radius of {curve.radius_m:g} m rise by "
            f"{np.degrees(steepest):.0f} degrees; give a larger radius or shorter waves, for at most "
            f"{np.degrees(STEEPEST_WAVE_RAD):.0f}"
        )
    if half_m > WAVES_FROM_CENTRE * curve.wave_m:
        raise ValueError(
            f"marker.surface.wave_m: {curve.wave_m:g} m is too short for a sheet of {np.ptp(across):.3g} m; give "
            f"{half_m / WAVES_FROM_CENTRE:.3g} or more"
        )
    return curve
