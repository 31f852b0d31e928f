"""How much of each pixel the image of a printed disc covers, with derivatives, in closed form or by quadrature.

Large discs are edges: the response of a square pixel to a blurred edge (`step_response`) at the signed distance from
the image of the circle. That distance is, from the plane coordinates X(p) with q = |X - X_j| - r_j, to second order
d = q / |grad q| + q^2 (n^T Hess q n) / (2 |grad q|^3).

A disc whose image is a few blurs wide is no edge any more. There the coverage is the integral of the pixel's response
over the disc, by Gauss and trapezoid nodes, and its derivatives are integrals along the rim.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.geometry.edge_spread_function import PIXEL_VARIANCE, curved_distance, step_response
from roundel.solver.views.homography_pose import GENERATORS

Array = NDArray[np.float64]

_REACH_SIGMAS = 5.0
_EDGE_SIGMAS = 6.0  # semi-minor axis, in blurs with the pixel's own, from which on a disc is an edge


@dataclass(frozen=True, eq=False)
class Coverage:
    """Coverage of pixels by discs, (N, J), with derivatives.

    Attributes
    ----------
    covered : (N, J) array
    by_shift : (N, J, 2) array
        Derivative by a shift of the disc's image, 1/px.
    by_variance : (N, J) array
        Derivative by the variance of the blur, 1/px^2.
    by_generator : (N, J, 8) array
        Derivative by the coordinates of the homography, see `homography_pose`.
    """

    covered: Array
    by_shift: Array
    by_variance: Array
    by_generator: Array


def coverage_of(places: Array, matrix: Array, discs: Array, variance: float, derivatives: bool = True) -> Coverage:
    """Coverage of pixels by discs under a homography.

    Parameters
    ----------
    places : (N, 2) array
        Undistorted pixel positions.
    matrix : (3, 3) array
        From the plane, in outer radii, to pixels.
    discs : (J, 3) array
        x, y, radius, in outer radii.
    variance : float
        Of the blur, px^2, without the pixel's own.
    derivatives : bool
        Whether they are needed; they are else zero.
    """
    n, j = len(places), len(discs)
    out = Coverage(np.zeros((n, j)), np.zeros((n, j, 2)), np.zeros((n, j)), np.zeros((n, j, 8)))
    inverse = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
    rays: Array = np.concatenate([places, np.ones((n, 1))], axis=1) @ inverse.T
    plane = rays[:, :2] / rays[:, 2:]
    total = math.sqrt(variance + PIXEL_VARIANCE)
    reach = _REACH_SIGMAS * total + 1.0
    for k, disc in enumerate(discs):
        stretch = _stretch(matrix, disc[:2])
        narrow, wide = (float(v) for v in np.linalg.svd(stretch, compute_uv=False)[::-1])
        rho = np.hypot(plane[:, 0] - disc[0], plane[:, 1] - disc[1])
        # A step in the plane is at least `narrow` px long; perspective changes that by little over the reach.
        near = np.flatnonzero(np.abs(rho - disc[2]) * narrow < 1.3 * reach)
        out.covered[:, k] = rho < disc[2]
        if narrow * disc[2] < _EDGE_SIGMAS * total:
            near = np.flatnonzero((rho - disc[2]) * narrow < 1.3 * reach)
            made = _small(places[near], matrix, disc, variance, wide, derivatives)
        else:
            made = _edge(plane[near], np.asarray(rays[near, 2]), inverse, disc, variance, derivatives)
        covered, rates = made
        out.covered[near, k] = covered
        if rates is not None:
            out.by_shift[near, k], out.by_variance[near, k], out.by_generator[near, k] = rates
    return out


def _stretch(matrix: Array, point: Array) -> Array:
    """Derivative (2, 2) of the image by the plane, at a point of it."""
    ray = matrix @ np.array([point[0], point[1], 1.0])
    return np.asarray((matrix[:2, :2] - np.outer(ray[:2] / ray[2], matrix[2, :2])) / ray[2])


# Coverage, and its derivatives by shift, variance and generators.
_Parts = tuple[Array, tuple[Array, Array, Array] | None]


def _edge(plane: Array, weight: Array, inverse: Array, disc: Array, variance: float, derivatives: bool) -> _Parts:
    # dX / dp of X = rays / rays_w.
    slope = (inverse[None, :2, :2] - plane[:, :, None] * inverse[None, 2:, :2]) / weight[:, None, None]
    offset = plane - disc[:2]
    rho = np.maximum(np.hypot(offset[:, 0], offset[:, 1]), 1e-9)
    out = offset / rho[:, None]
    grad = np.einsum("nk,nki->ni", out, slope)
    length = np.hypot(grad[:, 0], grad[:, 1])
    normal = grad / length[:, None]
    q = (rho - disc[2]) / length
    # Tangential parts, in the plane, of steps along the normal and along the edge.
    turned = slope[:, 1] * out[:, :1] - slope[:, 0] * out[:, 1:]
    along_normal = np.sum(turned * normal, axis=1)
    along_edge = turned[:, 1] * normal[:, 0] - turned[:, 0] * normal[:, 1]
    # Toward the middle of a disc the curvature of the level sets grows without bound, and nothing depends on it.
    distance = q + 0.5 * q**2 * along_normal**2 / (np.maximum(rho, disc[2] / 2) * length)
    curvature = along_edge**2 / (disc[2] * length)
    z, dz = curved_distance(distance, curvature, np.zeros_like(distance), variance + PIXEL_VARIANCE)
    nx, ny = np.abs(normal).T
    t, rate, second = step_response(z, (nx + ny) / 2, (nx - ny) / 2, variance)
    if not derivatives:
        return 1.0 - t, None
    # X moves by -delta G X under H (I + delta G): the edge moves the other way.
    outward = np.einsum("nk,ngk->ng", out, _flow(plane)) / length[:, None]
    return 1.0 - t, (rate[:, None] * normal, -(rate * dz + second / 2), rate[:, None] * outward)


def _flow(plane: Array) -> Array:
    """How points (N, 2) of the plane move with the coordinates of the homography, (N, 8, 2)."""
    point = np.concatenate([plane, np.ones((len(plane), 1))], axis=1)
    steps = np.einsum("gik,nk->ngi", GENERATORS, point)
    return np.asarray(steps[..., :2] - plane[:, None] * steps[..., 2:])


def _small(places: Array, matrix: Array, disc: Array, variance: float, wide: float, derivatives: bool) -> _Parts:
    # The response of a pixel without blur has steps, that of one with much has none: nodes for the sharper part of it.
    size = wide * disc[2] / math.sqrt(variance + 0.01)
    turns, rings = math.ceil(3.0 * size) + 10, math.ceil(0.6 * size) + 3
    angle = 2 * np.pi * np.arange(turns) / turns
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    # Gauss nodes in the square of the radius: every node stands for an equal kind of area.
    at, weight = np.polynomial.legendre.leggauss(rings)
    radius = disc[2] * np.sqrt((at + 1) / 2)
    nodes = (disc[:2] + radius[:, None, None] * circle).reshape(-1, 2)
    area = np.repeat(weight / 2 * np.pi * disc[2] ** 2 / turns, turns)
    px, growth = _images(matrix, nodes)
    area = area * growth
    fx, _ = _responses(places[:, 0], px[:, 0], variance)
    fy, _ = _responses(places[:, 1], px[:, 1], variance)
    covered = (fx * fy) @ area
    if not derivatives:
        return covered, None
    # The rim: its length element times its normal is the image of the step along it, turned by a right angle.
    rim = disc[:2] + disc[2] * circle
    px, _ = _images(matrix, rim)
    ahead = matrix @ np.concatenate([rim, np.ones((turns, 1))], axis=1).T
    tangent = np.stack([-circle[:, 1], circle[:, 0]], axis=1) * disc[2] * 2 * np.pi / turns
    along = ((matrix[:2, :2] @ tangent.T) - px.T * (matrix[2, :2] @ tangent.T)) / ahead[2]
    outward = np.stack([along[1], -along[0]], axis=1)
    # Marker Y is up and image y is down: the rim runs clockwise there, and the normal is the other one.
    if float(np.sum(outward * (px - px.mean(axis=0)))) < 0:
        outward = -outward
    fx, gx = _responses(places[:, 0], px[:, 0], variance)
    fy, gy = _responses(places[:, 1], px[:, 1], variance)
    both = fx * fy
    by_shift = both @ outward
    # The blur obeys the heat equation: the derivative by its variance is half the divergence of the gradient.
    by_variance = 0.5 * ((gx * fy) @ outward[:, 0] + (fx * gy) @ outward[:, 1])
    flow = _flow(rim)
    moved = np.einsum("ij,ngj->ngi", matrix[:2, :2], flow) - px[:, None] * (flow @ matrix[2, :2])[..., None]
    moved = moved / ahead[2][:, None, None]
    by_generator = both @ np.einsum("ngi,ni->ng", moved, outward)
    return covered, (by_shift, by_variance, by_generator)


def _images(matrix: Array, points: Array) -> tuple[Array, Array]:
    """Images (N, 2) of points of the plane, and the magnification of area there."""
    rays = np.concatenate([points, np.ones((len(points), 1))], axis=1) @ matrix.T
    return rays[:, :2] / rays[:, 2:], np.abs(np.linalg.det(matrix)) / np.abs(rays[:, 2]) ** 3


def _responses(pixels: Array, points: Array, variance: float) -> tuple[Array, Array]:
    """Response along one axis of pixels (N,) to blurred points (M,), (N, M), and its derivative by the point."""
    from scipy.special import ndtr

    sigma = math.sqrt(variance)
    # Without lens distortion the pixels are on a grid: few different coordinates.
    pixels, index = np.unique(pixels, return_inverse=True)
    u = (points[None] - pixels[:, None]) / sigma
    half = 0.5 / sigma
    above, below = u + half, u - half
    density = (np.exp(-0.5 * above**2) - np.exp(-0.5 * below**2)) / (sigma * math.sqrt(2 * math.pi))
    return (ndtr(above) - ndtr(below))[index], density[index]
