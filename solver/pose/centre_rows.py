"""The poses of an ellipse that moves while the rows are read, at mid-exposure of the row of the circle's centre.

In the image the contour is sheared by the speed v of the circle's centre: where the row g.(x - x0) is read after
r g.(x - x0) seconds, the point x was at x - v r g.(x - x0) at time zero. The image tells little about v, which moves a
pose by degrees, along a curve. Therefore the motion is integrated out. The speed given the image has a distribution, by
the prior of the camera's twist; at each of its Gauss-Hermite nodes the contour is sheared back and gives a pose, and
the estimate is the mean of these poses, with their covariance. The prior of the rates is that of each candidate,
because a twist changes the images of both in different ways.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera, distort_px
from roundel.scenes.camera.row_time import RowTime
from roundel.solver.fit.ellipse import ellipse_of_shape, shape_of_ellipse
from roundel.solver.pose.circle_pose import CirclePoses, poses_from_ellipse
from roundel.solver.pose.pose_covariance import poses_with_covariance
from roundel.solver.pose.shape_rates import shape_rates

Array = NDArray[np.float64]

_ROOTS, _WEIGHTS = np.polynomial.hermite_e.hermegauss(5)
_NODES = np.stack([a.ravel() for a in np.meshgrid(_ROOTS, _ROOTS)], axis=-1)  # (25, 2)
_SHARE = np.outer(_WEIGHTS, _WEIGHTS).ravel() / np.sum(_WEIGHTS) ** 2
_MEAN = np.zeros((1, 2))
# Times the variance of what is not linear in the speed: the square of a normal number has longer tails than the number.
# By a Monte Carlo of `benchmarks/solver/uncertainty/rolling_shutter.yaml` at 33 ms, 95 % regions then hold 94 % (else
# 92.6 %), and 0.1 % of the poses are beyond 5 sigma (else 0.3 %).
_TAILS = 2.0


@dataclass(frozen=True, eq=False)
class MovingEllipse:
    """The contour of a moving circle in the image, and what its pixels tell about its rates.

    Attributes
    ----------
    ellipse : (5,) array
        In the image; its size at the time of the row `row_zero_px`.
    rates : (5,) array
        Of the x, y, S11, S12, S22 of the circle's image at one time, px/s.
    shape_cov : (5, 5) array
        Of the ellipse.
    rates_cov : (5, 10) array
        Of the rates with the shape, and with themselves.
    row_zero_px : float
        The row, or column.
    """

    ellipse: Array
    rates: Array
    shape_cov: Array
    rates_cov: Array
    row_zero_px: float


def poses_at_centre_rows(
    moving: MovingEllipse,
    camera: Camera,
    row_time: RowTime,
    radius_m: float,
    focal_sigma: float,
    principal_sigma_px: float,
) -> tuple[CirclePoses, Array]:
    """Both poses and their covariance, each at mid-exposure of its own centre's row; these differ by some rows.

    Parameters
    ----------
    moving : MovingEllipse
    camera : Camera
    row_time : RowTime
        Its readout, and the prior of its twist.
    radius_m, focal_sigma, principal_sigma_px
        See `poses_with_covariance`.

    Returns
    -------
    CirclePoses
        Mean over the twist.
    (2, 6, 6) array

    Raises
    ------
    ValueError
        As `poses_with_covariance`.
    """
    static = poses_from_ellipse(moving.ellipse, camera.K, radius_m)
    contour = _contour_of(moving, camera, row_time)
    near, shapes, shape_covs = np.empty((2, 3)), np.empty((2, len(_NODES), 5)), np.empty((2, 1, 5, 5))
    for i in range(2):
        pose, speed = (static.normal[i], static.centre_m[i]), np.zeros(2)
        for nodes in (_MEAN, _NODES):  # the rates by the twist are those at the mean pose and speed
            by_twist = shape_rates(*pose, camera.K, radius_m) * row_time.twist_sigma
            seen = camera.K @ pose[1]
            at, shape_cov, speed = _shapes_at(nodes, contour, by_twist, speed, seen[:2] / seen[2])
            mean = poses_from_ellipse(ellipse_of_shape(at[len(at) // 2]), camera.K, radius_m)
            # The same candidate: near-frontal ones may change their order.
            same = int(np.argmax(mean.normal @ pose[0]))
            pose = mean.normal[same], mean.centre_m[same]
        near[i], shapes[i], shape_covs[i] = pose[0], at, shape_cov
    known = camera.K, radius_m, focal_sigma, principal_sigma_px
    there, cov = poses_with_covariance(ellipse_of_shape(shapes), shape_covs, *known)
    assert cov is not None, "the covariance of a fit with rates is finite"
    which = np.argmax(there.normal @ near[:, None, :, None], axis=-2)
    normal, centre = (np.take_along_axis(a, which[..., None], axis=2)[:, :, 0] for a in (there.normal, there.centre_m))
    mine = np.take_along_axis(cov, which[..., None, None], axis=2)[:, :, 0]
    moments = [_moments(normal[i], centre[i], mine[i]) for i in range(2)]
    normals, centres, covs = (np.stack(part) for part in zip(*moments, strict=True))
    return CirclePoses(normals, centres), covs


def _shapes_at(
    nodes: Array, contour: _Contour, by_twist: Array, speed: Array, centre_px: Array
) -> tuple[Array, Array, Array]:
    """Shapes of the circle's image at the time of its centre's row, at nodes (n, 2) of the speed.

    Parameters
    ----------
    nodes : (n, 2) array
        In standard deviations.
    contour : _Contour
    by_twist : (5, 6) array
        The rates by the twist in its standard deviations.
    speed : (2,) array
        A speed near the mean, px/s.
    centre_px : (2,) array
        The undistorted image of the circle's centre.

    Returns
    -------
    shapes, shape_cov, speed : (n, 5), (5, 5), (2,) arrays
        Shapes, their covariance at each node, and the mean speed.
    """
    moving = contour.moving
    crossed, own = moving.rates_cov[:, :5], moving.rates_cov[:, 5:]
    # The rates by their prior and by the pixels.
    seen, prior = contour.seen(np.repeat(speed[None], 5, axis=0), np.eye(5)).T, by_twist @ by_twist.T
    gain = np.linalg.solve(seen @ prior @ seen.T + own, seen @ prior).T
    mean, cov = gain @ moving.rates, prior - gain @ seen @ prior
    values, vectors = np.linalg.eigh(cov[:2, :2])
    root = vectors * np.sqrt(np.maximum(values, 1e-12 * values[1]))
    by_node = np.linalg.solve(root, cov[:2]).T
    rates, left = mean + nodes @ by_node.T, seen @ (cov - by_node @ by_node.T) @ seen.T
    # The contour in the image with these rates.
    by_rates = np.linalg.solve(own, crossed).T
    shapes = shape_of_ellipse(moving.ellipse) + (contour.seen(rates[:, :2], rates) - moving.rates) @ by_rates.T
    shape_cov = moving.shape_cov + by_rates @ (left - own) @ by_rates.T
    # Back to one time.
    back, ahead = contour.back(rates[:, :2]), seen.copy()
    ahead[:2, :2] = np.linalg.inv(contour.back(mean[None, :2])[0])
    s = _matrix(shapes[:, 2:])
    shapes[:, 2:] = _elements(_root(back @ s @ s @ np.swapaxes(back, 1, 2)))
    centre_row = contour.row_of(centre_px)
    rows = contour.row_of(moving.ellipse[:2]) + (shapes[:, :2] - moving.ellipse[:2]) @ contour.along
    shapes[:, :2] += rates[:, :2] * contour.row_s * (centre_row - rows)[:, None]
    shapes[:, 2:] += rates[:, 2:] * contour.row_s * (centre_row - moving.row_zero_px)
    return shapes, np.asarray(np.linalg.solve(ahead, np.linalg.solve(ahead, shape_cov).T)), mean[:2]


@dataclass(frozen=True, eq=False)
class _Contour:
    """A moving contour and the rows about it: `along` (2,) is the derivative of the row by the undistorted position."""

    moving: MovingEllipse
    camera: Camera
    row_s: float
    along: Array
    axis: int

    def back(self, speed: Array) -> Array:
        """Matrices (n, 2, 2) that shear the contour in the image back to one time, by its speed (n, 2)."""
        return np.asarray(np.eye(2) - speed[:, :, None] * self.row_s * self.along)

    def seen(self, speed: Array, rates: Array) -> Array:
        """Rates (n, 5) of the sheared contour in the image, by those of the circle's image at one time (n, 5)."""
        back, s = self.back(speed), _matrix(shape_of_ellipse(self.moving.ellipse)[None, 2:])
        still, ahead = _root(back @ s @ s @ np.swapaxes(back, 1, 2)), np.linalg.inv(back)
        half = still @ _matrix(rates[:, 2:])
        change = ahead @ (half + np.swapaxes(half, 1, 2)) @ np.swapaxes(ahead, 1, 2)
        # S X + X S = C of 2x2 matrices: X = (C + det S S^-1 C S^-1) / (2 trace S).
        inverse = np.linalg.inv(s)
        x = (change + np.linalg.det(s) * inverse @ change @ inverse) / (2.0 * np.trace(s[0]))
        return np.concatenate([rates[:, :2], _elements(x)], axis=1)

    def row_of(self, point_px: Array) -> float:
        """The row, or column, that images an undistorted point (2,)."""
        return float(_imaged(self.camera, point_px[None])[0, self.axis])


def _contour_of(moving: MovingEllipse, camera: Camera, row_time: RowTime) -> _Contour:
    axis = 0 if row_time.along_x else 1
    apart = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    right, left, down, up = _imaged(camera, moving.ellipse[:2] + apart)[:, axis]
    along = np.array([right - left, down - up]) / 2.0
    return _Contour(moving, camera, row_time.row_s(camera.width_px, camera.height_px), along, axis)


def _imaged(camera: Camera, points_px: Array) -> Array:
    """Image points (n, 2) of undistorted ones; a ValueError outside the lens model's field."""
    out = distort_px(camera, points_px)
    if not np.isfinite(out).all():
        raise ValueError("the circle is outside the field of the camera's lens model")
    return out


def _matrix(elements: Array) -> Array:
    """Symmetric matrices (n, 2, 2) from their elements 11, 12, 22 (n, 3)."""
    return np.asarray(elements[:, [0, 1, 1, 2]].reshape(-1, 2, 2))


def _elements(matrix: Array) -> Array:
    """The elements 11, 12, 22 (n, 3) of symmetric matrices (n, 2, 2)."""
    return np.asarray(matrix.reshape(-1, 4)[:, [0, 1, 3]])


def _root(matrix: Array) -> Array:
    """Square roots of symmetric positive definite matrices (n, 2, 2), by their determinant and trace."""
    area = np.sqrt(np.linalg.det(matrix))[:, None, None]
    trace = np.trace(matrix, axis1=1, axis2=2)[:, None, None]
    return np.asarray((matrix + area * np.eye(2)) / np.sqrt(trace + 2.0 * area))


def _moments(normal: Array, centre_m: Array, cov: Array) -> tuple[Array, Array, Array]:
    """Mean normal and centre (3,) over the nodes, and covariance (6, 6) about them."""
    mean = _SHARE @ normal
    mean /= np.linalg.norm(mean)
    middle = _SHARE @ centre_m
    apart = np.concatenate([centre_m - middle, normal - mean], axis=-1)
    bent = apart - _NODES @ (_NODES.T @ (_SHARE[:, None] * apart))
    total = np.tensordot(_SHARE, cov, axes=1) + apart.T @ (_SHARE[:, None] * apart)
    total += (_TAILS - 1.0) * bent.T @ (_SHARE[:, None] * bent)
    tangent = np.eye(6)  # a normal has no error along itself
    tangent[3:, 3:] -= np.outer(mean, mean)
    return mean, middle, np.asarray(tangent @ total @ tangent)
