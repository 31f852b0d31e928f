"""Random scenes of circles in one plane, with their exact images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.geometry.conic import (
    conic_of_circle,
    ellipse_of_conic,
    ellipse_perimeter_px,
    ellipse_points,
    vanishing_line,
)
from roundel.scenes.geometry.pose import camera_from_marker_of, normal_of
from roundel.solver.fit.ellipse import EllipseFit, fit_ellipse

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CircleScene:
    """Circles of one plane.

    `conics` (n, 3, 3) and `centre_px` (n, 2) are their images, `line` (3,) the vanishing line of the plane, `poses`
    (n, 4, 4) and `radii_m` (n,) the truth.
    """

    K: Array
    normal: Array
    poses: Array
    radii_m: Array
    conics: Array
    centre_px: Array
    line: Array


def circle_scene(
    generator: np.random.Generator,
    offsets: Array,
    radii: Array,
    tilt_deg: tuple[float, float] = (12.0, 65.0),
    distance: tuple[float, float] = (6.0, 25.0),
    focal_px: float | None = None,
    principal_point: tuple[float, float] | None = None,
    off_axis_deg: float = 18.0,
) -> CircleScene:
    """A camera before circles with centres `offsets` (n, 2) in their plane, in units of the first one's diameter.

    `distance` is in the same units. The first circle is up to `off_axis_deg` beside the axis, in x and in y, of a
    camera of 1280x960 px whose principal point is up to 30 px from the middle.
    """
    radii, offsets = np.asarray(radii, dtype=np.float64), np.asarray(offsets, dtype=np.float64)
    f = generator.uniform(700.0, 2000.0) if focal_px is None else focal_px
    middle = np.array([639.5, 479.5])
    pp = middle + generator.uniform(-30, 30, 2) if principal_point is None else np.asarray(principal_point)
    k = np.array([[f, 0.0, pp[0]], [0.0, f, pp[1]], [0.0, 0.0, 1.0]])
    normal = normal_of(generator.uniform(*tilt_deg), generator.uniform(-180, 180))
    unit_m = 2.0 * radii[0]
    sight = np.append(np.tan(np.radians(generator.uniform(-off_axis_deg, off_axis_deg, 2))), 1.0)
    depth = generator.uniform(*distance) * unit_m
    first = camera_from_marker_of(normal, depth * sight, float(generator.uniform(-180, 180)))
    poses = np.repeat(first[None], len(radii), axis=0)
    poses[:, :3, 3] += (offsets * unit_m) @ first[:3, :2].T
    image = poses[:, :3, 3] @ k.T
    return CircleScene(
        K=k,
        normal=normal,
        poses=poses,
        radii_m=radii,
        conics=conic_of_circle(poses, radii, k),
        centre_px=image[:, :2] / image[:, 2:],
        line=vanishing_line(first, k),
    )


def scattered(generator: np.random.Generator, count: int, gap: float = 0.3) -> tuple[Array, Array]:
    """Centres (n, 2) and radii (n,) of disjoint circles of one plane, in units of the first one's diameter."""
    radii = np.append(0.5, generator.uniform(0.3, 0.7, count - 1))
    places = [np.zeros(2)]
    while len(places) < count:
        trial = generator.uniform(-2.5, 2.5, 2)
        far = [np.linalg.norm(trial - p) - radii[i] - radii[len(places)] for i, p in enumerate(places)]
        if min(far) > gap:
            places.append(trial)
    return np.array(places), radii


def noisy_ellipses(generator: np.random.Generator, scene: CircleScene, sigma_px: float) -> tuple[Array, Array]:
    """Ellipses (n, 5) fitted to one noisy point a pixel of each contour, and their shapes' covariances (n, 5, 5).

    The covariance is that of the known noise, not of the residuals.
    """
    ellipses, covs = [], []
    for ellipse in ellipse_of_conic(scene.conics):
        points = ellipse_points(ellipse, max(12, int(ellipse_perimeter_px(ellipse))))
        fit = fit_ellipse(points + generator.normal(0.0, sigma_px, points.shape))
        assert isinstance(fit, EllipseFit)
        ellipses.append(fit.ellipse)
        covs.append(fit.shape_cov * (sigma_px / fit.sigma_px) ** 2)
    return np.array(ellipses), np.array(covs)
