"""Cases for `choice.py`: markers, cameras, noise, and the declared prior knowledge."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from roundel.scenes.camera.model import Camera
from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic, ellipse_perimeter_px, ellipse_points
from roundel.scenes.geometry.pose import angle_deg, camera_from_marker_of, minimal_rotation, normal_of
from roundel.solver.ambiguity.concentric_circle import ConcentricCircle
from roundel.solver.ambiguity.disambiguation import NormalPrior, choose
from roundel.solver.ambiguity.normal_prior import on_floor, on_wall
from roundel.solver.ambiguity.observation import Observation
from roundel.solver.ambiguity.pattern_cue import pattern_of
from roundel.solver.fit.edges import edge_points
from roundel.solver.fit.ellipse import FailedFit, ellipse_of_shape, fit_ellipse, shape_of_ellipse
from roundel.solver.fit.ellipse_distance import foot_points
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera
from roundel.solver.pose.circle_pose import poses_from_ellipse

Array = NDArray[np.float64]

WIDTH, HEIGHT, FOCAL_PX = 1280, 720, 1016.0
RADIUS_M = 0.5  # a diameter of one: distances are in diameters
FOCAL_SIGMA, PRINCIPAL_SIGMA_PX = 0.115, 20.0
FINE = 4  # points per pixel side of the grid on which images are drawn and blurred

KINDS = (
    "same_or_opposite_side_default",
    "side_near_the_axis_default",
    "normal_prior",
    "normal_prior_wide",
    "normal_prior_default",
    "floor_with_gravity",
    "floor_upright",
    "wall",
    "normal_and_side_default",
)
MARKS = (
    "centre_dot_default",
    "centre_dot_far_default",
    "inner_ring_default",
    "inner_ring_far_default",
    "pattern_far_default",
)


def cases(kind: str, count: int) -> Iterator[tuple[float, bool]]:
    """Probability declared for candidate 0, and whether it was the true one."""
    generator = np.random.default_rng([5, *kind.encode()])
    made = 0
    while made < count:
        one = _mark_case(generator, kind) if kind in MARKS else _case(generator, kind)
        if one is not None:
            made += 1
            yield one


def _cameras(generator: np.random.Generator, uncertain: bool) -> tuple[Array, UncertainCamera]:
    """The true K, and the assumed camera."""
    guess = np.array([[FOCAL_PX, 0, (WIDTH - 1) / 2], [0, FOCAL_PX, (HEIGHT - 1) / 2], [0, 0, 1]])
    true = guess.copy()
    if not uncertain:
        return true, UncertainCamera(Camera(WIDTH, HEIGHT, guess))
    # The truth is distributed about the guess as declared.
    true[:2, :2] *= max(0.5, 1.0 + FOCAL_SIGMA * generator.standard_normal())
    true[:2, 2] += PRINCIPAL_SIGMA_PX * generator.standard_normal(2)
    return true, UncertainCamera(Camera(WIDTH, HEIGHT, guess), FOCAL_SIGMA, PRINCIPAL_SIGMA_PX)


def _centre(
    generator: np.random.Generator, k: Array, distance_D: tuple[float, float] = (5, 50), reach_px: float | None = None
) -> Array:
    x, y = (WIDTH - 1) / 2, (HEIGHT - 1) / 2
    across, down = (x, y) if reach_px is None else (reach_px, reach_px)
    pixel = np.array([x + generator.uniform(-across, across), y + generator.uniform(-down, down), 1.0])
    ray = np.linalg.solve(k, pixel)
    return np.asarray(generator.uniform(*distance_D) * ray / np.linalg.norm(ray))


def _around(generator: np.random.Generator, mean: Array, spread_deg: float) -> Array:
    """A direction with the density exp(-theta^2 / (2 spread^2)) over the sphere."""
    while True:
        step = np.radians(spread_deg) * generator.standard_normal(2)
        theta = float(np.hypot(*step))
        # The tangent plane's area shrinks by sin(theta) / theta on the sphere.
        if theta < np.pi and generator.uniform() < np.sinc(theta / np.pi):
            local = np.array([*(np.sinc(theta / np.pi) * step), np.cos(theta)])
            return np.asarray(minimal_rotation([0.0, 0.0, 1.0], mean) @ local)


def _knowledge(generator: np.random.Generator, kind: str) -> tuple[Array, Any]:
    """The true normal, and what is declared about it; a side is declared later."""
    normal = normal_of(generator.uniform(10, 70), generator.uniform(-180, 180))
    if kind.startswith("normal"):
        spread = {"normal_prior_wide": 40.0}.get(kind, float(generator.choice([5.0, 10.0, 20.0])))
        return _around(generator, normal, spread), NormalPrior(normal, spread)
    pitch, roll = np.radians(generator.uniform(-10, 70)), np.radians(generator.uniform(-30, 30))
    gravity = np.array([np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch), np.sin(pitch)])
    if kind == "floor_with_gravity":
        return _around(generator, -gravity, 10.0), on_floor(gravity, 10.0)
    if kind == "floor_upright":
        return _on_circle(generator, np.array([1.0, 0, 0]), 8.0, np.array([0, -1.0, 0])), on_floor(None, 8.0)
    if kind == "wall":
        return _on_circle(generator, gravity, 6.0, None), on_wall(gravity, 6.0)
    return normal, None


def _on_circle(generator: np.random.Generator, axis: Array, spread_deg: float, toward: Array | None) -> Array:
    while True:
        up = np.radians(spread_deg) * generator.standard_normal()
        if abs(up) < np.pi / 2 and generator.uniform() < np.cos(up):
            break
    turn = generator.uniform(-np.pi, np.pi)
    local = np.array([np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), np.sin(up)])
    out = minimal_rotation([0.0, 0.0, 1.0], axis) @ local
    return np.asarray(out if toward is None or out @ toward > 0 else out - 2 * (out @ toward) * toward)


def _side(normal: Array, centre: Array, k: Array) -> str:
    """The side of the true candidate: + (index 0) of the candidates of the true camera, or -."""
    exact = ellipse_of_conic(conic_of_circle(camera_from_marker_of(normal, centre), RADIUS_M, k))
    poses = poses_from_ellipse(exact, k, RADIUS_M)
    return "same_side" if _nearer(poses.normal, normal) == 0 else "opposite_side"


def _nearer(candidates: Array, normal: Array) -> int:
    return int(np.argmin(angle_deg(candidates, normal)))


def _case(generator: np.random.Generator, kind: str) -> tuple[float, bool] | None:
    k, uncertain = _cameras(generator, kind.endswith("_default"))
    normal, knowledge = _knowledge(generator, kind)
    centre = _centre(generator, k, reach_px=80.0 if "near_the_axis" in kind else None)
    if not _visible(normal, centre):
        return None
    exact = ellipse_of_conic(conic_of_circle(camera_from_marker_of(normal, centre), RADIUS_M, k))
    cov = _shape_cov(exact, sigma_px=float(np.exp(generator.uniform(np.log(0.05), np.log(0.5)))))
    theta = generator.multivariate_normal(shape_of_ellipse(exact), cov)
    if theta[2] * theta[4] <= theta[3] ** 2:
        return None
    ellipse = ellipse_of_shape(theta)
    poses = poses_from_ellipse(ellipse, uncertain.camera.K, RADIUS_M)
    pieces = [] if knowledge is None else [knowledge]
    if "side" in kind:
        pieces.append(_side(normal, centre, k))
    choice = choose(Observation(poses.normal, None, ellipse, cov, uncertain), pieces)
    return choice.probability[0], _nearer(poses.normal, normal) == 0


def _visible(normal: Array, centre: Array) -> bool:
    return bool(normal @ centre < -0.1 * np.linalg.norm(centre))


def _shape_cov(ellipse: Array, sigma_px: float) -> Array:
    """Covariance of (x, y, S11, S12, S22) from one edge point per pixel."""
    points = ellipse_points(ellipse, max(16, round(float(ellipse_perimeter_px(ellipse)))))
    _, normal, u = foot_points(ellipse, points)
    rows = np.stack(
        [*normal.T, normal[:, 0] * u[:, 0], normal[:, 0] * u[:, 1] + normal[:, 1] * u[:, 0], normal[:, 1] * u[:, 1]], 1
    )
    return np.asarray(np.linalg.inv(rows.T @ rows) * sigma_px**2)


def _mark_case(generator: np.random.Generator, kind: str) -> tuple[float, bool] | None:
    """A small image with a pattern inside the marker, measured like the solver does."""
    k, uncertain = _cameras(generator, kind.endswith("_default"))
    far = "_far" in kind
    # A cue on the print declares nothing about the normal: all directions are equally likely, and the image decides.
    normal = normal_of(np.degrees(np.arccos(generator.uniform(0, 1))), generator.uniform(-180, 180))
    near = 5 if kind.startswith(("centre", "inner")) else 12  # rendering a large print takes a second
    centre = _centre(generator, k, (25, 60) if far else (near, 50))
    if not _visible(normal, centre):
        return None
    pose = camera_from_marker_of(normal, centre, generator.uniform(-180, 180))
    outer = ellipse_of_conic(conic_of_circle(pose, RADIUS_M, k))
    corner = np.round(outer[:2] - outer[2] - 12)
    if outer[3] < 5:
        return None
    shift = np.array([*corner, 0, 0, 0])
    size = int(2 * outer[2] + 25)
    contrast = float(generator.uniform(80, 180))
    ideal = -contrast * coverage(outer - shift, size)
    mark: Any
    if kind.startswith(("centre_dot", "inner_ring")):
        ratio = float(generator.uniform(0.15, 0.3) if kind.startswith("centre_dot") else generator.uniform(0.4, 0.65))
        inner = ellipse_of_conic(conic_of_circle(pose, ratio * RADIUS_M, k))
        if inner[3] < 1.5:
            return None
        ideal += contrast * coverage(inner - shift, size)
        mark = ConcentricCircle(ratio)
    else:
        ideal += contrast * printed(patches, pose, k, corner, size)
        mark = PATTERN
    image = exposed(210.0 + ideal, (2.0, 12.0) if far else (0.5, 4.0), generator)
    around = edge_points(image, outer - shift + np.array([*generator.normal(0, 0.3, 2), 0, 0, 0]))
    if isinstance(around, FailedFit):
        return None
    fit = fit_ellipse(around.points_px, around.sigma_px)
    if isinstance(fit, FailedFit):
        return None
    # The crop has its own pixel coordinates: transform camera and ellipse to them.
    k_crop = uncertain.camera.K.copy()
    k_crop[:2, 2] -= corner
    crop = UncertainCamera(Camera(size, size, k_crop), uncertain.focal_sigma, uncertain.principal_sigma_px)
    poses = poses_from_ellipse(fit.ellipse, k_crop, RADIUS_M)
    observation = Observation(poses.normal, None, fit.ellipse, fit.shape_cov, crop, image, around.blur_px)
    choice = choose(observation, mark)
    return choice.probability[0], _nearer(poses.normal, normal) == 0


def patches(x: Array, y: Array) -> Array:
    """Three paper squares and a dot inside the ink, without symmetry."""
    out = np.hypot(x + 0.1, y - 0.15) < 0.12
    for cx, cy, half in ((0.45, 0.0, 0.16), (-0.35, -0.4, 0.14), (-0.2, 0.55, 0.1)):
        out |= (np.abs(x - cx) < half) & (np.abs(y - cy) < half)
    return out * 1.0


PATTERN = pattern_of(patches)


def printed(reflectance: Any, pose: Array, k: Array, corner: Array, size: int) -> Array:
    """Reflectance on the finer grid, 5 points per cell; true pose and camera."""
    n, c = pose[:3, 2], pose[:3, 3]
    at = (np.arange(FINE * size) + 0.5) / FINE - 0.5
    total = np.zeros((FINE * size, FINE * size))
    for i in range(5):
        du, dv = ((i + 0.5) / 5 - 0.5) / FINE, ((2 * i % 5 + 0.5) / 5 - 0.5) / FINE
        u, v = np.meshgrid(at + corner[0] + du, at + corner[1] + dv)
        rays = np.stack([(u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1], np.ones_like(u)], axis=-1)
        points = rays * (n @ c / (rays @ n))[..., None] - c
        total += reflectance(points @ pose[:3, 0] / RADIUS_M, points @ pose[:3, 1] / RADIUS_M)
    return total / 5


def exposed(ideal: Array, noise_dn: tuple[float, float], generator: np.random.Generator) -> NDArray[np.uint8]:
    """Camera image of the finer grid: blurred, averaged over each pixel, with noise, 8 bits."""
    size = len(ideal) // FINE
    soft = gaussian_filter(ideal, FINE * generator.uniform(0.3, 1.0), mode="nearest")
    image = soft.reshape(size, FINE, size, FINE).mean(axis=(1, 3))
    image += generator.normal(0.0, generator.uniform(*noise_dn), image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def coverage(ellipse: Array, size: int) -> Array:
    """Fraction of each cell of the finer grid inside an ellipse, to 1/24 px of the edge."""
    angle = np.radians(ellipse[4])
    c, s = np.cos(angle), np.sin(angle)

    def radius2(x: Array, y: Array) -> Array:
        dx, dy = x - ellipse[0], y - ellipse[1]
        return np.asarray(((c * dx + s * dy) / ellipse[2]) ** 2 + ((c * dy - s * dx) / ellipse[3]) ** 2)

    at = (np.arange(FINE * size) + 0.5) / FINE - 0.5
    x, y = np.meshgrid(at, at)
    radius = np.sqrt(radius2(x, y))
    cut = np.abs(radius - 1.0) <= 0.75 / FINE / ellipse[3]
    out = np.where(cut, 0.0, (radius < 1.0).astype(np.float64))
    step = ((np.arange(6) + 0.5) / 6 - 0.5) / FINE
    oy, ox = np.meshgrid(step, step, indexing="ij")
    out[cut] = np.mean(radius2(x[cut][:, None] + ox.ravel(), y[cut][:, None] + oy.ravel()) < 1.0, axis=1)
    return out
