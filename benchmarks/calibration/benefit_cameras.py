"""Cameras for `benefit.py`: phones of the table, and draws from the prior of an assumed camera."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera, folds_inside_image
from roundel.scenes.camera.phones import focal_lengths_mm, read_phones
from roundel.solver.intrinsics.specification import focal_px_of, parse_intrinsics, uncertain_camera_for
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera

SIZE = 640, 480


def prior(label: str = "default") -> UncertainCamera:
    """The assumed camera of a label."""
    return uncertain_camera_for(parse_intrinsics(label), None, *SIZE)


def phones(count: int, rng: np.random.Generator) -> list[Camera]:
    """Cameras with the focal lengths of different main cameras of phones, and a lens from the prior."""
    table = rng.permutation(focal_lengths_mm(read_phones(), "main"))
    return [_camera(float(focal), rng, focal_35mm=True) for focal in table[:count]]


def of_prior(count: int, rng: np.random.Generator) -> list[Camera]:
    """Cameras drawn from the prior of `default`, focal length included."""
    best = prior()
    drawn: list[Camera] = []
    while len(drawn) < count:
        focal_px = float(best.camera.K[0, 0]) * (1.0 + best.focal_sigma * rng.standard_normal())
        drawn.append(_camera(focal_px, rng))
    return drawn


def _camera(focal: float, rng: np.random.Generator, focal_35mm: bool = False) -> Camera:
    """Draw again until the lens's polynomial has an inverse in the whole image: others are no lenses."""
    best = prior()
    assert best.covariance is not None
    focal_px = focal_px_of(focal, *SIZE) if focal_35mm else focal
    while True:
        centre = best.camera.K[:2, 2] + best.principal_sigma_px * rng.standard_normal(2)
        lens = rng.standard_normal(4) * np.sqrt(np.diag(best.covariance)[4:])
        k = np.array([[focal_px, 0.0, centre[0]], [0.0, focal_px, centre[1]], [0.0, 0.0, 1.0]])
        camera = Camera(*SIZE, k, tuple(lens.tolist()), focal_35mm_mm=round(focal) if focal_35mm else None)
        if not folds_inside_image(camera):
            return camera


def section(camera: Camera) -> dict[str, object]:
    """The camera as a section of a study."""
    k = camera.K
    return {
        "width_px": camera.width_px,
        "height_px": camera.height_px,
        "focal_px": float(k[0, 0]),
        "principal_point_x_px": float(k[0, 2]),
        "principal_point_y_px": float(k[1, 2]),
        "distortion": list(camera.distortion),
    }


def disjoint(count: int, views: int) -> Sequence[NDArray[np.int64]]:
    """Positions of the views of each disjoint set of `count` of them."""
    return [np.arange(first, first + count) for first in range(0, views - count + 1, count)]
