"""What other processes compile at the first compilation: they run the fits of a drawn disc.

`roundel.solver.compilation.first_compilation` starts them. A share that misses a kernel only costs time.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.geometry.conic import ellipse_points
from roundel.solver.compilation.first_compilation import compile_alone
from roundel.solver.fit.band_pixels import place_pixels
from roundel.solver.fit.edge_fit import fit_edges
from roundel.solver.fit.edges import EdgePoints, edge_points
from roundel.solver.fit.pixel_fit import fit_pixels
from roundel.solver.fit.row_motion import RowMotion
from roundel.solver.kernels.contour_pixels import COLUMNS
from roundel.solver.photometry.curve_evidence import curve_evidence
from roundel.solver.photometry.edge_levels import clipped_fraction, overshoots, side_levels

Array = NDArray[np.float64]

_ELLIPSE = np.array([63.2, 47.6, 36.0, 30.0, 0.0])
_WHITE_DN, _BLACK_DN = 200.0, 50.0


def compile_shares(names: Sequence[str]) -> None:
    """Compile the kernels of some shares: `contours`, `levels` or `fits`."""
    compile_alone()
    gc.disable()  # a short life with many objects: a tenth of the time
    for name in names:
        _SHARES[name]()


def drawn_disc() -> NDArray[np.uint8]:
    """A small image (96, 128) of a dark disc, foreshortened."""
    y, x = np.mgrid[:96, :128]
    radius = np.hypot((x - _ELLIPSE[0]) * _ELLIPSE[3] / _ELLIPSE[2], y - _ELLIPSE[1])
    inside = np.clip(_ELLIPSE[3] + 0.5 - radius, 0.0, 1.0)
    return np.asarray(np.rint(_WHITE_DN + (_BLACK_DN - _WHITE_DN) * inside), dtype=np.uint8)


def _contours() -> None:
    edge_points(drawn_disc().astype(np.float32), _ELLIPSE, polish=False)


def _levels() -> None:
    image, edges = drawn_disc().astype(np.float32), _edges()
    curve_evidence(image, [edges], 255.0)
    side_levels(image, edges)
    clipped_fraction(image, edges, 255.0)
    overshoots(image, edges)
    fit_edges(edges.points_px, edges.sigma_px)


def _fits() -> None:
    image, edges = drawn_disc().astype(np.float32), _edges()
    fit_pixels(image, edges)
    # What only some images need.
    place_pixels(np.ones((8, COLUMNS)), _ELLIPSE, None)
    fit_pixels(image, edges, motion=RowMotion(1e-5, np.eye(5)))


def _edges() -> EdgePoints:
    """The disc's contour, without the kernels that find it."""
    count = 96
    return EdgePoints(
        ellipse_points(_ELLIPSE, count),
        np.full(count, 0.02),
        _ELLIPSE,
        0.4,
        _WHITE_DN - _BLACK_DN,
        0.3,
        1.0,
        np.ones(count, np.bool_),
        (-3.0, 3.0),
    )


_SHARES: dict[str, Callable[[], None]] = {"contours": _contours, "levels": _levels, "fits": _fits}
