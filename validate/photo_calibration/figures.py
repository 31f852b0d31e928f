"""Figures of a calibration: which parts of the image the board covered, and what the camera does not explain."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from roundel.validate.figures.svg import INK, Picture, colour, draw_svg
from roundel.validate.photo_calibration.coverage import coverage_of
from roundel.validate.photo_calibration.record import PhotoCalibration

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

_COLUMNS, _ROWS = 8, 6
# Of a page that stays small; the others are like them.
_MOST_ARROWS = 1500
# Points of a cell of which the mean says something.
_LEAST_POINTS = 4


def coverage_picture(found: PhotoCalibration) -> Picture:
    """Where the points of all boards lie, and the cells of the image that have none."""
    width, height = found.size_px
    coverage = coverage_of(found.shown, found.size_px)
    rows, columns = coverage.counts.shape

    def draw(figure: Figure) -> None:
        from matplotlib.patches import Rectangle

        at = figure.subplots()
        for row, column in np.argwhere(coverage.counts == 0).tolist():
            corner = (column * width / columns - 0.5, row * height / rows - 0.5)
            at.add_patch(
                Rectangle(corner, width / columns, height / rows, facecolor=colour(1), alpha=0.16, linewidth=0)
            )
        for i, photo in enumerate(found.shown):
            at.plot(*photo.pixels.T, ls="none", marker="o", ms=2.2, color=colour(i), mec="none", alpha=0.8)
        _frame(at, width, height)
        at.set_xticks(np.arange(columns + 1) * width / columns - 0.5, minor=False)
        at.set_yticks(np.arange(rows + 1) * height / rows - 0.5, minor=False)
        at.set_xticklabels([])
        at.set_yticklabels([])

    caption = (
        "Coverage of the image: every point of every board, in one colour for each photograph. "
        f"{100 * coverage.share:.0f} % of the {columns} by {rows} cells have a point; those without one are shaded."
    )
    return Picture("coverage", caption, draw_svg("coverage", caption, _size(width, height), draw))


def residual_picture(found: PhotoCalibration) -> Picture:
    """What the camera does not explain: the residual of every point, and its mean over cells of the image."""
    width, height = found.size_px
    pixels = np.concatenate([photo.pixels for photo in found.used])
    residual = np.concatenate([photo.residual_px for photo in found.used])
    few = np.linspace(0, len(pixels) - 1, min(len(pixels), _MOST_ARROWS)).astype(int)
    # Three quarters of a cell for the largest but one in a hundred.
    longest = float(np.percentile(np.linalg.norm(residual, axis=-1), 99))
    scale = 0.75 * width / _COLUMNS / max(longest, 1e-9)
    scale = float(f"{scale:.1g}")
    places, means = cell_means(pixels, residual, (width, height))

    def draw(figure: Figure) -> None:
        at = figure.subplots()
        style: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1.0 / scale, "headwidth": 4}
        thin = at.quiver(*pixels[few].T, *residual[few].T, color=colour(0), alpha=0.55, width=0.0014, **style)
        if len(places):
            at.quiver(*places.T, *means.T, color=colour(1), width=0.004, **style)
        length = float(f"{longest / 2:.1g}")
        at.quiverkey(thin, 0.88, 0.95, length, f"{length:g} px", labelpos="S", coordinates="axes", color=INK)
        _frame(at, width, height)
        at.set_xticks([])
        at.set_yticks([])

    caption = (
        f"Residuals, measured minus predicted, magnified {scale:g} times (blue), and their means over cells of the "
        f"image (orange). RMS {found.rms_px:.3f} px. Long orange arrows that turn or grow over the image show what the "
        "lens model does not describe; without them, the residuals are noise."
    )
    return Picture("residuals", caption, draw_svg("residuals", caption, _size(width, height), draw))


def cell_means(pixels: Array, residual: Array, size_px: tuple[int, int]) -> tuple[Array, Array]:
    """Centres of the cells of the image with enough points, and the mean residual of each, (n, 2)."""
    shape = np.array([_COLUMNS, _ROWS])
    side = np.array(size_px, dtype=np.float64) / shape
    cell = np.clip(np.floor((pixels + 0.5) / side).astype(int), 0, shape - 1)
    number = cell[:, 1] * _COLUMNS + cell[:, 0]
    counts = np.bincount(number, minlength=_COLUMNS * _ROWS)
    sums = np.stack([np.bincount(number, residual[:, i], _COLUMNS * _ROWS) for i in (0, 1)], axis=-1)
    enough = np.flatnonzero(counts >= _LEAST_POINTS)
    row, column = np.divmod(enough, _COLUMNS)
    centres = (np.stack([column, row], axis=-1) + 0.5) * side - 0.5
    return centres, sums[enough] / counts[enough, None]


def _size(width: int, height: int) -> tuple[float, float]:
    wide = 5.6 if width >= height else 3.6
    return wide, wide * height / width + 0.2


def _frame(at: Any, width: int, height: int) -> None:
    at.set_xlim(-0.5, width - 0.5)
    at.set_ylim(height - 0.5, -0.5)
    at.set_aspect("equal")
    for side in at.spines.values():
        side.set_visible(True)
