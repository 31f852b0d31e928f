"""Make the figures and tables of docs/phones.md from scenes/camera/phones.csv: `python docs/phones/make.py`.

Tables are written into the page, between `<!-- table: NAME -->` and `<!-- end -->`. Nothing is random.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from urllib.parse import quote

import numpy as np

from roundel.scenes.camera.film import (
    DEFAULT_FOCAL_35MM_MM,
    DEFAULT_FOCAL_35MM_SIGMA_MM,
    FOCAL_35MM_2020S_MM,
    FOCAL_35MM_2020S_SIGMA_MM,
)
from roundel.scenes.camera.phones import (
    EPOCHS,
    ROLES,
    NormalFit,
    PhoneCamera,
    fit_normal,
    focal_lengths_mm,
    read_phones,
)

PAGE = Path(__file__).parents[1] / "phones.md"
PAPER = (DEFAULT_FOCAL_35MM_MM, DEFAULT_FOCAL_35MM_SIGMA_MM)
TODAY = (FOCAL_35MM_2020S_MM, FOCAL_35MM_2020S_SIGMA_MM)
SINGULAR = {"main": "main", "ultrawide": "ultra-wide", "tele": "tele"}


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def fits_table(phones: Sequence[PhoneCamera]) -> str:
    """The fits to main cameras by epoch, and to all."""
    rows = [_fit_row(epoch.name, fit_normal(focal_lengths_mm(phones, epoch=epoch))) for epoch in EPOCHS]
    latest = sorted(focal_lengths_mm(phones, epoch=EPOCHS[-1]))
    ends = f"{EPOCHS[-1].name}, without the {latest[0]:g} and the {latest[-1]:g} mm"
    rows.append(_fit_row(ends, fit_normal(latest[1:-1])))
    rows.append(_fit_row("all years", fit_normal(focal_lengths_mm(phones))))
    rows.append(["the paper", "about 30", f"{PAPER[0]:.2f}", f"{PAPER[1]:.2f}", f"{100 * PAPER[1] / PAPER[0]:.1f} %"])
    return table(["main cameras", "n", "mean, mm", "standard deviation, mm", "relative"], rows)


def _fit_row(name: str, fit: NormalFit) -> list[str]:
    mean, sigma = f"{fit.mean:.2f} +- {fit.mean_error:.2f}", f"{fit.sigma:.2f} +- {fit.sigma_error:.2f}"
    return [name, str(fit.n), mean, sigma, f"{100 * fit.sigma / fit.mean:.1f} %"]


def depth_table(phones: Sequence[PhoneCamera]) -> str:
    """Depth errors of the phones of each epoch under either prior.

    Depth is proportional to the assumed focal length: the error of a phone with f is mean / f - 1. A phone is covered
    if its focal length lies within the prior's 68 or 95 % interval.
    """
    rows = []
    for epoch in EPOCHS:
        focal = np.array(focal_lengths_mm(phones, epoch=epoch))
        rows.append(_depth_row(epoch.name, "`default`", focal, *PAPER))
        rows.append(_depth_row(epoch.name, "`default:2020s`", focal, *TODAY))
    others = [fit_normal(np.delete(focal, i)) for i in range(focal.size)]  # of the last epoch
    means, sigmas = np.array([fit.mean for fit in others]), np.array([fit.sigma for fit in others])
    rows.append(_depth_row(epoch.name, "fit to all others", focal, means, sigmas))
    head = ["main cameras", "intrinsics", "depth error: mean", "RMS", "states", "within 68 %", "within 95 %"]
    return table(head, rows)


def _depth_row(
    epoch: str, name: str, focal: np.ndarray, mean: float | np.ndarray, sigma: float | np.ndarray
) -> list[str]:
    error = 100 * (mean / focal - 1)
    away = np.abs(focal - mean) / sigma
    covered = [f"{np.count_nonzero(away <= limit)} of {focal.size}" for limit in (1.0, 1.96)]
    stated = 100 * float(np.mean(sigma / mean))
    return [epoch, name, f"{error.mean():+.1f} %", f"{math.sqrt((error**2).mean()):.1f} %", f"{stated:.1f} %", *covered]


def roles_table(phones: Sequence[PhoneCamera]) -> str:
    """Range of the focal lengths of each role, phones of 2020 and later."""
    rows = []
    for role in ROLES:
        focal = np.array(focal_lengths_mm(phones, role, EPOCHS[-1]))
        low, middle, high = (f"{value:g} mm" for value in (focal.min(), np.median(focal), focal.max()))
        ratio = PAPER[0] / float(np.median(focal))
        rows.append(
            [
                SINGULAR[role],
                str(focal.size),
                low,
                middle,
                high,
                f"x {ratio:.2f}",
                f"x {TODAY[0] / PAPER[0] * ratio:.2f}",
            ]
        )
    head = ["camera", "n", "shortest", "median", "longest", "depth of the median: `default`", "`default:2020s`"]
    return table(head, rows)


def data_table(phones: Sequence[PhoneCamera]) -> str:
    """Every row of the data file."""
    rows = []
    for p in phones:
        cells = [p.name, str(p.year), SINGULAR[p.role], f"{p.focal_35mm_mm:g}", _link(p.source), p.checked]
        rows.append([cell.replace("|", "/") for cell in cells])
    return table(["phone", "year", "camera", "mm", "source", "second reading"], rows)


def _link(source: str) -> str:
    """A link to a page, or to a file at its commit."""
    file = re.fullmatch(r"github\.com/([\w.-]+)/([\w.-]+)@(\w+): (.*?)(?:, line (\d+))?", source)
    if file:
        owner, repository, commit, path, line = file.groups()
        address = f"https://github.com/{owner}/{repository}/blob/{commit}/{quote(path)}"
        return f"[{repository}, {path}{f', line {line}' if line else ''}]({address}{f'#L{line}' if line else ''})"
    address, _, more = source.partition(", ")
    site = address.split("/")[2].removeprefix("www.")
    return f"[{site}]({quote(address, safe=':/?=&%@-_.')})" + (f" ({more})" if more else "")


TABLES: dict[str, Callable[[Sequence[PhoneCamera]], str]] = {
    "fits": fits_table,
    "depth": depth_table,
    "roles": roles_table,
    "data": data_table,
}


def filled(page: str, phones: Sequence[PhoneCamera]) -> str:
    """The page with every table made anew."""
    for name, made in TABLES.items():
        pattern, text = rf"(<!-- table: {name} -->\n).*?(<!-- end -->)", made(phones)
        page, places = re.subn(pattern, lambda m, text=text: f"{m[1]}\n{text}\n\n{m[2]}", page, flags=re.DOTALL)
        if places != 1:
            raise SystemExit(f"{PAGE.name} has {places} places for the table {name}; expected one")
    return page


def main() -> None:
    """Write the figures and the page."""
    import figures

    phones = read_phones()
    figures.main(phones)
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8"), phones), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
