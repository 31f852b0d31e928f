"""Square tags: their cells by family and id, and their layout on a board.

The bits are those of OpenCV's predefined dictionaries, so that its detectors read the rendered tags.
"""

from __future__ import annotations

import json
from functools import lru_cache
from importlib import resources

import numpy as np
from numpy.typing import NDArray

Cells = NDArray[np.uint8]


@lru_cache(maxsize=1)
def _families() -> dict[str, tuple[int, list[str]]]:
    text = resources.files("roundel.scenes.markers").joinpath("tag_bits.json").read_text(encoding="utf-8")
    return {name: (int(entry["side"]), list(entry["codes"])) for name, entry in json.loads(text)["families"].items()}


def tag_cells(family: str, first_id: int, count: int) -> Cells:
    """Cells of `count` tags from `first_id` on.

    Parameters
    ----------
    family : str
        `aruco_4x4_50`, `aruco_5x5_100`, `aruco_6x6_250` or `apriltag_36h11`.
    first_id, count : int

    Returns
    -------
    (count, n, n) uint8 array
        1 is ink; the black border, one cell wide, is part of it. Row 0 is the top one.

    Raises
    ------
    ValueError
        If the family has fewer tags.
    """
    side, codes = _families()[family]
    if first_id + count > len(codes):
        raise ValueError(
            f"marker.first_id: {count} tags from id {first_id} need ids up to {first_id + count - 1}, but {family} "
            f"ends at {len(codes) - 1}; use a smaller first_id, a smaller board, or another family"
        )
    cells = np.ones((count, side + 2, side + 2), dtype=np.uint8)
    for i, code in enumerate(codes[first_id : first_id + count]):
        white = [int(bit) for bit in f"{int(code, 16):0{side * side}b}"]
        cells[i, 1:-1, 1:-1] = 1 - np.reshape(np.array(white, dtype=np.uint8), (side, side))
    return cells


def tag_grid(family: str, first_id: int, columns: int, rows: int) -> Cells:
    """Cells (rows, columns, n, n) of a grid of tags: ids row by row from the top left (OpenCV's GridBoard)."""
    cells = tag_cells(family, first_id, columns * rows)
    return cells.reshape(rows, columns, *cells.shape[1:])


def charuco_grid(family: str, first_id: int, columns: int, rows: int) -> Cells:
    """Cells (rows, columns, n, n) of the tags of a ChArUco board, without ink in black squares.

    OpenCV's pattern since 4.6: the top-left square is black for any number of rows, and the white squares are numbered
    row by row.
    """
    row, column = np.mgrid[:rows, :columns]
    white = (row + column) % 2 == 1
    cells = tag_cells(family, first_id, int(white.sum()))
    grid = np.zeros((rows, columns, *cells.shape[1:]), dtype=np.uint8)
    grid[white] = cells
    return grid
