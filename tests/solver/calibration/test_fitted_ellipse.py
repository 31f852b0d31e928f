"""The ellipse of a distorted contour against the solver's own fit, and its derivative against differences."""

import numpy as np
from helpers_boards import GRID, GRID_CAMERA, fitted_shape, grid_contours, grid_pose

from roundel.solver.calibration.contour_model import CONTOUR_POINTS
from roundel.solver.calibration.fitted_ellipse import fitted_ellipses

TILTED = grid_pose(50.0, 30.0, 20.0, 0.03, -0.02, 0.3)


def test_agrees_with_the_fit_of_edge_points_on_contours_that_are_no_ellipses() -> None:
    # 1e-7 px is what 32 points leave of the periodic sums at this tilt.
    every = grid_contours(GRID_CAMERA, TILTED, GRID, CONTOUR_POINTS)
    expected = np.array([fitted_shape(c) for c in grid_contours(GRID_CAMERA, TILTED, GRID, 1024)])
    np.testing.assert_allclose(fitted_ellipses(every)[0], expected, atol=1e-7)


def test_an_exact_ellipse_is_returned() -> None:
    turn = 2 * np.pi * np.arange(CONTOUR_POINTS) / CONTOUR_POINTS
    s = np.array([[12.0, 3.0], [3.0, 5.0]])
    contour = np.array([100.0, 50.0]) + np.stack([np.cos(turn + 0.3), np.sin(turn + 0.3)], axis=1) @ s
    np.testing.assert_allclose(fitted_ellipses(contour[None])[0][0], [100.0, 50.0, 12.0, 3.0, 5.0], atol=1e-12)


def test_derivative_by_the_points() -> None:
    contour = grid_contours(GRID_CAMERA, TILTED, GRID, CONTOUR_POINTS)[:3]
    rng = np.random.default_rng(0)
    # Smooth changes: a point moved alone also changes the lengths, which the derivative takes as fixed.
    turn = 2 * np.pi * np.arange(CONTOUR_POINTS) / CONTOUR_POINTS
    waves = np.stack([np.ones_like(turn), np.cos(turn), np.sin(turn), np.cos(2 * turn), np.sin(2 * turn)])
    change = np.einsum("Nwi,wk->Nki", rng.normal(size=(3, 5, 2)), waves)
    _, slope = fitted_ellipses(contour)
    numeric = (fitted_ellipses(contour + 1e-4 * change)[0] - fitted_ellipses(contour - 1e-4 * change)[0]) / 2e-4
    # First order in the distances of the contour from its ellipse, which are some hundredths of a pixel of 15.
    np.testing.assert_allclose(np.einsum("Npki,Nki->Np", slope, change), numeric, atol=5e-3)
