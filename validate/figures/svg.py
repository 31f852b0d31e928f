"""Drawing: matplotlib figures as SVG that is inlined into the page and coloured by its style sheet.

Text, grid and curves use CSS variables, so that one figure works on light and dark pages. Text stays text, in the
reader's font. The bytes depend only on the drawing.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal
from xml.sax.saxutils import escape

from roundel.datasets.store.writing import sha256
from roundel.scenes.display_text import clean

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Placeholder colours for CSS variables: matplotlib needs a colour, and writes it as lower-case hex.
INK, GRID = "#010203", "#040506"

# Okabe and Ito's palette for colour-blind readers, without its yellow, which is invisible on white paper.
# They stand for --curve-0 ... in the style sheet, which lightens them for dark pages; markers also differ.
CURVES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f7f7f")
MARKERS = ("o", "s", "^", "D", "v", "P", "X")

_TITLE_LIMIT = 300

# Control and reordering characters, which a user's name may contain.
_CONTROLS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u00ad\u061c\u200b-\u200f\u202a-\u202e\u2060-\u206f\ufeff]")

# Three panels fill the report's column.
_PX_PER_PT = 1.6


@dataclass(frozen=True)
class Picture:
    """A figure: its SVG for inlining, and its caption."""

    name: str
    caption: str
    svg: str
    folded: bool = False  # collapsed by default


def colour(i: int) -> str:
    """Colour of the i-th curve."""
    return CURVES[i % len(CURVES)]


def marker(i: int) -> str:
    """Marker of the i-th curve."""
    return MARKERS[i % len(MARKERS)]


def line(i: int) -> str:
    """Line style of the i-th curve: repeated colours and markers are dashed."""
    return ("-", "--", ":", "-.")[i // len(CURVES) % 4]


def legend_text(name: str, limit: int = 40) -> str:
    """A user's name for matplotlib: on one line, truncated, never hidden from a legend, never parsed as a formula."""
    shown = clean(name, limit).replace("$", r"\$")
    # Matplotlib omits labels that begin with an underscore from legends.
    return f" {shown}" if shown.startswith("_") else shown


def name_of(*texts: str) -> str:
    """A unique figure name from users' names, safe as an id and in a path."""
    plain = [re.sub(r"[^a-z0-9._-]+", "-", text.lower())[:40].strip("-.") for text in texts]
    name = "-".join(filter(None, plain))
    return name if plain == list(texts) else f"{name}-{sha256(chr(0).join(texts).encode('utf-8', 'replace'))[:8]}"


def add_legend(owner: Figure | Axes, **style: Any) -> None:
    """Add a legend of the labelled artists in a figure or axes, if there are any."""
    from matplotlib.figure import Figure

    panels = owner.get_axes() if isinstance(owner, Figure) else [owner]
    if any(axes.get_legend_handles_labels()[1] for axes in panels):
        owner.legend(**style)


def draw_svg(
    name: str,
    title: str,
    size_in: tuple[float, float],
    draw: Callable[[Figure], None],
    layout: Literal["constrained"] | None = "constrained",
) -> str:
    """A figure as SVG for inlining.

    Parameters
    ----------
    name : str
        Lower-case letters, digits and hyphens; unique on its page.
    title : str
        Text for screen readers.
    size_in : (width, height)
        Inches; a width of nine fills the report's column.
    draw : callable
        Draws into the given figure. Only the colours INK, GRID and CURVES adapt to light and dark pages.
    layout : "constrained" or None
        Matplotlib's layout engine; with None, `draw` places the axes.

    Returns
    -------
    str
        The same bytes for the same drawing.
    """
    import matplotlib as mpl
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    settings: Any = {
        "svg.hashsalt": name,
        "svg.fonttype": "none",
        "font.size": 9,
        "axes.edgecolor": GRID,
        "axes.labelcolor": INK,
        "axes.titlesize": 9,
        "axes.titlecolor": INK,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.grid": True,
        "axes.axisbelow": True,
        "grid.color": GRID,
        "grid.linewidth": 0.5,
        "xtick.color": GRID,
        "ytick.color": GRID,
        "xtick.labelcolor": INK,
        "ytick.labelcolor": INK,
        "xtick.minor.visible": False,
        "text.color": INK,
        "legend.frameon": False,
    }
    with mpl.rc_context(settings):
        figure = Figure(figsize=size_in, layout=layout)
        FigureCanvasSVG(figure)
        draw(figure)
        sink = io.StringIO()
        figure.savefig(sink, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    return inlined(sink.getvalue(), name, title)


def inlined(svg: str, name: str, title: str) -> str:
    """A matplotlib SVG file as an HTML element: coloured by CSS, unique ids, a label for screen readers."""
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->", "", svg, flags=re.DOTALL)
    svg = re.sub(r"\s*\n\s*", "\n", svg)
    svg = _CONTROLS.sub("\N{REPLACEMENT CHARACTER}", svg)
    svg = re.sub(r' xmlns:xlink="[^"]*"', "", svg).replace("xlink:href", "href")
    # Ids must be unique on a page.
    svg = re.sub(r'\bid="([^"]+)"', rf'id="{name}-\1"', svg)
    svg = re.sub(r'href="#([^"]+)"', rf'href="#{name}-\1"', svg)
    svg = re.sub(r"url\(#([^)]+)\)", rf"url(#{name}-\1)", svg)
    colours: dict[str, Any] = {INK: "var(--ink)", GRID: "var(--grid)"}
    colours |= {colour: f"var(--curve-{i})" for i, colour in enumerate(CURVES)}
    for colour, variable in colours.items():
        svg = svg.replace(colour, variable)
    # A hundredth of a point is below a pixel; rounding to it halves the file.
    svg = re.sub(r"<[^>]+>", lambda tag: re.sub(r"(\d\.\d\d)\d+", r"\1", tag[0]), svg)
    # Scale to the page width, but no larger than the size at which all figures have the same font size.
    width = re.search(r'<svg[^>]*? width="([\d.]+)pt"', svg)
    widest = f"{_PX_PER_PT * float(width[1]):.0f}px" if width else "100%"
    svg = re.sub(r'(<svg[^>]*?) width="[^"]*"', rf'\1 style="max-width: {widest}"', svg, count=1)
    svg = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", svg, count=1)
    text = escape(clean(title, _TITLE_LIMIT), {'"': "&quot;"})
    return svg.replace("<svg", f'<svg class="figure" role="img" aria-label="{text}"', 1).strip()


# The report's colours (report.css), for figures that are shown in a README.
_LIGHT = ("#1b1f24", "#c9ced6", *CURVES)
_DARK = ("#e6e8eb", "#4a515b", "#4aa3df", "#ff8a3d", "#2fc89a", "#e59cc4", "#f2b93b", "#8fd0f5", "#a8a8a8")


def standalone_svg(picture: Picture) -> str:
    """The figure as a file that follows the reader's light or dark scheme."""
    names = ("--ink", "--grid", *(f"--curve-{i}" for i in range(len(CURVES))))
    light, dark = ("".join(f"{n}:{v};" for n, v in zip(names, values, strict=True)) for values in (_LIGHT, _DARK))
    style = f"<style>svg{{{light}}}@media(prefers-color-scheme:dark){{svg{{{dark}}}}}</style>"
    head, bracket, rest = picture.svg.partition(">")
    return f"{head}{bracket}{style}{rest}\n"
