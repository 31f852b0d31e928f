"""The tracer's inverse of the lens, in float32, against the exact camera in float64."""

from typing import Any

import numpy as np
import pytest
from helpers_lenses import FISHEYE, OPENCV, K, image_grid, lens

from roundel.render.backend import start
from roundel.render.rays.undistort import directions, lens_numbers, undistorted
from roundel.scenes.camera.lens_fisheye import image_radius
from roundel.scenes.camera.model import Camera, denormalise, distort_normalised, folds_inside_image, ray_direction


@pytest.fixture(scope="module")
def mi() -> Any:
    return start()


def image_of_rays(mi: Any, camera: Camera, image: np.ndarray) -> np.ndarray:
    """Rays through image positions in float32, imaged again in float64."""
    import drjit as dr

    def number(value: float) -> Any:
        return dr.opaque(mi.Float, float(value))

    k, (u, v) = camera.K, image.T
    y = (mi.Float(v) - number(k[1, 2])) / number(k[1, 1])
    x = (mi.Float(u) - number(k[0, 2]) - number(k[0, 1]) * y) / number(k[0, 0])
    numbers = [number(value) for value in lens_numbers(camera)]
    if camera.distortion_model == "fisheye":
        ray = np.array(directions(dr, mi, numbers, x, y), dtype=np.float64).T
        np.testing.assert_allclose(np.linalg.norm(ray, axis=1), 1.0, atol=1e-6)  # float32
        across = np.hypot(ray[:, 0], ray[:, 1])
        theta = np.arctan2(across, ray[:, 2])
        radius = image_radius(camera.distortion, theta)[0]
        return denormalise(camera, ray[:, :2] * (radius / np.where(across > 0, across, 1.0))[:, None])
    pair = undistorted(dr, mi, camera.distortion_model, numbers, x, y)
    straight = np.array([np.array(value) for value in pair], dtype=np.float64).T
    return denormalise(camera, distort_normalised(camera, straight)[0])


@pytest.mark.parametrize("name", [*OPENCV, *FISHEYE])
def test_rays_are_those_of_the_exact_camera(mi: Any, name: str) -> None:
    camera = lens(name)
    image = image_grid(camera)
    # A float32 pixel coordinate of 1,280 has steps of 1.2e-4 px; a few roundings of that size are what is left.
    assert np.abs(image_of_rays(mi, camera, image) - image).max() < 5e-4


def test_random_cameras(mi: Any) -> None:
    rng = np.random.default_rng(5)
    spread = np.array([0.05, 0.05, 0.003, 0.003, 0.03, 0.05, 0.05, 0.03, 0.005, 0.005, 0.005, 0.005, 0.08, 0.08])
    done = 0
    while done < 12:
        base = np.array(OPENCV[("4", "5", "8", "12", "14")[done % 5]])
        c = tuple((base + spread[: len(base)] * rng.uniform(-1, 1, len(base))).tolist())
        camera = Camera(1280, 720, K, c)
        if folds_inside_image(camera):
            continue
        image = image_grid(camera, 33, 19)
        assert np.abs(image_of_rays(mi, camera, image) - image).max() < 1e-3
        done += 1


def test_the_edge_of_the_field(mi: Any) -> None:
    # r (1 - 0.225 r^2) ends at 0.811, and the image's farthest corner is at 0.809.
    camera = Camera(1280, 720, K, (-0.225, 0.0, 0.0, 0.0))
    assert not folds_inside_image(camera)
    image = image_grid(camera)
    assert np.abs(image_of_rays(mi, camera, image) - image).max() < 5e-4


def test_beyond_the_image_rays_are_finite(mi: Any) -> None:
    import drjit as dr

    for name in (*OPENCV, *FISHEYE):
        camera = lens(name)
        numbers = [dr.opaque(mi.Float, value) for value in lens_numbers(camera)]
        x, y = mi.Float(np.linspace(-3, 3, 50)), mi.Float(np.linspace(-2, 3, 50))
        if camera.distortion_model == "fisheye":
            assert np.isfinite(np.array(directions(dr, mi, numbers, x, y))).all()
        else:
            assert np.isfinite(np.array(undistorted(dr, mi, "opencv", numbers, x, y))).all()


def test_the_count_of_numbers_is_the_models() -> None:
    assert lens_numbers(Camera(1280, 720, K)) == ()
    assert lens_numbers(Camera(1280, 720, K, (0.0,) * 5)) == ()
    lengths = [len(lens_numbers(lens(name))) for name in ("4", "5", "8", "12", "14")]
    assert lengths == sorted(set(lengths))
    assert len(lens_numbers(lens("pincushion"))) == lengths[0]


def test_the_axis(mi: Any) -> None:
    import drjit as dr

    camera = lens("equidistant")
    numbers = [dr.opaque(mi.Float, value) for value in lens_numbers(camera)]
    ray = np.array(directions(dr, mi, numbers, mi.Float(0.0), mi.Float(0.0))).ravel()
    np.testing.assert_allclose(ray, ray_direction(camera, [640.2, 355.7]), atol=1e-7)
