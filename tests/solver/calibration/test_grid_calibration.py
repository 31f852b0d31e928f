"""Calibration from dots: exact data, honest covariances, and views that determine nothing."""

from dataclasses import replace

import numpy as np
import pytest
from helpers_boards import ASYMMETRIC_GRID, GRID, GRID_CAMERA, exact_dots, grid_pose, grid_poses

from roundel.scenes.camera.model import Camera
from roundel.scenes.errors import NotComparableError
from roundel.solver.calibration.contour_model import Dots
from roundel.solver.calibration.grid_calibration import GridCalibration, calibrate_dots
from roundel.solver.calibration.grid_layout import GridLayout

SIZE = GRID_CAMERA.width_px, GRID_CAMERA.height_px
TRUE = np.array([700.0, 703.0, 322.0, 236.0, *GRID_CAMERA.distortion])


def values(found: GridCalibration) -> np.ndarray:
    k = found.camera.K
    return np.array([k[0, 0], k[1, 1], k[0, 2], k[1, 2], *found.camera.distortion])


@pytest.mark.parametrize("layout", [GRID, ASYMMETRIC_GRID], ids=["symmetric", "asymmetric"])
def test_exact_dots_give_the_camera(layout: GridLayout) -> None:
    found = calibrate_dots(exact_dots(GRID_CAMERA, grid_poses(5), layout), 1.1 * layout.diameter_m, SIZE)
    np.testing.assert_allclose(values(found), TRUE, rtol=1e-6)
    assert found.diameter_m == pytest.approx(layout.diameter_m, rel=1e-6)
    np.testing.assert_allclose(found.poses, grid_poses(5), atol=1e-8)
    assert found.rms_px < 1e-6
    assert found.widened == 1
    assert (found.used, found.left_out, found.views) == (5 * len(layout.centres_m()), 0, [0, 1, 2, 3, 4])


def test_five_coefficients() -> None:
    camera = replace(GRID_CAMERA, distortion=(-0.25, 0.08, 1e-3, -5e-4, 0.03))
    found = calibrate_dots(exact_dots(camera, grid_poses(6), GRID), GRID.diameter_m, SIZE, 5)
    np.testing.assert_allclose(found.camera.distortion, camera.distortion, rtol=1e-5)
    assert found.parameters[8] == "k3"
    with pytest.raises(ValueError, match="4 or 5"):
        calibrate_dots(exact_dots(camera, grid_poses(3), GRID), GRID.diameter_m, SIZE, 8)


def test_ellipses_in_the_coordinates_of_an_earlier_lens_give_the_same() -> None:
    lens = Camera(*SIZE, np.array([[690.0, 0.0, 320.0], [0.0, 690.0, 240.0], [0.0, 0.0, 1.0]]), (-0.2, 0.05, 0.0, 0.0))
    from roundel.solver.calibration.contour_model import Model, predicted_shapes

    dots = replace(exact_dots(GRID_CAMERA, grid_poses(5), GRID), lens=lens)
    dots = replace(dots, shape=predicted_shapes(Model(GRID_CAMERA, GRID.diameter_m, np.array(grid_poses(5))), dots)[0])
    np.testing.assert_allclose(values(calibrate_dots(dots, GRID.diameter_m, SIZE)), TRUE, rtol=1e-6)


def noisy(dots: Dots, rng: np.random.Generator) -> Dots:
    root = np.linalg.cholesky(dots.shape_cov)
    return replace(dots, shape=dots.shape + np.einsum("Nij,Nj->Ni", root, rng.normal(size=dots.shape.shape)))


@pytest.mark.slow
def test_standard_deviations_are_those_of_the_results() -> None:
    exact = exact_dots(GRID_CAMERA, grid_poses(6), GRID, 0.02)
    rng = np.random.default_rng(4)
    runs = [calibrate_dots(noisy(exact, rng), GRID.diameter_m, SIZE) for _ in range(60)]
    errors = np.array([(values(r) - TRUE) / np.sqrt(np.diag(r.covariance))[:8] for r in runs])
    # 60 runs: a standard deviation scatters by 9 %, a mean by 13 % of it; four of them for each of eight parameters.
    np.testing.assert_allclose(errors.std(axis=0), 1.0, atol=0.37)
    np.testing.assert_allclose(errors.mean(axis=0), 0.0, atol=0.52)
    assert np.mean([r.chi_square for r in runs]) == pytest.approx(1.0, abs=0.05)
    assert np.mean([r.widened > 1 for r in runs]) < 0.1


def test_wrong_dots_are_left_out() -> None:
    dots = noisy(exact_dots(GRID_CAMERA, grid_poses(5), GRID, 0.02), np.random.default_rng(0))
    shape = dots.shape.copy()
    shape[[7, 40, 99], 0] += 3.0
    found = calibrate_dots(replace(dots, shape=shape), GRID.diameter_m, SIZE)
    assert found.left_out == 3
    assert np.all(np.abs(values(found) - TRUE) < 5 * np.sqrt(np.diag(found.covariance))[:8])


def test_a_bent_board_widens_the_standard_deviations() -> None:
    flat = noisy(exact_dots(GRID_CAMERA, grid_poses(6), GRID, 0.02), np.random.default_rng(0))
    bent = exact_dots(GRID_CAMERA, grid_poses(6), GRID, 0.02, rise=lambda x, y: 0.001 * (x / 0.09) ** 2)
    assert calibrate_dots(flat, GRID.diameter_m, SIZE).widened == 1
    found = calibrate_dots(noisy(bent, np.random.default_rng(0)), GRID.diameter_m, SIZE)
    assert found.widened > 3


def test_a_bent_board_is_fitted() -> None:
    bent = exact_dots(GRID_CAMERA, grid_poses(6), GRID, 0.02, rise=lambda x, y: (0.4 * x - 0.2 * y) * x + 20.0 * y**3)
    found = calibrate_dots(bent, GRID.diameter_m, SIZE, bend=3)
    np.testing.assert_allclose(values(found), TRUE, rtol=1e-6)
    half_m = 0.075
    expected = [0.4 * half_m**2, -0.2 * half_m**2, 0.0, 0.0, 0.0, 0.0, 20.0 * half_m**3]
    np.testing.assert_allclose(found.bend_m, expected, atol=1e-8)
    assert found.parameters[10:12] == ("bend_x2y0_m", "bend_x1y1_m")
    with pytest.raises(ValueError, match="bend must be 0 or an order from 2 to 6, not 1"):
        calibrate_dots(bent, GRID.diameter_m, SIZE, bend=1)


def test_frontal_views_do_not_determine_the_focal_length() -> None:
    frontal = [grid_pose(0.0, 0.0, roll, x, 0.0, z) for roll, x, z in ((0, 0, 0.4), (40, 0.01, 0.45), (90, -0.02, 0.5))]
    with pytest.raises(NotComparableError, match=r"determine the focal length .* tilted by 0 degrees at most; tilt it"):
        calibrate_dots(noisy(exact_dots(GRID_CAMERA, frontal, GRID, 0.02), np.random.default_rng(0)), 0.018, SIZE)


def test_views_of_two_cameras_are_none_of_one() -> None:
    zoomed = replace(GRID_CAMERA, K=GRID_CAMERA.K * np.array([[1.3], [1.3], [1.0]]))
    near, far = (
        exact_dots(GRID_CAMERA, grid_poses(3), GRID, 0.02),
        exact_dots(zoomed, grid_poses(3, 1, 0.55), GRID, 0.02),
    )
    both = Dots(
        np.concatenate([near.view, far.view + 3]),
        *(np.concatenate([getattr(near, n), getattr(far, n)]) for n in ("centre_m", "shape", "shape_cov")),
    )
    with pytest.raises(NotComparableError, match=r"all views need one board, flat, and one camera with the same zoom"):
        calibrate_dots(both, GRID.diameter_m, SIZE)


def test_two_views_are_too_few() -> None:
    with pytest.raises(NotComparableError, match="found in 2 of 2 views; a calibration needs 3"):
        calibrate_dots(exact_dots(GRID_CAMERA, grid_poses(2), GRID), GRID.diameter_m, SIZE)
