"""Order of a grid's dots in an image: neighbours by the dots' own shapes, then the lattice that they span.

The ellipse of a dot is the local map from the board to the image, up to a rotation: in units of its own radii the
distance to its neighbours is that on the board, however the board is tilted. So neighbours are found by their distance
alone, and a walk from neighbour to neighbour numbers the dots; missing dots, others' dots and a bent image do not
matter. Asymmetric grids are square lattices, too, turned by 45 degrees.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from roundel.solver.calibration.grid_layout import GridLayout

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# Tolerance of a neighbour's distance, relative to the pitch: the next farther dots are at 1.41 of it, none is nearer.
_DISTANCE, _NEAREST = 0.18, 0.75
_PLACE = 0.3  # of its direction, in steps of the lattice
_SIZE = 1.5  # ratio of neighbours' radii: dots of a board differ by perspective alone


def lattice_of(shapes: Array, pitch_radii: float) -> tuple[Indices, Indices]:
    """The largest set of dots that a square lattice joins.

    Parameters
    ----------
    shapes : (n, 5) array
        Ellipses x, y, S11, S12, S22, px.
    pitch_radii : float
        Distance between neighbours on the board, in radii of a dot.

    Returns
    -------
    which : (m,) array
        The dots of the lattice; empty if no two are neighbours.
    place : (m, 2) array
        Their coordinates in steps of the lattice, from an arbitrary origin: the second axis is a quarter turn
        counterclockwise from the first, as seen by a reader of the board.
    """
    roots = np.stack([shapes[:, 2], shapes[:, 3], shapes[:, 3], shapes[:, 4]], axis=1).reshape(-1, 2, 2)
    neighbours = _neighbours(shapes[:, :2], roots, pitch_radii)
    best: dict[int, tuple[int, int]] = {}
    seen: set[int] = set()
    for seed in sorted(range(len(shapes)), key=lambda i: (-len(neighbours[i]), i)):
        if seed not in seen and neighbours[seed]:
            found = _walk(seed, shapes[:, :2], roots, neighbours)
            seen |= set(found)
            best = max(best, found, key=len)
    which = np.array(sorted(best), dtype=np.int64)
    return which, np.array([best[i] for i in which.tolist()], dtype=np.int64).reshape(-1, 2)


def _neighbours(centres: Array, roots: Array, pitch_radii: float) -> list[list[int]]:
    between = centres[None] - centres[:, None]
    radii = np.linalg.norm(np.einsum("iab,ijb->ija", np.linalg.inv(roots), between), axis=-1)
    # The mean of both ends' measures is exact to second order where the scale changes along the way.
    mean = (radii + radii.T) / 2
    area = np.sqrt(np.linalg.det(roots))
    alike = np.abs(np.log(area[:, None] / area[None])) < np.log(_SIZE)
    np.fill_diagonal(alike, False)
    near = alike & (np.abs(mean / pitch_radii - 1.0) < _DISTANCE)
    # A dot with others between it and its neighbours is of another grid.
    crowded = (alike & (mean / pitch_radii < _NEAREST)).any(axis=1)
    near &= ~(crowded[:, None] | crowded)
    return [np.flatnonzero(row).tolist() for row in near]


def _walk(seed: int, centres: Array, roots: Array, neighbours: list[list[int]]) -> dict[int, tuple[int, int]]:
    """Coordinates of all dots that can be reached from a seed, breadth first."""
    first = roots[seed] @ _turn(np.linalg.solve(roots[seed], centres[neighbours[seed][0]] - centres[seed]))
    steps = {seed: first}  # the images of the lattice's two steps, as columns
    place = {seed: (0, 0)}
    taken = {(0, 0)}
    queue = deque([seed])
    while queue:
        i = queue.popleft()
        for j in neighbours[i]:
            along = np.linalg.solve(steps[i], centres[j] - centres[i])
            whole = np.rint(along).astype(int)
            if np.abs(whole).sum() != 1 or np.abs(along - whole).max() > _PLACE:
                continue
            at = place[i][0] + int(whole[0]), place[i][1] + int(whole[1])
            if j in place or at in taken:
                continue
            place[j] = at
            taken.add(at)
            # Carried to the next dot by the change of shape, and corrected by the step just made.
            carried = roots[j] @ np.linalg.solve(roots[i], steps[i])
            axis = int(np.argmax(np.abs(whole)))
            carried[:, axis] = (centres[j] - centres[i]) * whole[axis]
            steps[j] = carried
            queue.append(j)
    return place


def _turn(step: Array) -> Array:
    """A step and its quarter turn, as columns: counterclockwise for a reader, with y down in the image."""
    return np.array([[step[0], step[1]], [step[1], -step[0]]])


def grid_places(place: Indices, centres_px: Array, layout: GridLayout) -> tuple[Indices, Indices]:
    """Where in a grid the dots of a lattice are.

    Of the placements that hold most dots (the grid's own symmetries, and shifts if its border is not seen) the one
    whose X axis points most to the right of the image is returned. All of them are as good for a calibration.

    Parameters
    ----------
    place : (m, 2) array
        From `lattice_of`.
    centres_px : (m, 2) array
    layout : GridLayout

    Returns
    -------
    which : (k,) array
        The dots inside the grid.
    index : (k,) array
        Their indices in `GridLayout.centres_m`.
    """
    grid = np.rint(layout.centres_m() / layout.spacing_m * 2).astype(np.int64)  # halves are whole
    grid = (grid - grid.min(axis=0)) // 2
    # An asymmetric grid's diagonal steps: (1, 0) of the lattice is (1, 1) of the grid.
    basis = np.array([[1, -1], [1, 1]]) if layout.asymmetric else np.eye(2, dtype=np.int64)
    table = np.full(grid.max(axis=0) + 1, -1)
    table[grid[:, 0], grid[:, 1]] = np.arange(len(grid))
    best: tuple[tuple[int, float], Indices, Indices] | None = None
    quarter = np.array([[0, -1], [1, 0]])
    turn = np.eye(2, dtype=np.int64)
    for _ in range(4):
        turn = quarter @ turn
        at = place @ (basis @ turn).T
        low, high = at.min(axis=0), at.max(axis=0)
        right = _rightward(at, centres_px)
        room = np.array(table.shape) - 1
        for shift_x in _shifts(low[0], high[0], room[0]):
            for shift_y in _shifts(low[1], high[1], room[1]):
                inside = at + np.array([shift_x, shift_y])
                on = ((inside >= 0) & (inside <= room)).all(axis=1)
                index = np.where(on, table[np.where(on, inside[:, 0], 0), np.where(on, inside[:, 1], 0)], -1)
                score = int(np.count_nonzero(index >= 0)), right
                if best is None or score > best[0]:
                    which = np.flatnonzero(index >= 0)
                    best = score, which, index[which]
    assert best is not None
    return best[1], best[2]


def _shifts(low: int, high: int, room: int) -> range:
    """Shifts that lose nothing if the dots fit, else those that fill the grid."""
    a, b = -int(low), int(room) - int(high)
    return range(min(a, b), max(a, b) + 1)


def _rightward(at: Indices, centres_px: Array) -> float:
    """How far right of the image's +x the X axis points, as its cosine; rounded, so that rounding decides no tie."""
    design = np.column_stack([at, np.ones(len(at))]).astype(np.float64)
    step = np.linalg.lstsq(design, centres_px, rcond=None)[0][0]
    return round(float(step[0] / max(np.hypot(*step), 1e-300)), 6)
