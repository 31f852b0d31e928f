import numpy as np
import pytest
from helpers_prints import drawn, plane_homography, small_view

from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic
from roundel.scenes.markers.dot_codes import dots_of
from roundel.scenes.markers.ring_codes import ring_code_radii
from roundel.solver.views.ink_blobs import ink_blobs, ink_outlines


def ellipses_of(pose: np.ndarray, K: np.ndarray, dots: np.ndarray) -> np.ndarray:
    out = []
    for x, y, r in dots:
        about = pose.copy()
        about[:3, 3] += pose[:3, 0] * x + pose[:3, 1] * y
        out.append(ellipse_of_conic(conic_of_circle(about, r, K)))
    return np.array(out)


@pytest.mark.parametrize("light", [False, True])
@pytest.mark.parametrize("blur_px", [0.4, 0.8])
def test_blobs_are_the_dots_with_their_shape_and_the_blur(light: bool, blur_px: float) -> None:
    pose, K = small_view(np.random.default_rng(1), semi_px=(28.0, 30.0), tilt_deg=(30.0, 40.0))
    dots = dots_of(11)
    levels = drawn((96, 96), plane_homography(pose, K), dots, np.ones(len(dots)), blur_px)
    blobs = ink_blobs(255.0 - levels if light else levels, 0.0, light)
    expected = ellipses_of(pose, K, dots)
    assert len(blobs.centre) == len(dots)
    away = np.linalg.norm(blobs.centre[:, None] - expected[None, :, :2], axis=2)
    match = away.argmin(axis=1)
    assert sorted(match.tolist()) == list(range(len(dots)))
    # Weights below a twentieth are cut, the darkest pixel is taken for pure ink, and neighbours' flanks reach across.
    assert away.min(axis=1).max() < 0.15
    np.testing.assert_allclose(blobs.size, np.sqrt(expected[match, 2] * expected[match, 3]), rtol=0.06)
    assert np.median(blobs.variance) == pytest.approx(blur_px**2 + 1 / 12, abs=0.15)


def test_noise_is_no_blob_and_no_outline() -> None:
    levels = np.random.default_rng(2).normal(180.0, 4.0, (200, 300))
    assert len(ink_blobs(levels, 4.0).centre) == 0
    assert ink_outlines(levels, 4.0) == []


@pytest.mark.parametrize("tilt", [10.0, 62.0])
@pytest.mark.parametrize("light", [False, True])
def test_the_outline_of_crowns_is_their_outer_circle(tilt: float, light: bool) -> None:
    pose, K = small_view(np.random.default_rng(3), semi_px=(20.0, 22.0), tilt_deg=(tilt, tilt))
    radii = ring_code_radii(3)
    discs = np.array([[0.0, 0.0, r] for r in radii])
    levels = drawn((96, 96), plane_homography(pose, K), discs, np.array([1.0, -1.0] * 3))
    found = ink_outlines(255.0 - levels if light else levels, 0.0, light)
    expected = ellipse_of_conic(conic_of_circle(pose, 1.0, K))
    assert min(np.abs(ellipse[:4] - expected[:4]).max() for ellipse in found) < 0.5
