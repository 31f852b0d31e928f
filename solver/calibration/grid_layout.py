"""A circle grid as a calibration sees it: its dots in the board's frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.errors import DataError
from roundel.scenes.markers.circle_grid import circle_grid_centres_m

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GridLayout:
    """A grid of circles, as OpenCV's `findCirclesGrid` names it.

    Attributes
    ----------
    columns, rows : int
        Dots in a row, and rows.
    spacing_m : float
        Between rows, and between the dots of a row; in an asymmetric grid half of that.
    diameter_m : float
        Of a dot.
    asymmetric : bool
        Whether every second row is shifted by `spacing_m`.
    """

    columns: int
    rows: int
    spacing_m: float
    diameter_m: float
    asymmetric: bool = False

    @property
    def pitch_m(self) -> float:
        """Distance between nearest neighbours."""
        return self.spacing_m * (float(np.sqrt(2)) if self.asymmetric else 1.0)

    def centres_m(self) -> Array:
        """Centres of the dots (rows * columns, 2), row by row from the top left; X right, Y up."""
        return circle_grid_centres_m(self.columns, self.rows, self.spacing_m, self.asymmetric)


def layout_of(record: Mapping[str, Any]) -> GridLayout:
    """The layout described by a marker's record in `cameras.json`.

    Raises
    ------
    DataError
        If a key is missing or wrong.
    """
    try:
        layout = GridLayout(
            int(record["columns"]),
            int(record["rows"]),
            float(record["spacing_m"]),
            float(record["diameter_m"]),
            {"symmetric": False, "asymmetric": True}[record["layout"]],
        )
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(
            f"a circle grid's layout needs columns, rows, spacing_m, diameter_m and layout, not {dict(record)}"
        ) from error
    problem = layout_problem(layout)
    if problem:
        raise DataError(f"a circle grid's layout: {problem}")
    return layout


def layout_problem(layout: GridLayout) -> str:
    """Problem with a layout, in one clause; empty if there is none."""
    if layout.columns < 2 or layout.rows < 2:
        return "needs at least 2 columns and 2 rows"
    lengths = layout.spacing_m, layout.diameter_m
    if not all(np.isfinite(lengths)) or min(lengths) <= 0:
        return "spacing_m and diameter_m must be positive"
    if layout.diameter_m >= layout.pitch_m:
        return f"dots of {layout.diameter_m:g} m touch at a distance of {layout.pitch_m:.3g} m"
    return ""
