"""The ellipse that a least-squares fit finds on a contour that is not quite one, and its derivative.

A lens with distortion images a circle to a curve that no ellipse fits. The fit to the pixels (`solver.fit.pixel_fit`)
weighs all of a contour's length alike, so its ellipse is that of least squared normal distances d to the contour:
G^T W d = 0, with the derivatives G of the distances by the ellipse and the lengths W of the contour. A model of camera
and board predicts the contour; the same functional reduces it to the five numbers that were measured.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_STEPS = 3  # Gauss-Newton from the first harmonic: each squares the error, which starts at a hundredth of the radius
_FOOT_STEPS = 4  # Newton for the foot points, which starts at a thousandth of the radius


def fitted_ellipses(contours_px: Array, steps: int = _STEPS) -> tuple[Array, Array]:
    """Least-squares ellipses of contours.

    Parameters
    ----------
    contours_px : (N, n, 2) array
        Points of each contour, once round in order, at even angles of the imaged circle.
    steps : int
        Gauss-Newton steps.

    Returns
    -------
    theta : (N, 5) array
        x, y, S11, S12, S22 of the contours {(x, y) + S u, |u| = 1}, see `EllipseFit.shape_cov`.
    by_point : (N, 5, n, 2) array
        Derivative of theta by the points: of the stationary value, to first order in the distances.
    """
    n = contours_px.shape[1]
    turn = 2 * np.pi * np.arange(n) / n
    centre = contours_px.mean(axis=1)
    local = contours_px - centre[:, None]
    # The first harmonic maps the circle's angle to the image: A (cos, sin); S is the symmetric factor of A = S Q.
    harmonic = np.stack([np.cos(turn), np.sin(turn)], axis=1) * (2 / n)
    a = np.einsum("Nki,kj->Nij", local, harmonic)
    theta = np.concatenate([centre, _symmetric_root(a @ a.transpose(0, 2, 1))], axis=1)
    length = np.linalg.norm(along_contours(local), axis=-1)
    weight = length / length.sum(axis=1, keepdims=True)
    for _ in range(steps):
        distance, _, design = _distances(theta, contours_px)
        theta = theta + np.einsum("Npk,Nk->Np", _pseudo_inverse(design, weight), distance)
    _, normal, design = _distances(theta, contours_px)
    return theta, np.einsum("Npk,Nki->Npki", _pseudo_inverse(design, weight), normal)


def along_contours(contours_px: Array) -> Array:
    """Derivative (N, n, 2) of contours by the angle, from their Fourier series."""
    n = contours_px.shape[1]
    waves = np.fft.rfft(contours_px, axis=1) * (1j * np.arange(n // 2 + 1))[:, None]
    return np.asarray(np.fft.irfft(waves, n, axis=1))


def _pseudo_inverse(design: Array, weight: Array) -> Array:
    """(G^T W G)^-1 G^T W, (N, 5, n)."""
    weighted = design * weight[..., None]
    return np.asarray(np.linalg.solve(weighted.transpose(0, 2, 1) @ design, weighted.transpose(0, 2, 1)))


def _symmetric_root(square: Array) -> Array:
    """S11, S12, S22 of the positive root S of S S = M, (N, 2, 2) to (N, 3)."""
    # Cayley-Hamilton: S = (M + det S) / tr S.
    determinant = np.sqrt(np.maximum(np.linalg.det(square), 0.0))
    trace = np.sqrt(square[:, 0, 0] + square[:, 1, 1] + 2 * determinant)
    return np.asarray(
        np.stack([square[:, 0, 0] + determinant, square[:, 0, 1], square[:, 1, 1] + determinant], axis=1)
        / trace[:, None]
    )


def _distances(theta: Array, points_px: Array) -> tuple[Array, Array, Array]:
    """Signed normal distances (N, n), outer normals (N, n, 2), and design G (N, n, 5), the derivative of -distance."""
    s = np.stack([theta[:, 2], theta[:, 3], theta[:, 3], theta[:, 4]], axis=1).reshape(-1, 2, 2)
    inverse = np.linalg.inv(s)
    local = points_px - theta[:, None, :2]
    u = local @ inverse
    turn = np.arctan2(u[..., 1], u[..., 0])
    for _ in range(_FOOT_STEPS):
        u = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        along = np.stack([-u[..., 1], u[..., 0]], axis=-1) @ s
        miss = local - u @ s
        # f(t) = |p - S u(t)|^2 / 2: f' = -miss . S u', f'' = |S u'|^2 + miss . S u.
        slope = np.einsum("Nki,Nki->Nk", miss, along)
        bend = np.einsum("Nki,Nki->Nk", along, along) + np.einsum("Nki,Nki->Nk", miss, u @ s)
        turn = turn + slope / bend
    u = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    normal = u @ inverse
    normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    distance = np.einsum("Nki,Nki->Nk", local - u @ s, normal)
    cross = normal[..., 0] * u[..., 1] + normal[..., 1] * u[..., 0]
    design = np.stack(
        [normal[..., 0], normal[..., 1], normal[..., 0] * u[..., 0], cross, normal[..., 1] * u[..., 1]], axis=-1
    )
    return distance, normal, design
