"""Distributions of a dataset's degrees of freedom: counts in even bins, and small plots of them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from roundel.datasets.dataset import Dataset

Array = NDArray[np.float64]

_MOST_BINS = 32


@dataclass(frozen=True)
class Degree:
    """A degree of freedom: its name in the record, its title with the unit, and its values from rows of the truth."""

    name: str
    title: str
    values: Callable[[pa.Table], Array | None]


def _column(name: str) -> Callable[[pa.Table], Array | None]:
    def values(rows: pa.Table) -> Array | None:
        if name not in rows.column_names:
            return None
        return np.asarray(rows[name].to_numpy(zero_copy_only=False), dtype=np.float64)

    return values


DEGREES: tuple[Degree, ...] = (
    Degree("distance_m", "distance [m]", _column("distance_m")),
    Degree("distance_D", "distance [diameters]", _column("distance_D")),
    Degree("tilt_deg", "tilt [deg]", _column("tilt_deg")),
    Degree("azimuth_deg", "azimuth [deg]", _column("azimuth_deg")),
    Degree("centre_image_x_px", "image of the centre, x [px]", _column("centre_image_x_px")),
    Degree("centre_image_y_px", "image of the centre, y [px]", _column("centre_image_y_px")),
    Degree("ellipse_a_px", "major semi-axis [px]", _column("ellipse_a_px")),
    Degree("visible_fraction", "visible fraction", _column("visible_fraction")),
    Degree("edge_contrast_dn", "contrast of the edge [levels]", _column("edge_contrast_dn")),
    Degree("edge_noise_dn", "noise at the edge [levels]", _column("edge_noise_dn")),
    Degree("edge_blur_px", "blur of the edge [px]", _column("edge_blur_px")),
)


def distributions_of(dataset: Dataset) -> dict[str, dict[str, Any]]:
    """Each degree of freedom over all markers, read twice, a shard at a time: for the range, and for the counts.

    Returns
    -------
    dict
        By name: `n` values, `low`, `high`, `mean`, and `counts` in even bins from `low` to `high`; one bin if all are
        equal. Without a value, a degree is left out.

    Notes
    -----
    The number of bins is 2 n^(1/3) (Rice's rule), so that few values are not shown as many gaps.
    """
    found: dict[str, dict[str, Any]] = {}
    for rows in dataset.truths():
        for degree in DEGREES:
            known = _known(degree, rows)
            if len(known):
                entry = found.setdefault(degree.name, {"n": 0, "low": math.inf, "high": -math.inf, "sum": 0.0})
                entry["n"] += len(known)
                entry["low"], entry["high"] = (
                    min(entry["low"], float(known.min())), max(entry["high"], float(known.max())),
                )  # fmt: skip
                entry["sum"] += float(known.sum())
    for rows in dataset.truths():
        for degree in DEGREES:
            known = _known(degree, rows)
            if len(known):
                entry = found[degree.name]
                bins = min(_MOST_BINS, round(2 * entry["n"] ** (1 / 3))) if _varies(entry) else 1
                counts, _ = np.histogram(known, bins=bins, range=(entry["low"], entry["high"]))
                entry["counts"] = (np.array(entry.get("counts", 0)) + counts).tolist()
    order = (degree.name for degree in DEGREES if degree.name in found)
    return {name: _record(found[name]) for name in order}


def _known(degree: Degree, rows: pa.Table) -> Array:
    values = degree.values(rows)
    return np.empty(0) if values is None else values[np.isfinite(values)]


def _varies(entry: dict[str, Any]) -> bool:
    """Whether values differ by more than rounding."""
    return bool(entry["high"] - entry["low"] > 1e-9 * max(abs(entry["high"]), abs(entry["low"])))


def _record(entry: dict[str, Any]) -> dict[str, Any]:
    mean = entry["sum"] / entry["n"]
    return {"n": entry["n"], "low": entry["low"], "high": entry["high"], "mean": mean, "counts": entry["counts"]}


_WIDTH, _HEIGHT = 220, 64


def plot_of(record: dict[str, Any]) -> str:
    """A small bar chart of a distribution, as SVG; its text is in the page."""
    counts = record["counts"]
    most, step = max(counts), _WIDTH / len(counts)
    bars = "".join(
        f'<rect x="{i * step + 0.5:.2f}" y="{_HEIGHT * (1 - n / most):.2f}" width="{max(step - 1, 1):.2f}" '
        f'height="{_HEIGHT * n / most:.2f}"/>'
        for i, n in enumerate(counts)
        if n
    )
    about = f"from {record['low']:.4g} to {record['high']:.4g}, mean {record['mean']:.4g}"
    return (
        f'<svg class="bars" viewBox="0 0 {_WIDTH} {_HEIGHT + 1}" role="img" aria-label="Distribution {about}">'
        f'{bars}<line x1="0" y1="{_HEIGHT + 0.5}" x2="{_WIDTH}" y2="{_HEIGHT + 0.5}"/></svg>'
    )
