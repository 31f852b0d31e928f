"""Where the dots of OpenCV's circle grids are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def circle_grid_centres_m(columns: int, rows: int, spacing_m: float, asymmetric: bool) -> NDArray[np.float64]:
    """Centres of the dots in the board's frame: X right, Y up, origin at the middle of the dots.

    Source of the order and of the asymmetric pattern: OpenCV, module calib3d, `findCirclesGrid`, and its calibration
    sample (`calcBoardCornerPositions`).

    Parameters
    ----------
    columns, rows : int
        Dots in a row, and rows: OpenCV's `patternSize`.
    spacing_m : float
        Distance between rows, and between the dots of a row, or half of it if `asymmetric`; OpenCV's `squareSize`.
    asymmetric : bool
        Whether every second row is shifted by `spacing_m`.

    Returns
    -------
    (rows * columns, 2) array
        Row by row from the top left (smallest X, largest Y), metres.
    """
    row, column = np.divmod(np.arange(rows * columns), columns)
    x = 2 * column + row % 2 if asymmetric else column
    width = 2 * columns - 1 if asymmetric else columns - 1
    return np.asarray(np.stack([x - width / 2, (rows - 1) / 2 - row], axis=-1) * spacing_m, dtype=np.float64)
