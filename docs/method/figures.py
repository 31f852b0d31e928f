"""The figures of docs/method.md, with matplotlib, an opaque background and reproducible bytes."""

from __future__ import annotations

import io
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
from ambiguity import PAPER_K, Array, criterion, pencil
from focal import FACTORS, normal_bias_deg
from precision import BLURS, DISTANCES, RADII, RADIUS, TILTS, pose_on_axis, shrinkage, simulated

from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic, ellipse_points
from roundel.scenes.geometry.information import contour_information, pose_bound
from roundel.scenes.geometry.pose import camera_from_marker_of, normal_of
from roundel.solver.pose.circle_pose import poses_from_conic

HERE = Path(__file__).parent
# Okabe and Ito's palette, which is safe for colour-blind readers.
BLUE, RED, GREEN, GREY = "#0072b2", "#d55e00", "#009e73", "#7f7f7f"
INK, PAPER = "#222222", "#ffffff"
STYLE: dict[str, Any] = {
    "svg.hashsalt": "roundel",
    "svg.fonttype": "path",  # glyphs of matplotlib's own font: the same picture on every machine
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": GREY,
    "figure.facecolor": PAPER,
    "savefig.facecolor": PAPER,  # opaque: readable on a dark page, too
    "legend.frameon": False,
    "text.color": INK,
    "axes.labelcolor": INK,
}


def _save(figure: Any, name: str) -> None:
    if name.endswith("png"):
        figure.savefig(HERE / name, dpi=110, metadata={"Software": None})
        return
    sink = io.StringIO()
    figure.savefig(sink, format="svg", metadata={"Date": None, "Creator": None})
    # Round paths to 0.01 pt, which is invisible and halves the file; the scale factors of glyphs keep their digits.
    paths = re.sub(r'(?<= d=")[^"]*', lambda d: re.sub(r"(\d\.\d\d)\d+", r"\1", d[0]), sink.getvalue())
    lines = paths.splitlines()
    (HERE / name).write_text("\n".join(line.rstrip() for line in lines) + "\n", encoding="utf-8")


def _arrow(axes: Any, start: Array, end: Array, colour: str) -> None:
    axes.annotate(
        "", end, start, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.6, "shrinkA": 0, "shrinkB": 0}
    )


def cone() -> None:
    """Draw both circles on one cone: in space, and in the plane of e1 and e3."""
    from matplotlib.figure import Figure

    radius = 1.0
    normal, centre = normal_of(42.0, 0.0), np.array([0.6, 0.0, 3.2])
    conic = conic_of_circle(camera_from_marker_of(normal, centre), radius, np.eye(3))
    poses = poses_from_conic(conic, np.eye(3), radius)
    values, vectors = np.linalg.eigh(conic)
    e1 = vectors[:, 2] * np.sign(vectors[2, 2])
    e3 = vectors[:, 0] * np.sign(vectors[0, 0])
    figure = Figure(figsize=(8.4, 3.5), layout="constrained")
    grid = figure.add_gridspec(1, 2, width_ratios=(1, 1.35))
    space, cut = figure.add_subplot(grid[0], projection="3d"), figure.add_subplot(grid[1])

    t = np.linspace(0, 2 * np.pi, 73)
    for i, colour in enumerate((BLUE, RED)):
        m = camera_from_marker_of(poses.normal[i], poses.centre_m[i])
        ring = poses.centre_m[i] + radius * (np.cos(t)[:, None] * m[:3, 0] + np.sin(t)[:, None] * m[:3, 1])
        # Depth is to the right; the image's y axis points down, so it is negated.
        space.plot(ring[:, 2], ring[:, 0], -ring[:, 1], color=colour, lw=2)
        if i == 0:
            for p in ring[::3] * 1.3:
                space.plot([0, p[2]], [0, p[0]], [0, -p[1]], color=GREY, lw=0.5, alpha=0.7)
        tip = poses.centre_m[i] + 1.1 * poses.normal[i]
        space.plot(*zip(*[(v[2], v[0], -v[1]) for v in (poses.centre_m[i], tip)], strict=True), color=colour, lw=1.6)
    space.set_box_aspect((4.2, 2.6, 2.2), zoom=1.35)
    space.view_init(elev=28, azim=-62)
    space.set_axis_off()

    def place(v: Array) -> Array:
        return np.array([v @ e1, v @ e3])

    slope = math.sqrt(-values[2] / values[0])
    reach = 4.6
    for sign in (1, -1):
        cut.plot([0, reach], [0, sign * slope * reach], color=GREY, lw=1)
    cut.plot([0, reach + 0.2], [0, 0], color=GREY, lw=0.8, ls=(0, (6, 3)))
    for i, (colour, name) in enumerate(((BLUE, "candidate 0"), (RED, "candidate 1"))):
        middle, n = place(poses.centre_m[i]), place(poses.normal[i])
        along = np.array([-n[1], n[0]]) * radius
        cut.plot(*zip(middle - along, middle + along, strict=True), color=colour, lw=2.4, label=name)
        cut.plot(*middle, "o", color=colour, ms=4)
        _arrow(cut, middle, middle + 0.85 * n, colour)
    cut.plot(0, 0, "o", color=INK, ms=5)
    cut.annotate("camera centre", (0, 0), (-0.1, -0.35))
    cut.annotate("$e_1$, axis of the cone", (reach + 0.2, 0), (reach - 0.75, 0.1))
    cut.annotate("cone $x^\\top A\\,x = 0$", (1.2, slope * 1.2), (0.55, slope * 1.2 + 0.4))
    cut.set_aspect("equal")
    cut.set_axis_off()
    cut.set_ylim(bottom=-1.5)
    cut.legend(loc="lower left")
    _save(figure, "cone.svg")


def _scene(theta: float) -> tuple[Array, Array]:
    """The camera's axes (rows) and centre in the frame of section 5."""
    c, s = math.cos(theta), math.sin(theta)
    return np.array([[1, 0, 0], [0, -s, -c], [0, c, -s]]), np.array([0, -c, s])


def _line(axes: Any, line: Array, limits: tuple[float, float, float, float], **style: Any) -> None:
    """Draw the line a x + b y + c = 0 within a box."""
    a, b, c = line
    if abs(b) > abs(a):
        x = np.array(limits[:2])
        axes.plot(x, -(a * x + c) / b, **style)
    else:
        y = np.array(limits[2:])
        axes.plot(-(b * y + c) / a, y, **style)


def pencil_picture() -> None:
    """Draw the pencil in the plane, and two images in which different lines separate the limiting points."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.6, 3.3), layout="constrained")
    plane, far, near = figure.subplots(1, 3)
    radius = 0.28
    for axes, theta, xc, yc, limits in (
        (far, math.radians(60), 0.5, 0.3, (-2.6, 2.4, -2.05, 2.95)),
        (near, math.radians(35), 0.2, -0.45, (-2.9, 2.1, -3.2, 1.8)),
    ):
        turn, stand = _scene(theta)
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = turn, turn @ (np.array([xc, yc, 0.0]) - stand)
        conic = conic_of_circle(pose, radius, np.eye(3))[None]
        plain, separating, points = (v[0] for v in pencil(conic, np.eye(3)))
        e = float(criterion(np.array(theta), np.array(xc), np.array(yc), np.array(radius)))
        true, other = (plain, separating) if e > 0 else (separating, plain)
        closed = ellipse_points(ellipse_of_conic(conic[0]), 120)
        axes.fill(*closed.T, color=BLUE, alpha=0.25, lw=0)
        axes.plot(*np.vstack([closed, closed[:1]]).T, color=BLUE, lw=1.4)
        _line(axes, true, limits, color=GREEN, lw=1.8, label="vanishing line")
        _line(axes, other, limits, color=RED, lw=1.4, ls="--", label="the other line, $v_o$")
        at = points[:, :2] / points[:, 2:]
        axes.plot(*at.T, color=GREY, lw=0.7)
        axes.plot(*at.T, "o", color=INK, ms=4)
        axes.plot(0, 0, "+", color=GREY, ms=8)
        for p, name in zip(at, ("$z_1$", "$z_3$"), strict=True):
            axes.annotate(name, p, xytext=(6, 4), textcoords="offset points")
        axes.set_xlim(limits[:2])
        axes.set_ylim(limits[3], limits[2])
        axes.set_title("image, E > 0: $v_o$ separates" if e > 0 else "image, E < 0: vanishing line separates")
    far.legend(loc="lower right")

    theta, xc, yc = math.radians(60), 0.5, 0.3
    c, s = math.cos(theta), math.sin(theta)
    foot, middle = np.array([0.0, -c]), np.array([xc, yc])
    ell = float(np.linalg.norm(middle - foot))
    along = (middle - foot) / ell
    radical = (ell**2 - radius**2 - s**2) / (2 * ell)
    roots = [radical + math.hypot(radical, s), radical - math.hypot(radical, s)]
    t = np.linspace(0, 2 * np.pi, 181)
    circle = np.stack([np.cos(t), np.sin(t)], axis=1)
    # Members of the pencil: circles about either limiting point.
    for m in (0.93, 0.8, 0.62, -0.95, -0.8, -0.65):
        offset = radical + (roots[0] - radical) / m
        size = math.sqrt(max((offset - radical) ** 2 - (roots[0] - radical) ** 2, 0.0))
        plane.plot(*(foot + offset * along + size * circle).T, color=GREY, lw=0.5)
    plane.fill(*(middle + radius * circle).T, color=BLUE, alpha=0.25, lw=0)
    plane.plot(*(middle + radius * circle).T, color=BLUE, lw=1.4)
    across = np.array([-along[1], along[0]])
    start = foot + radical * along
    plane.plot(*zip(start - 2 * across, start + 2 * across, strict=True), color=RED, lw=1.4, ls="--")
    plane.plot([-2, 2], [-1 / c, -1 / c], color=GREY, lw=1, ls=":")
    for m, name in zip(roots, ("$x_1$", "$x_3$"), strict=True):
        p = foot + m * along
        plane.plot(*p, "o", color=INK, ms=4)
        plane.annotate(name, p, xytext=(6, 3), textcoords="offset points")
    plane.plot(*foot, "s", color=INK, ms=3.5)
    plane.annotate("F", foot, xytext=(5, -10), textcoords="offset points")
    plane.plot(0, 0, "+", color=GREY, ms=8)
    plane.annotate("q", (0, 0), xytext=(-10, 3), textcoords="offset points")
    plane.annotate("L", (-1.6, -1 / c), xytext=(0, 3), textcoords="offset points")
    plane.annotate("$l_o$", start + 1.0 * across, xytext=(-3, 7), textcoords="offset points", color=RED)
    plane.set_xlim(-1.75, 1.75)
    plane.set_ylim(-2.25, 1.25)
    plane.set_title("plane of the marker")
    for axes in (plane, far, near):
        axes.set_aspect("equal")
        axes.set_xticks([])
        axes.set_yticks([])
    _save(figure, "pencil.svg")


def curved_edge() -> None:
    """Draw the errors of the radius when a straight and a curved step are fitted to blurred discs."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.0, 3.2), layout="constrained")
    axes = figure.subplots()
    fine = np.linspace(0, 4.1, 60)
    for radius, colour, marker in zip(RADII, (BLUE, RED, GREEN), "osD", strict=True):
        axes.plot(fine, -(fine**2 + 1 / 12) / (2 * radius), color=colour, lw=1, ls="--")
        straight = [shrinkage(radius, b, 0) for b in BLURS]
        curved = [shrinkage(radius, b, 2) for b in BLURS]
        axes.plot(BLURS, straight, marker, color=colour, ms=4.5, label=f"straight step, radius {radius:g} px")
        axes.plot(BLURS, curved, marker, color=colour, ms=4.5, mfc=PAPER)
    axes.plot([], [], "o", color=GREY, mfc=PAPER, ms=4.5, label="curved step, second order")
    axes.plot([], [], color=GREY, lw=1, ls="--", label="$-b^2/2\\rho$")
    axes.axhline(0, color=GREY, lw=0.8)
    axes.set_xlabel("blur, standard deviation [px]")
    axes.set_ylabel("fitted radius minus true radius [px]")
    axes.legend(loc="lower left")
    _save(figure, "curved_edge.svg")


def normal_error(trials: int = 300) -> None:
    """Draw the simulated error of the normal over the distance, and its bound."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.0, 3.2), layout="constrained")
    axes = figure.subplots()
    fine = np.linspace(13, 52, 40)
    for tilt, colour, marker in zip(TILTS, (BLUE, RED, GREEN), "osD", strict=True):
        bound = [
            pose_bound(contour_information(pose_on_axis(tilt, d), RADIUS, PAPER_K, 1.0, 200)).normal_deg for d in fine
        ]
        axes.plot(fine, bound, color=colour, lw=1.2)
        spread = [np.degrees(np.sqrt(np.sum(np.var(simulated(tilt, d, trials, 5)[0], axis=0)))) for d in DISTANCES]
        axes.plot(DISTANCES, spread, marker, color=colour, ms=4.5, label=f"tilt {tilt}\N{DEGREE SIGN}")
    axes.plot([], [], color=GREY, lw=1.2, label="Cram\xe9r-Rao bound")
    axes.set_xlabel("distance [D]")
    axes.set_ylabel("scatter of the normal [degrees]")
    axes.set_ylim(bottom=0)
    axes.legend(loc="upper left")
    _save(figure, "normal_error.svg")


def wrong_focal() -> None:
    """Draw the bias of the normal at 20 degrees off the axis, over azimuth and tilt from the line of sight."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.2, 2.7), layout="constrained")
    panels = figure.subplots(1, 4)
    across = np.linspace(-60, 60, 61)
    x, y = np.meshgrid(across, across)
    outside = np.hypot(x, y) > 60
    turn = np.linspace(0, 2 * np.pi, 181)
    for axes, factor in zip(panels, FACTORS, strict=True):
        bias = np.full_like(x, np.nan)
        for at in zip(*np.nonzero(~outside), strict=True):
            tilt, azimuth = float(np.hypot(x[at], y[at])), math.degrees(math.atan2(y[at], x[at]))
            bias[at] = normal_bias_deg(20.0, tilt, azimuth, factor)
        shades = axes.imshow(bias, extent=(-61, 61, 61, -61), vmin=0, vmax=20, cmap="YlOrBr")
        lines = axes.contour(x, y, bias, [1, 2, 4, 6, 8, 10, 12.5, 15], colors=INK, linewidths=0.6)
        axes.clabel(lines, fmt="%g", fontsize=6.5)
        for ring in (30, 60):
            axes.plot(ring * np.cos(turn), ring * np.sin(turn), color=GREY, lw=0.5, ls=":" if ring == 30 else "-")
        axes.plot(-30, 0, "o", ms=3.5, color=BLUE)
        axes.set_aspect("equal")
        axes.set_axis_off()
        axes.set_title(f"f x {factor:g}")
    figure.colorbar(shades, ax=panels, label="error of the normal [degrees]", shrink=0.85)
    _save(figure, "wrong_focal.png")


def main() -> None:
    """Make all figures."""
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        for draw in (cone, pencil_picture, curved_edge, normal_error, wrong_focal):
            draw()
