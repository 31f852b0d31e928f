"""Printable page: the target sheet as vectors, to scale, with rulers to check the printer."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from roundel.datasets.store.writing import write_file
from roundel.render.printing.board_file import calibrate_lines, keyword_of
from roundel.scenes.errors import UsageError
from roundel.scenes.markers.marker import Bar, Cells, Checker, Disc, Sectors, Shape, Sheet
from roundel.scenes.study.marker_section import CIRCULAR
from roundel.scenes.world.sheets import sheet_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

PAPERS_MM = {"a5": (148.0, 210.0), "a4": (210.0, 297.0), "a3": (297.0, 420.0), "letter": (215.9, 279.4)}
PAPERS_MM |= {"legal": (215.9, 355.6), "tabloid": (279.4, 431.8)}
FORMATS = (".pdf", ".svg")

RULER_MM = 100.0
_EDGE_MM = 10.0  # few printers reach the last 5 mm of a page; the cut marks may lie between
_FOOT_MM = 46.0
_MIN_QUIET = 0.1  # of the print's smaller side: a dark marker needs paper around it to have an outer edge
_THIN_PT, _MARK_PT = 0.35, 0.5
_FOOT_LINES, _SMALL_CHARACTER_MM = 4, 1.6  # lines of lettering; the width of its smallest, monospace
_POINT_MM = 25.4 / 72.0


@dataclass(frozen=True)
class Page:
    """Layout of the page, in millimetres from its lower left corner.

    Attributes
    ----------
    width_mm, height_mm : float
    sheet : Sheet
        The printed sheet, with its quiet zone reduced to fit.
    origin_mm : (float, float)
        The sheet's origin: the centre of the marker's first part.
    upright_ruler : bool
        Whether there is room for a second ruler along the page's height.
    """

    width_mm: float
    height_mm: float
    sheet: Sheet
    origin_mm: tuple[float, float]
    upright_ruler: bool


def lay_out(section: Any, paper: str = "a4") -> Page:
    """Place a marker on a page, upright if possible, with as much of its quiet zone as fits.

    Raises
    ------
    UsageError
        If the paper is unknown, or the marker does not fit; the message says what would fit.
    """
    if paper not in PAPERS_MM:
        raise UsageError(f"--paper {paper}: unknown; use {', '.join(PAPERS_MM)}")
    try:
        full = sheet_of(section)
        bare = sheet_of(section.model_copy(update={"margin_m": 0.0}))
    except ValueError as error:
        raise UsageError(f"marker {section.kind}: {str(error).removeprefix('marker.')}") from error
    size = 1e3 * (np.array(bare.high_m) - np.array(bare.low_m))
    wanted = 1e3 * (bare.low_m[0] - full.low_m[0])
    least = wanted if section.margin_m is not None else _MIN_QUIET * float(size.min())
    for width, height in (PAPERS_MM[paper], PAPERS_MM[paper][::-1]):
        room = _room(width, height)
        if np.all(size + 2 * least <= room + 1e-9):
            quiet = min(wanted, float(np.min(room - size)) / 2)
            sheet = sheet_of(section.model_copy(update={"margin_m": quiet / 1e3}))
            low, high = 1e3 * np.array(sheet.low_m), 1e3 * np.array(sheet.high_m)
            middle = np.array([width / 2, _EDGE_MM + _FOOT_MM + room[1] / 2])
            x, y = (float(v) for v in middle - (low + high) / 2)
            upright = x + low[0] >= _EDGE_MM + 16.0 and height >= 2 * _EDGE_MM + RULER_MM + 8.0
            return Page(width, height, sheet, (x, y), bool(upright))
    raise UsageError(_too_large(section, paper, size + 2 * least))


def _room(width_mm: float, height_mm: float) -> Array:
    return np.array([width_mm - 2 * _EDGE_MM, height_mm - 2 * _EDGE_MM - _FOOT_MM])


def _too_large(section: Any, paper: str, needed_mm: Array) -> str:
    def fit(name: str) -> float:
        width, height = PAPERS_MM[name]
        return float(max(np.min(_room(*turned) / needed_mm) for turned in ((width, height), (height, width))))

    larger = [name for name in PAPERS_MM if fit(name) >= 1]
    remedy = f"use --paper {' or '.join(larger)}, or " if larger else ""
    if section.kind in CIRCULAR:
        diameter_m = section.diameters_m[0] if section.kind == "rings" else section.diameter_m
        most_mm = np.floor(1e3 * diameter_m * fit(paper))
        smaller = f"reduce its diameter to at most {most_mm / 1e3:g} m"
    else:
        smaller = f"scale it to at most {100 * fit(paper):.0f} %"
    size = f"{needed_mm[0]:.0f} x {needed_mm[1]:.0f} mm with its quiet zone"
    return f"this {section.kind} needs {size} and does not fit on {paper}; {remedy}{smaller}"


def print_marker(section: Any, path: str | Path, paper: str = "a4") -> Page:
    """Write a marker to scale as PDF or SVG; the same input gives the same bytes.

    Parameters
    ----------
    section : Marker
        See `roundel.render.printing.marker_layouts.marker_to_print`.
    path : path
        Ends in .pdf or .svg.
    paper : str
        A key of `PAPERS_MM`.

    Raises
    ------
    UsageError
        As `lay_out`; if the file name has another suffix.
    DataError
        If the file cannot be written.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if kind not in FORMATS:
        raise UsageError(f"{path}: markers are printed as vectors; the file name must end in {' or '.join(FORMATS)}")
    page = lay_out(section, paper)
    import matplotlib as mpl
    from matplotlib.figure import Figure

    # Type 3 keeps lettering as text without slow font subsetting; the salt makes SVG identifiers deterministic.
    with mpl.rc_context({"pdf.fonttype": 3, "svg.hashsalt": "roundel", "svg.fonttype": "path"}):
        figure = Figure(figsize=(page.width_mm / 25.4, page.height_mm / 25.4))
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_xlim(0.0, page.width_mm)
        axes.set_ylim(0.0, page.height_mm)
        axes.axis("off")
        _draw_sheet(axes, page, section)
        _draw_marks(axes, page)
        _draw_foot(axes, page, section)
        buffer = io.BytesIO()
        undated = {"CreationDate": None} if kind == ".pdf" else {"Date": None}
        about = {"Creator": "Roundel", "Keywords": keyword_of(section)}
        figure.savefig(buffer, format=kind[1:], metadata=undated | about)
    write_file(path, buffer.getvalue())
    return page


def _draw_sheet(axes: Axes, page: Page, section: Any) -> None:
    """The shapes in painting order: reflectances nearer to ink are black, those nearer to paper white."""
    from matplotlib.patches import Rectangle

    sheet, (x, y) = page.sheet, page.origin_mm
    middle = (section.ink + section.paper) / 2
    if section.inverted:
        low, high = 1e3 * np.array(sheet.low_m), 1e3 * np.array(sheet.high_m)
        corner = (x + float(low[0]), y + float(low[1]))
        axes.add_patch(Rectangle(corner, *(float(v) for v in high - low), facecolor="black", linewidth=0))
    for shape in sheet.shapes:
        colour = "black" if shape.reflectance < middle else "white"
        axes.add_patch(_patch(shape, x, y, colour))


def _patch(shape: Shape, x_mm: float, y_mm: float, colour: str) -> Any:
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    centre = np.array([x_mm + 1e3 * shape.x_m, y_mm + 1e3 * shape.y_m])
    if isinstance(shape, Disc):
        # Thirty-two arcs approximate a circle to 1e-9; matplotlib's has eight, and is 0.03 mm too wide at 80 mm.
        arcs = Outline.arc(0.0, 360.0, n=32)
        curve = centre + 1e3 * shape.radius_m * np.asarray(arcs.vertices, dtype=np.float64)
        codes = [*np.asarray(arcs.codes).tolist(), Outline.CLOSEPOLY]
        return PathPatch(Outline(np.vstack([curve, curve[:1]]), codes), facecolor=colour, linewidth=0)
    boxes = centre + 1e3 * (_arc_boxes(shape) if isinstance(shape, Sectors) else _boxes(shape))
    # One path for all cells: viewers then show no hairlines between touching cells.
    codes = [Outline.MOVETO, *[Outline.LINETO] * (boxes.shape[1] - 1), Outline.CLOSEPOLY] * len(boxes)
    closed = np.concatenate([boxes, boxes[:, :1]], axis=1).reshape(-1, 2)
    return PathPatch(Outline(closed, codes), facecolor=colour, linewidth=0)


def _boxes(shape: Bar | Checker | Cells) -> Array:
    """Corners (n, 4, 2) of the inked cells, relative to the shape's centre, in metres."""
    if isinstance(shape, Bar):
        turn = np.radians(shape.turn_deg)
        c, s = np.cos(turn), np.sin(turn)
        box = _box(-shape.length_m / 2, -shape.width_m / 2, shape.length_m / 2, shape.width_m / 2)
        return np.asarray([box @ np.array([[c, s], [-s, c]])])
    if isinstance(shape, Checker):
        columns, rows, side = shape.columns + 1, shape.rows + 1, shape.square_m
        left, top = -columns * side / 2, rows * side / 2
        places = [(i, j) for j in range(rows) for i in range(columns) if (i + j) % 2 == 0]
        return np.array(
            [_box(left + i * side, top - (j + 1) * side, left + (i + 1) * side, top - j * side) for i, j in places]
        )
    width, height = shape.span_m()
    cell, boxes = shape.cell_m, []
    for row, column, i, j in np.argwhere(shape.table() == 1):
        left, top = -width / 2 + column * shape.pitch_m + j * cell, height / 2 - row * shape.pitch_m - i * cell
        boxes.append(_box(left, top - cell, left + cell, top))
    return np.array(boxes)


def _arc_boxes(shape: Sectors) -> Array:
    """Outlines (n, 2 m, 2) of the inked cells: arcs as chords, within 1e-5 of a radius."""
    step, chords = 2 * np.pi / shape.sectors, max(2, -(-720 // shape.sectors))
    out = []
    for ring, sector in np.argwhere(shape.table() == 1).tolist():
        turn = -step * (sector + np.linspace(0, 1, chords + 1))
        arc = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        inner = shape.inner_m + ring * shape.ring_m
        out.append(np.concatenate([inner * arc, (inner + shape.ring_m) * arc[::-1]]))
    return np.array(out).reshape(-1, 2 * chords + 2, 2)


def _box(x0: float, y0: float, x1: float, y1: float) -> Array:
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


def _draw_lines(axes: Axes, lines: list[tuple[float, float, float, float]], width_pt: float, colour: str) -> None:
    """Lines from (x, y) to (x, y) as one path: matplotlib takes a second for a hundred plots."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    path = Outline(np.reshape(lines, (-1, 2)), [Outline.MOVETO, Outline.LINETO] * len(lines))
    path.should_simplify = False  # simplification for screen pixels would move ends by some hundredths of a millimetre
    axes.add_patch(PathPatch(path, fill=False, edgecolor=colour, linewidth=width_pt, capstyle="butt"))


def _draw_marks(axes: Axes, page: Page) -> None:
    """Cut marks and marks of the marker's centre, all outside the sheet."""
    sheet, (x, y) = page.sheet, page.origin_mm
    (left, bottom), (right, top) = ((x + 1e3 * a, y + 1e3 * b) for a, b in (sheet.low_m, sheet.high_m))
    near, far, lines = 2.0, 6.0, []
    for at, outward in ((left, -1), (right, 1)):
        lines += [(at + outward * near, level, at + outward * far, level) for level in (bottom, top, y)]
    for at, outward in ((bottom, -1), (top, 1)):
        lines += [(level, at + outward * near, level, at + outward * far) for level in (left, right, x)]
    _draw_lines(axes, lines, _MARK_PT, "0.35")


def _draw_foot(axes: Axes, page: Page, section: Any) -> None:
    corner = _EDGE_MM + 2.0
    _ruler(axes, corner, upright=False, first=50 if page.upright_ruler else 0)
    if page.upright_ruler:
        _ruler(axes, corner, upright=True, first=50)
    both = "Both rulers" if page.upright_ruler else "The ruler"
    lines: list[tuple[str, dict[str, Any]]] = [(_title(section), {"fontsize": 11, "fontweight": "bold"})]
    lines.append(
        (f"Print at 100 % (actual size, not fitted to the page). {both} must measure 100 mm.", {"fontsize": 8.5})
    )
    diameter_m = section.diameters_m[0] if section.kind == "rings" else getattr(section, "diameter_m", None)
    if diameter_m is not None and section.kind in CIRCULAR:
        lines.append((f"If it measures L mm, the diameter is {1e3 * diameter_m:g} mm x L / 100.", {"fontsize": 8.5}))
        use = {"fontsize": 8.5, "family": "monospace"}
        lines.append((f"roundel solve PHOTO OUT --diameter-m {diameter_m:g}", use))
    small = {"fontsize": 7.5, "family": "monospace"}
    wide = int((page.width_mm - corner - 8.0 - _EDGE_MM) / _SMALL_CHARACTER_MM)
    lines += [(text, small) for text in calibrate_lines(section, wide)[: _FOOT_LINES - len(lines)]]
    x, y = corner + 8.0, corner + 30.0
    for text, style in lines:
        axes.text(x, y, text, color="black", va="baseline", ha="left", **style)
        y -= 5.2


def _ruler(axes: Axes, corner_mm: float, upright: bool, first: int) -> None:
    """A line of exactly 100 mm, its ends at the middle of the outermost ticks; labels start at `first`."""
    bold, thin = [(0.0, 0.0, RULER_MM, 0.0)], list[tuple[float, float, float, float]]()
    for i in range(101):
        length = 3.2 if i % 50 == 0 else 2.4 if i % 10 == 0 else 1.6 if i % 5 == 0 else 1.0
        (bold if i % 50 == 0 else thin).append((float(i), 0.0, float(i), length))
    for lines, width_pt in ((bold, 0.7), (thin, _THIN_PT)):
        placed = [(b, a, d, c) if upright else (a, b, c, d) for a, b, c, d in lines]
        _draw_lines(
            axes,
            [(corner_mm + a, corner_mm + b, corner_mm + c, corner_mm + d) for a, b, c, d in placed],
            width_pt,
            "black",
        )
    for i in range(first, 101, 50):
        place = (corner_mm + 4.2, corner_mm + i) if upright else (corner_mm + i, corner_mm + 4.2)
        sides: dict[str, Any] = {"ha": "left", "va": "center"} if upright else {"ha": "center", "va": "bottom"}
        axes.text(*place, f"{i} mm" if i == 100 else str(i), fontsize=7, **sides)


def _title(section: Any) -> str:
    def mm(value: float) -> str:
        return f"{round(1e3 * value, 6):g}"

    name = section.kind.replace("_", " ")
    if section.kind == "rings":
        return f"Roundel {name}, diameters {', '.join(mm(d) for d in section.diameters_m)} mm"
    sizes = [
        f"{key.removesuffix('_m').replace('_', ' ')} {mm(value)} mm"
        for key, value in section
        if key.endswith("_m") and key not in ("margin_m", "grain_m", "edge_softness_m") and value is not None
    ]
    if getattr(section, "id", None) is not None:
        sizes.insert(0, f"id {section.id:g}")
    if hasattr(section, "columns"):
        sizes.insert(0, f"{section.columns} x {section.rows}")
    inverted = ", light on dark" if section.inverted else ""
    return f"Roundel {name}{inverted}: {', '.join(sizes)}"
