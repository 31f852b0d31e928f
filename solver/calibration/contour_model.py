"""Predicted images of a board's circles, and their derivatives by camera, board pose and dot diameter."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import (
    Camera,
    denormalise,
    distort_normalised,
    distorts,
    normalise,
    undistort_normalised,
)
from roundel.solver.calibration.fitted_ellipse import along_contours, fitted_ellipses

Array = NDArray[np.float64]

# Points of a contour. The sums over it are periodic and smooth, so they converge faster than any power of it: for an
# axis ratio of 3, 24 points are exact to 1e-7 px and 32 to 1e-9 px.
CONTOUR_POINTS = 32
MAX_BEND = 6  # order of a bend: finer waves are smaller than the distance of the dots
POSE = 6  # rotation vector in the camera's frame, translation


@dataclass(frozen=True, eq=False)
class Dots:
    """The measured dots of all views of a calibration.

    Attributes
    ----------
    view : (N,) array of int
        The view of each dot, in ascending order.
    centre_m : (N, 2) array
        In the board's frame.
    shape : (N, 5) array
        Measured ellipse (x, y, S11, S12, S22) in the image, px, or in `lens`'s undistorted coordinates.
    shape_cov : (N, 5, 5) array
    lens : Camera or None
        The lens that was removed from the pixels' positions before the fit: of an earlier estimate; None for none.
    """

    view: NDArray[np.int64]
    centre_m: Array
    shape: Array
    shape_cov: Array
    lens: Camera | None = None

    def __len__(self) -> int:
        return len(self.view)

    @property
    def half_m(self) -> float:
        """Largest distance of a dot from the board's origin, along X or Y."""
        return float(np.abs(self.centre_m).max())

    def chosen(self, which: NDArray[np.bool_]) -> Dots:
        """Some of the dots."""
        return replace(
            self,
            view=self.view[which],
            centre_m=self.centre_m[which],
            shape=self.shape[which],
            shape_cov=self.shape_cov[which],
        )


@dataclass(frozen=True, eq=False)
class Model:
    """The unknowns of a calibration.

    Attributes
    ----------
    camera : Camera
    diameter_m : float
        Of a dot.
    poses : (V, 4, 4) array
        `camera_from_board` of each view.
    edge_px : float
        Displacement of all edges in the image, outward from the dots, px: by a response curve that is not the one
        undone, by sharpening, by light that spreads. It would make tilted dots rounder, and the focal length wrong.
    bend_m : (m,) array
        Height of the board above its plane, m: coefficients of `bend_powers`, with x and y in units of the board's half
        size; empty if it is flat.
    """

    camera: Camera
    diameter_m: float
    poses: Array
    edge_px: float = 0.0
    bend_m: Array = field(default_factory=lambda: np.empty(0))

    @property
    def camera_parameters(self) -> Array:
        """fx, fy, cx, cy, the distortion coefficients, the diameter's natural logarithm, edge_px, bend_m."""
        k, distortion = self.camera.K, self.camera.distortion
        values = k[0, 0], k[1, 1], k[0, 2], k[1, 2], *distortion, np.log(self.diameter_m), self.edge_px
        return np.concatenate([values, self.bend_m])

    def moved(self, camera_step: Array, pose_steps: Array) -> Model:
        """The model after a step: added to the camera's parameters, (V, 6) composed with the poses."""
        fx, fy, cx, cy, *rest = (self.camera_parameters + camera_step).tolist()
        count = len(self.camera.distortion)
        log_diameter, edge_px, *bend_m = rest[count:]
        k = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        poses = self.poses.copy()
        poses[:, :3, :3] = rotations(pose_steps[:, :3]) @ poses[:, :3, :3]
        poses[:, :3, 3] += pose_steps[:, 3:]
        camera = replace(self.camera, K=k, distortion=tuple(rest[:count]))
        return Model(camera, float(np.exp(log_diameter)), poses, edge_px, np.array(bend_m))


def rotations(vectors: Array) -> Array:
    """Rotation matrices (V, 3, 3) of rotation vectors (V, 3), by Rodrigues' formula."""
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    # sinc is exact at zero; (1 - cos a) / a^2 = sinc(a / 2)^2 / 2.
    once, twice = np.sinc(angle / np.pi), np.sinc(angle / (2 * np.pi)) ** 2 / 2
    return np.asarray(np.eye(3) + once * cross + twice * (cross @ cross))


def predicted_shapes(model: Model, dots: Dots) -> tuple[Array, Array]:
    """The ellipses that a fit finds on the images of the dots, and their derivatives.

    Returns
    -------
    shape : (N, 5) array
        NaN where the lens model does not image a dot.
    jacobian : (N, 5, c + 6) array
        By the c camera parameters of `Model`, and by the step of the dot's own pose.
    """
    points, by_point = _imaged(model, dots)
    good = np.isfinite(points).all(axis=(1, 2))
    shape, jacobian = np.full((len(dots), 5), np.nan), np.full((len(dots), 5, by_point.shape[-1]), np.nan)
    shape[good], inner = fitted_ellipses(points[good])
    jacobian[good] = np.einsum("Npki,Nkij->Npj", inner, by_point[good])
    return shape, jacobian


def contours_px(model: Model, dots: Dots) -> Array:
    """Contours of the dots in the image, (N, CONTOUR_POINTS, 2) px."""
    return _imaged(model, replace(dots, lens=None))[0]


def _imaged(model: Model, dots: Dots) -> tuple[Array, Array]:
    """Contours (N, n, 2) and their derivatives (N, n, 2, c + 6)."""
    turn = 2 * np.pi * np.arange(CONTOUR_POINTS) / CONTOUR_POINTS
    unit = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    board = dots.centre_m[:, None] + model.diameter_m / 2 * unit
    radius = np.broadcast_to(model.diameter_m / 2 * unit, board.shape)
    rotation, shift = model.poses[:, :3, :3][dots.view], model.poses[:, :3, 3][dots.view]
    turned, growth = (np.einsum("Nij,Nkj->Nki", rotation[:, :, :2], a) for a in (board, radius))
    heights, slopes = _heights(board / dots.half_m, len(model.bend_m))
    turned += np.einsum("Nkh,h,Ni->Nki", heights, model.bend_m, rotation[:, :, 2])
    growth += np.einsum("Nkhj,Nkj,h,Ni->Nki", slopes, radius / dots.half_m, model.bend_m, rotation[:, :, 2])
    place = turned + shift[:, None]
    depth = np.where(place[..., 2] > 0, place[..., 2], np.nan)
    xy = place[..., :2] / depth[..., None]
    bent, bend = distort_normalised(model.camera, xy)
    focal = np.array([model.camera.K[0, 0], model.camera.K[1, 1]])
    image = denormalise(model.camera, bent)

    by_xy = focal[:, None] * bend
    by_place = (
        np.concatenate([by_xy, -np.einsum("Nkij,Nkj->Nki", by_xy, xy)[..., None]], axis=-1) / depth[..., None, None]
    )
    # d (exp(w) y) / d w = -[y]x
    y1, y2, y3 = (turned[..., i] for i in range(3))
    zero = np.zeros_like(y1)
    cross = np.stack([zero, y3, -y2, -y3, zero, y1, y2, -y1, zero], axis=-1).reshape(*y1.shape, 3, 3)
    count = len(model.camera.distortion)
    outward = _outward(image)
    raised = slice(6 + count, 6 + count + len(model.bend_m))
    jacobian = np.zeros((*image.shape, raised.stop + POSE))
    jacobian[..., 0, 0], jacobian[..., 1, 1] = bent[..., 0], bent[..., 1]
    jacobian[..., 0, 2] = jacobian[..., 1, 3] = 1.0
    jacobian[..., 4 : 4 + count] = focal[:, None] * _by_coefficients(xy, count)
    jacobian[..., 4 + count] = np.einsum("Nkij,Nkj->Nki", by_place, growth)
    jacobian[..., 5 + count] = outward
    jacobian[..., raised] = np.einsum("Nkij,Nj,Nkh->Nkih", by_place, rotation[:, :, 2], heights)
    jacobian[..., raised.stop : raised.stop + 3] = by_place @ cross
    jacobian[..., raised.stop + 3 :] = by_place
    image = image + model.edge_px * outward
    if dots.lens is None or not distorts(dots.lens):
        return image, jacobian
    straight, slope = _undistorted(dots.lens, image)
    return straight, slope @ jacobian


def bend_powers(degree: int) -> list[tuple[int, int]]:
    """Powers (i, j) of the terms x^i y^j of a bend: those of orders 2 to `degree`; the lower ones are the pose's."""
    return [(order - j, j) for order in range(2, degree + 1) for j in range(order + 1)]


def _heights(xy: Array, terms: int) -> tuple[Array, Array]:
    """The first terms of `bend_powers` at points (..., 2), (..., terms), and their derivatives (..., terms, 2)."""
    powers = bend_powers(MAX_BEND)[:terms]
    x, y = xy[..., :1], xy[..., 1:]
    i, j = np.array(powers, dtype=np.int64).reshape(-1, 2).T
    by_x = i * x ** np.maximum(i - 1, 0) * y**j
    by_y = j * x**i * y ** np.maximum(j - 1, 0)
    return x**i * y**j, np.stack([by_x, by_y], axis=-1)


def _outward(contours: Array) -> Array:
    """Outer unit normals of contours (N, n, 2), which run counterclockwise for a viewer."""
    tangent = along_contours(contours)
    normal = np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)
    return np.asarray(normal / np.linalg.norm(normal, axis=-1, keepdims=True))


def _by_coefficients(xy: Array, count: int) -> Array:
    """Derivative (..., 2, count) of the distorted coordinates by k1, k2, p1, p2, k3 (`scenes.camera.lens_opencv`)."""
    x, y = xy[..., 0], xy[..., 1]
    u = x * x + y * y
    columns = [
        xy * u[..., None],
        xy * (u * u)[..., None],
        np.stack([2 * x * y, u + 2 * y * y], axis=-1),
        np.stack([u + 2 * x * x, 2 * x * y], axis=-1),
        xy * (u**3)[..., None],
    ]
    return np.stack(columns[:count], axis=-1)


def _undistorted(lens: Camera, image_px: Array) -> tuple[Array, Array]:
    """Undistorted coordinates under a fixed lens, px, and their derivative (..., 2, 2) by the image."""
    xy = undistort_normalised(lens, normalise(lens, image_px))
    focal = np.array([lens.K[0, 0], lens.K[1, 1]])
    slope = focal[:, None] * distort_normalised(lens, xy)[1] / focal
    good = np.isfinite(slope).all(axis=(-1, -2))
    inverse = np.full_like(slope, np.nan)
    inverse[good] = np.linalg.inv(slope[good])
    return denormalise(lens, xy), inverse
