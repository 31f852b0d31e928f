import numpy as np
import pytest
from helpers_prints import drawn, plane_homography, small_view

from roundel.scenes.markers.dot_codes import dots_of
from roundel.solver.views.disc_pattern import Pixels, fit_pattern
from roundel.solver.views.homography_pose import coordinates, moved

ROWS, COLUMNS = np.mgrid[:96, :96]
PLACES = np.stack([COLUMNS.ravel(), ROWS.ravel()], axis=1).astype(np.float64)


@pytest.mark.parametrize("identity", [0, 21])
def test_a_drawn_print_is_fitted_to_a_thousandth_of_a_pixel(identity: int) -> None:
    rng = np.random.default_rng(identity)
    pose, K = small_view(rng)
    matrix, dots = plane_homography(pose, K), dots_of(identity)
    levels = drawn((96, 96), matrix, dots, np.ones(len(dots)), 0.6)
    start = moved(matrix, rng.normal(0, 0.02, 8))
    fit = fit_pattern(Pixels(PLACES, levels.ravel()), start, dots, np.ones(len(dots)), 0.2, turns=True)
    assert fit is not None
    assert fit.describes(0.0)
    # Coordinates are in outer radii: 20 px and more.
    assert np.abs(coordinates(matrix, fit.homography.matrix, turns=True)).max() * 20 < 5e-3
    assert fit.variance == pytest.approx(0.36, abs=0.01)
    assert fit.contrast_dn == pytest.approx(188.0, rel=0.01)


def test_the_stated_covariance_is_that_of_noisy_copies() -> None:
    rng = np.random.default_rng(5)
    pose, K = small_view(rng, tilt_deg=(30.0, 40.0))
    matrix, dots = plane_homography(pose, K), dots_of(7)
    clean = drawn((96, 96), matrix, dots, np.ones(len(dots)), 0.6)
    squares = []
    for _ in range(60):
        # Lighter pixels are noisier, as photons make them.
        levels = clean + rng.normal(0, 1, clean.shape) * np.sqrt(clean) / 2
        fit = fit_pattern(Pixels(PLACES, levels.ravel()), matrix, dots, np.ones(len(dots)), 0.36, turns=True)
        assert fit is not None
        error = coordinates(matrix, fit.homography.matrix, turns=True)
        squares.append(float(error @ np.linalg.solve(fit.homography.cov, error)))
    # The mean of 60 values of chi2 with 8 degrees of freedom: 8 +- 0.5.
    assert 6.4 < np.mean(squares) < 10.0


def test_another_print_is_not_described() -> None:
    pose, K = small_view(np.random.default_rng(6))
    matrix, dots, others = plane_homography(pose, K), dots_of(7), dots_of(8)
    levels = drawn((96, 96), matrix, dots, np.ones(len(dots)), 0.6)
    fit = fit_pattern(Pixels(PLACES, levels.ravel()), matrix, others, np.ones(len(others)), 0.36, turns=True)
    assert fit is None or not fit.describes(0.0)
