import numpy as np
import pytest
from helpers_prints import drawn, plane_homography, small_view

from roundel.solver.views.disc_coverage import coverage_of
from roundel.solver.views.homography_pose import moved

ROWS, COLUMNS = np.mgrid[:96, :96]
PLACES = np.stack([COLUMNS.ravel(), ROWS.ravel()], axis=1).astype(np.float64)


@pytest.mark.parametrize("disc", [(0.0, 0.0, 1.0), (0.3, 0.5, 0.105), (-0.8, 0.1, 0.14), (0.0, 0.0, 0.4)])
@pytest.mark.parametrize("blur_px", [0.4, 0.8])
def test_coverage_is_that_of_a_supersampled_drawing(disc: tuple[float, float, float], blur_px: float) -> None:
    pose, K = small_view(np.random.default_rng(8), tilt_deg=(50.0, 60.0))
    matrix = plane_homography(pose, K)
    shape = np.array([disc])
    image = drawn((96, 96), matrix, shape, np.ones(1), blur_px, paper=0.0, ink=1.0, fine=24)
    covered = coverage_of(PLACES, matrix, shape, blur_px**2).covered[:, 0]
    # The drawing's steps of 1/24 px leave up to 0.006 (0.014 with steps of 1/12, 0.002 with 1/48).
    assert np.abs(covered - image.ravel()).max() < 8e-3


@pytest.mark.parametrize("disc", [(0.3, 0.5, 0.105), (-0.8, 0.1, 0.14)])
def test_derivatives_of_small_discs_are_those_of_differences(disc: tuple[float, float, float]) -> None:
    pose, K = small_view(np.random.default_rng(9))
    matrix, shape, variance, step = plane_homography(pose, K), np.array([disc]), 0.3, 1e-5
    here = coverage_of(PLACES, matrix, shape, variance)

    def close(found: np.ndarray, ahead: np.ndarray, behind: np.ndarray) -> None:
        numeric = (ahead - behind) / (2 * step)
        # The nodes move with the disc: a ten-thousandth of the steepest is in the differences alone.
        np.testing.assert_allclose(found, numeric, atol=2e-4 * np.abs(numeric).max())

    for k, e in enumerate(step * np.eye(8)):
        ahead, behind = (coverage_of(PLACES, moved(matrix, s * e), shape, variance).covered[:, 0] for s in (1, -1))
        close(here.by_generator[:, 0, k], ahead, behind)
    for k in range(2):
        move = np.eye(3)
        move[k, 2] = step
        ahead = coverage_of(PLACES, move @ matrix, shape, variance).covered[:, 0]
        behind = coverage_of(PLACES, np.linalg.inv(move) @ matrix, shape, variance).covered[:, 0]
        close(here.by_shift[:, 0, k], ahead, behind)
    ahead, behind = (coverage_of(PLACES, matrix, shape, variance + s * step).covered[:, 0] for s in (1, -1))
    close(here.by_variance[:, 0], ahead, behind)


def test_derivatives_of_an_edge_are_those_of_differences_at_the_edge() -> None:
    # Away from the edge, where little is left of them, they are those of a straight edge.
    pose, K = small_view(np.random.default_rng(10), tilt_deg=(0.0, 30.0))
    matrix, shape, variance, step = plane_homography(pose, K), np.array([[0.0, 0.0, 1.0]]), 0.3, 1e-5
    here = coverage_of(PLACES, matrix, shape, variance)
    for k, e in enumerate(step * np.eye(8)):
        ahead, behind = (coverage_of(PLACES, moved(matrix, s * e), shape, variance).covered[:, 0] for s in (1, -1))
        numeric = (ahead - behind) / (2 * step)
        np.testing.assert_allclose(here.by_generator[:, 0, k], numeric, atol=0.06 * max(np.abs(numeric).max(), 1.0))
