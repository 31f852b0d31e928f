"""What the photographs of a board cover: the image, and the directions in which the board was tilted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.validate.photo_calibration.record import BoardPhoto

Array = NDArray[np.float64]

COLUMNS, ROWS = 6, 6  # two by two in a ninth of the image
_LEAST_OF_NINTH = 2  # cells with a point, of four
# Photographs below are too few for a covariance that can be relied on; five would determine a camera.
ENOUGH_PHOTOGRAPHS = 10
# Tilts below determine little of the focal length.
TILTED_DEG = 15.0
_ROW_NAMES, _COLUMN_NAMES = ("upper", "middle", "lower"), ("left", "middle", "right")
# In the image: the side of the board that is farther from the camera.
_SIDES = ("right", "lower", "left", "upper")


@dataclass(frozen=True, eq=False)
class Coverage:
    """Coverage of the image by the points of boards.

    Attributes
    ----------
    counts : (ROWS, COLUMNS) array of int
        Points in each cell of the image.
    empty : tuple of str
        Ninths of the image, by name, of which three cells of four or all have no point.
    missing_tilts : tuple of str
        Sides of the board that are turned away in no photograph; empty if no pose is known.
    largest_tilt_deg : float
        NaN if no pose is known.
    """

    counts: NDArray[np.int64]
    empty: tuple[str, ...]
    missing_tilts: tuple[str, ...]
    largest_tilt_deg: float

    @property
    def share(self) -> float:
        """Fraction of the cells with a point."""
        return float(np.mean(self.counts > 0))


def coverage_of(photos: Sequence[BoardPhoto], size_px: tuple[int, int]) -> Coverage:
    """Coverage by photographs that show the board.

    Parameters
    ----------
    photos : sequence of BoardPhoto
        Of one size.
    size_px : (int, int)
    """
    pixels = np.concatenate([np.empty((0, 2)), *[photo.pixels for photo in photos]])
    counts = _cells(pixels, size_px)
    ninths = np.count_nonzero(counts.reshape(3, ROWS // 3, 3, COLUMNS // 3), axis=(1, 3))
    empty = tuple(_ninth(int(r), int(c)) for r, c in np.argwhere(ninths < _LEAST_OF_NINTH))
    posed = [photo for photo in photos if photo.camera_from_board is not None]
    tilts = [photo.tilt_deg for photo in posed]
    sides = {side for photo, tilt in zip(posed, tilts, strict=True) if tilt >= TILTED_DEG for side in _away(photo)}
    missing = tuple(_SIDES[i] for i in range(4) if i not in sides) if posed else ()
    return Coverage(counts, empty, missing, max(tilts, default=np.nan))


def _cells(pixels: Array, size_px: tuple[int, int]) -> NDArray[np.int64]:
    cell = np.floor((pixels + 0.5) / np.array(size_px, dtype=np.float64) * np.array([COLUMNS, ROWS])).astype(int)
    cell = np.clip(cell, 0, [COLUMNS - 1, ROWS - 1])
    return np.bincount(cell[:, 1] * COLUMNS + cell[:, 0], minlength=COLUMNS * ROWS).reshape(ROWS, COLUMNS)


def _ninth(row: int, column: int) -> str:
    if row == column == 1:
        return "the middle"
    words = [_ROW_NAMES[row] if row != 1 else "", _COLUMN_NAMES[column] if column != 1 else ""]
    place = " ".join(word for word in words if word)
    return f"the {place} {'corner' if row != 1 and column != 1 else 'edge'}"


def _away(photo: BoardPhoto) -> set[int]:
    """Sides, as indices of `_SIDES`, in whose direction the board recedes; two for a corner."""
    assert photo.camera_from_board is not None
    # The normal (a column of the rotation) points to the camera, and leans toward the side that recedes.
    x, y, z = photo.camera_from_board[:3, 2]
    turn = np.degrees(np.arctan2(y, x) if z < 0 else np.arctan2(-y, -x))
    return {i for i in range(4) if abs((turn - 90.0 * i + 180.0) % 360.0 - 180.0) < 60.0}


def coverage_lines(coverage: Coverage, count: int) -> list[str]:
    """What the photographs lack, as orders; empty if nothing."""
    lines = []
    if count < ENOUGH_PHOTOGRAPHS:
        more = ENOUGH_PHOTOGRAPHS - count
        lines.append(
            f"take at least {more} more photograph{'' if more == 1 else 's'} that show{'s' * (more == 1)} the board"
        )
    if coverage.empty and count:
        lines.append(f"little or nothing of the board lies in {_listed(coverage.empty)} of the picture: show it there")
    if coverage.largest_tilt_deg < TILTED_DEG:
        lines.append(
            f"the board is tilted by {coverage.largest_tilt_deg:.0f} degrees at most: tilt it by 20 to 45 degrees, "
            "each time with a different side away from you"
        )
    elif coverage.missing_tilts:
        sides = _listed(tuple(f"its {side} side" for side in coverage.missing_tilts), "or")
        lines.append(f"no photograph shows the board with {sides} away from you, tilted by 20 to 45 degrees")
    return lines


def _listed(words: Sequence[str], last: str = "and") -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {last} {words[-1]}"
