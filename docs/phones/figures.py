"""The figures of docs/phones.md, with matplotlib, an opaque background and reproducible bytes."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from roundel.scenes.camera.film import DEFAULT_FOCAL_35MM_MM, DEFAULT_FOCAL_35MM_SIGMA_MM
from roundel.scenes.camera.phones import EPOCHS, ROLES, PhoneCamera, fit_normal, focal_lengths_mm

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
MARKS = {"main": ("o", BLUE), "ultrawide": ("v", GREEN), "tele": ("^", RED)}
NAMES = {"main": "main", "ultrawide": "ultra-wide", "tele": "tele"}


def _save(figure: Any, name: str) -> None:
    sink = io.StringIO()
    figure.savefig(sink, format="svg", metadata={"Date": None, "Creator": None})
    # Round paths to 0.01 pt, which is invisible and halves the file; the scale factors of glyphs keep their digits.
    paths = re.sub(r'(?<= d=")[^"]*', lambda d: re.sub(r"(\d\.\d\d)\d+", r"\1", d[0]), sink.getvalue())
    (HERE / name).write_text("\n".join(line.rstrip() for line in paths.splitlines()) + "\n", encoding="utf-8")


def _density(x: np.ndarray, mean: float, sigma: float) -> np.ndarray:
    return np.exp(-0.5 * ((x - mean) / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi))


def fits(phones: Sequence[PhoneCamera]) -> None:
    """Draw histogram, fit and the paper's model for each epoch."""
    from matplotlib import pyplot

    figure, panels = pyplot.subplots(len(EPOCHS), 1, figsize=(6.4, 6.2), sharex=True, layout="constrained")
    x = np.linspace(17.0, 43.0, 400)
    for axes, epoch in zip(panels, EPOCHS, strict=True):
        focal = focal_lengths_mm(phones, epoch=epoch)
        fit = fit_normal(focal)
        # Bins of 1 mm about the whole millimetres in which the lengths are stated: a count is n times the density.
        axes.hist(focal, bins=np.arange(16.5, 44.0), color=BLUE, alpha=0.35, edgecolor=PAPER, label="phones")
        axes.plot(
            x, fit.n * _density(x, fit.mean, fit.sigma), color=BLUE, label=f"fit: {fit.mean:.2f} +- {fit.sigma:.2f} mm"
        )
        paper = fit.n * _density(x, DEFAULT_FOCAL_35MM_MM, DEFAULT_FOCAL_35MM_SIGMA_MM)
        label = f"the paper: {DEFAULT_FOCAL_35MM_MM:.2f} +- {DEFAULT_FOCAL_35MM_SIGMA_MM:.2f} mm"
        axes.plot(x, paper, color=RED, linestyle="--", label=label)
        axes.set_title(f"{epoch.name}, n = {fit.n}", loc="left")
        axes.set_ylabel("phones in 1 mm")
        axes.legend(loc="upper right")
    panels[-1].set_xlabel("35-mm-equivalent focal length of the main camera, mm")
    _save(figure, "fits.svg")
    pyplot.close(figure)


def years(phones: Sequence[PhoneCamera]) -> None:
    """Draw every camera over the year of its phone, with the paper's model as a band."""
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6.4, 4.0), layout="constrained")
    low, high = (DEFAULT_FOCAL_35MM_MM + sign * 2 * DEFAULT_FOCAL_35MM_SIGMA_MM for sign in (-1, 1))
    axes.axhspan(low, high, color=RED, alpha=0.12, linewidth=0, label="the paper's mean +- 2 standard deviations")
    for role in ROLES:
        chosen = [phone for phone in phones if phone.role == role]
        # Phones of one year and focal length stand side by side.
        places: dict[tuple[int, float], int] = {}
        x = []
        for phone in chosen:
            key = phone.year, phone.focal_35mm_mm
            x.append(phone.year + 0.07 * places.setdefault(key, 0))
            places[key] += 1
        mark, colour = MARKS[role]
        y = [phone.focal_35mm_mm for phone in chosen]
        axes.scatter(x, y, marker=mark, s=14, color=colour, alpha=0.8, linewidths=0, label=NAMES[role])
    axes.set_yscale("log")
    axes.set_yticks([10, 15, 20, 30, 50, 70, 100, 200], ["10", "15", "20", "30", "50", "70", "100", "200"])
    axes.minorticks_off()
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.set_xlabel("year of announcement")
    axes.set_ylabel("35-mm equivalent, mm")
    axes.legend(loc="upper left")
    _save(figure, "years.svg")
    pyplot.close(figure)


def main(phones: Sequence[PhoneCamera]) -> None:
    """Write both."""
    import matplotlib

    matplotlib.use("Agg")
    with matplotlib.rc_context(STYLE):
        fits(phones)
        years(phones)
