"""Order of the dots: whatever the rotation, with dots missing, others in between, and strong perspective."""

import numpy as np
import pytest
from helpers_boards import ASYMMETRIC_GRID, GRID, GRID_CAMERA, grid_contours, grid_pose
from numpy.typing import NDArray

from roundel.solver.calibration.fitted_ellipse import fitted_ellipses
from roundel.solver.calibration.grid_layout import GridLayout
from roundel.solver.calibration.lattice import grid_places, lattice_of

Array = NDArray[np.float64]


def shapes_of(board_pose: Array, layout: GridLayout) -> Array:
    return fitted_ellipses(grid_contours(GRID_CAMERA, board_pose, layout, 32))[0]


def ordered(shapes: Array, layout: GridLayout) -> tuple[Array, Array]:
    """Dots that were placed, and their indices in the grid."""
    which, place = lattice_of(shapes, 2 * layout.pitch_m / layout.diameter_m)
    if not len(which):
        return which, which
    inside, index = grid_places(place, shapes[which, :2], layout)
    return which[inside], index


def half_turn(layout: GridLayout) -> Array:
    """Indices after a rotation of the board by 180 degrees."""
    centres = layout.centres_m()
    return np.array([int(np.argmin(np.linalg.norm(centres + c, axis=1))) for c in centres])


@pytest.mark.parametrize("layout", [GRID, ASYMMETRIC_GRID], ids=["symmetric", "asymmetric"])
@pytest.mark.parametrize("tilt", [0.0, 30.0, 60.0])
@pytest.mark.parametrize("roll", np.linspace(0, 345, 12))
def test_every_dot_has_its_place(layout: GridLayout, tilt: float, roll: float) -> None:
    shapes = shapes_of(grid_pose(tilt, 70.0, roll, 0.0, 0.0, 0.4), layout)
    mixed = np.random.default_rng(0).permutation(len(shapes))
    which, index = ordered(shapes[mixed], layout)
    truth = mixed[which]
    assert len(which) == len(shapes)
    if layout is ASYMMETRIC_GRID:  # an odd number of rows: the orientation is unique
        np.testing.assert_array_equal(index, truth)
    else:
        assert np.array_equal(index, truth) or np.array_equal(index, half_turn(layout)[truth])


@pytest.mark.parametrize("layout", [GRID, ASYMMETRIC_GRID], ids=["symmetric", "asymmetric"])
def test_missing_dots_leave_the_others_in_place(layout: GridLayout) -> None:
    rng = np.random.default_rng(1)
    for trial in range(50):
        shapes = shapes_of(grid_pose(rng.uniform(0, 50), rng.uniform(0, 360), rng.uniform(0, 360), 0, 0, 0.4), layout)
        seen = np.sort(rng.permutation(len(shapes))[: int(0.8 * len(shapes))])
        which, index = ordered(shapes[seen], layout)
        truth = seen[which]
        assert len(which) >= 0.7 * len(seen), trial
        # Up to shifts by missing rows and the grid's own symmetries the steps between dots are right.
        moved = layout.centres_m()[index] - layout.centres_m()[index[0]]
        true = layout.centres_m()[truth] - layout.centres_m()[truth[0]]
        quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
        turns = [np.linalg.matrix_power(quarter, k) for k in range(4)]
        assert min(np.abs(moved - true @ turn.T).max() for turn in turns) < 1e-12, trial


def test_other_circles_do_not_matter() -> None:
    shapes = shapes_of(grid_pose(30.0, 10.0, 5.0, 0.0, 0.0, 0.4), GRID)
    rng = np.random.default_rng(3)
    size = 0.4 * np.sqrt(shapes[:, 2] * shapes[:, 4]).mean()
    others = np.column_stack([rng.uniform(0, 640, 40), rng.uniform(0, 480, 40), np.tile([size, 0.0, size], (40, 1))])
    which, index = ordered(np.concatenate([others, shapes]), GRID)
    np.testing.assert_array_equal(which - 40, np.arange(30))
    np.testing.assert_array_equal(np.sort(index), np.arange(30))


def test_a_mirrored_grid_is_not_turned_over() -> None:
    shapes = shapes_of(grid_pose(20.0, 10.0, 5.0, 0.0, 0.0, 0.4), ASYMMETRIC_GRID)
    mirrored = shapes * np.array([-1.0, 1.0, 1.0, -1.0, 1.0]) + np.array([639.0, 0, 0, 0, 0])
    which, index = ordered(mirrored, ASYMMETRIC_GRID)
    board, image = ASYMMETRIC_GRID.centres_m()[index], mirrored[which, :2]
    design = np.column_stack([board, np.ones(len(board))])
    linear = np.linalg.lstsq(design, image, rcond=None)[0][:2]
    assert np.linalg.det(linear) < 0  # y is down in the image, up on the board


@pytest.mark.parametrize("ratio", [0.5, 1.5, 2.0])
def test_dots_of_another_size_are_another_grid(ratio: float) -> None:
    shapes = shapes_of(grid_pose(20.0, 10.0, 5.0, 0.0, 0.0, 0.4), GRID)
    which, _ = lattice_of(shapes, ratio * 2 * GRID.pitch_m / GRID.diameter_m)
    assert len(which) < 6
