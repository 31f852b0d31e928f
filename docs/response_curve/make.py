"""Make the figure of docs/response-curve.md: `python docs/response_curve/make.py [WORK]`.

Left: one edge in light and in sRGB levels, with the place where each is halfway between its sides. Right: position
errors on the frames of `benchmarks/solver/response_curve.py`, which are rendered into WORK (default
out/bench-response-curve) if they are not there.
"""

from __future__ import annotations

import io
import re
import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from scipy.special import ndtr

from roundel.scenes.camera.response_curve import SRGB

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "benchmarks" / "solver"))
import response_curve as benchmark  # noqa: E402

COLOURS = {"as linear": "#c0392b", "without a word": "#2471a3", "declared": "#7f8c8d"}
DARK, BRIGHT, SIGMA_PX = 0.04, 0.75, 0.8


def _edge(axes: mpl.axes.Axes) -> None:
    z = np.linspace(-3, 3, 601)
    light = DARK + (BRIGHT - DARK) * ndtr(z / SIGMA_PX)
    for values, colour, name in (
        (light, COLOURS["declared"], "light"),
        (SRGB.level(light), COLOURS["as linear"], "sRGB"),
    ):
        middle = (values[0] + values[-1]) / 2
        at = float(np.interp(middle, values, z))
        axes.plot(z, values, color=colour, label=name)
        axes.plot([at, at], [0, middle], color=colour, lw=0.8, ls=":")
        axes.plot(at, middle, "o", color=colour, ms=5)
    axes.set(xlabel="distance from the edge, px", ylabel="fraction of the range", ylim=(0, 1), xlim=(-3, 3))
    axes.legend(frameon=False, loc="upper left")
    axes.set_title("Halfway is elsewhere after a curve", fontsize=10)


def _errors(axes: mpl.axes.Axes, work: Path) -> None:
    study = benchmark.rendered(work)
    found = benchmark.solved(study, work, next(iter(benchmark.SENSORS)), "srgb", 48)
    for told, answers in found.items():
        errors = np.sort([1e3 * error for _, error, _ in answers])
        part = (np.arange(len(errors)) + 0.5) / len(errors)
        axes.plot(errors, 100 * part, color=COLOURS[told], label=told, lw=1.4, ls="--" if told == "declared" else "-")
    axes.set(
        xscale="log", xlabel="error of the position, mm (at 0.4 to 0.96 m)", ylabel="% of the frames", ylim=(0, 100)
    )
    axes.legend(frameon=False, loc="upper left")
    axes.set_title("An sRGB array given to locate", fontsize=10)


def main() -> None:
    """Write the figure."""
    mpl.rcParams |= {"svg.hashsalt": "roundel", "font.size": 9, "svg.fonttype": "none"}
    work = Path(sys.argv[1] if len(sys.argv) > 1 else "out/bench-response-curve")
    work.mkdir(parents=True, exist_ok=True)
    figure = Figure(figsize=(7.6, 2.9), layout="constrained", facecolor="white")
    axes = figure.subplots(1, 2)
    _edge(axes[0])
    _errors(axes[1], work)
    sink = io.StringIO()
    figure.savefig(sink, format="svg", metadata={"Date": None, "Creator": None})
    (HERE / "response_curve.svg").write_text(
        re.sub(r"[ \t]+$", "", sink.getvalue(), flags=re.MULTILINE), encoding="utf-8"
    )


if __name__ == "__main__":
    main()
