"""Identities between a circle's image, its centre, the vanishing line, the circular points and the focal length.

C is the conic of the circle's image, C* its inverse (its dual conic), o the image of the circle's centre, v the
vanishing line of its plane, omega = K^-T K^-1. All of them hold for any camera:

    v ~ C o,    o ~ C* v,    Cinf* ~ C* - (C* v)(C* v)^T / (v^T C* v),

where Cinf* = I J^T + J I^T is the dual conic of the images I, J of the plane's circular points, the points in which v
meets every circle of the plane. They lie on omega; for square pixels, and with the principal point at the origin, that
is I1^2 + I2^2 + I3^2 / f^2 = 0, so f^2 = -(I1^2 + I2^2) / I3^2.

Where the line is far away (a plane parallel to the image), I3 vanishes with I1^2 + I2^2: f is not determined.

Source: R. Hartley, A. Zisserman, Multiple View Geometry (2004), sections 2.2, 3.7, 8.8; the paper, section III. The
functions take arrays with any leading axes; lengths are in any unit of the image that is about as large as it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.geometry.conic import ellipse_of_conic

Array = NDArray[np.float64]

# Of a circular point's length: a third coordinate that is smaller is rounding, its line is at infinity.
_AT_INFINITY = 1e-7


def dual_conic(conic: ArrayLike) -> Array:
    """Inverse (..., 3, 3) of a conic, of unit Frobenius norm.

    Raises
    ------
    ValueError
        If a conic is singular or not finite.
    """
    c = np.asarray(conic, dtype=np.float64)
    if c.ndim < 2 or c.shape[-2:] != (3, 3) or not np.all(np.isfinite(c)):
        raise ValueError(f"a conic is a 3x3 matrix of finite numbers; this array has shape {c.shape}")
    # Elements of a conic in pixels differ by the square of the image's size; the adjugate keeps the digits of each.
    rows = [np.cross(c[..., (i + 1) % 3, :], c[..., (i + 2) % 3, :]) for i in range(3)]
    dual = np.stack(rows, axis=-2)
    if np.any(np.sum(c[..., 0, :] * dual[..., 0, :], axis=-1) == 0.0):
        raise ValueError("the conic is a pair of lines, not the image of a circle")
    return np.asarray(dual / np.linalg.norm(dual, axis=(-2, -1), keepdims=True))


def line_from_centre(conic: ArrayLike, centre: ArrayLike) -> Array:
    """Vanishing line (..., 3) of a circle's plane from the image of its centre: the polar v ~ C o, of unit norm."""
    return _unit(_times(np.asarray(conic, dtype=np.float64), np.asarray(centre, dtype=np.float64)))


def centre_from_line(conic: ArrayLike, line: ArrayLike) -> Array:
    """Image (..., 3) of the circle's centre from the vanishing line: the pole o ~ C* v, of unit norm."""
    return _unit(_times(dual_conic(conic), np.asarray(line, dtype=np.float64)))


def dual_circular_points(conic: ArrayLike, line: ArrayLike) -> Array:
    """Image Cinf* (..., 3, 3) of the dual conic of the circular points, of unit Frobenius norm and positive trace.

    Parameters
    ----------
    conic : (..., 3, 3) array_like
        Image of a circle.
    line : (..., 3) array_like
        Vanishing line of its plane.
    """
    star, v = dual_conic(conic), np.asarray(line, dtype=np.float64)
    pole = _times(star, v)
    out = star - pole[..., :, None] * pole[..., None, :] / np.sum(v * pole, axis=-1)[..., None, None]
    out = out / np.linalg.norm(out, axis=(-2, -1), keepdims=True)
    sign = np.where(np.trace(out, axis1=-2, axis2=-1) < 0, -1.0, 1.0)
    return np.asarray(out * sign[..., None, None])


def circular_points(dual: ArrayLike) -> NDArray[np.complex128]:
    """Circular point I = h1 + i h2 (..., 3) of Cinf* = U diag(a, b, 0) U^T, h1 = sqrt(a) u1, h2 = sqrt(b) u2.

    Its conjugate is the other one. h1 and h2 are images of two orthogonal directions, of equal length in the plane.
    The smallest eigenvalue is taken as zero, which makes the best conic of rank 2 of a mean of several.
    """
    values, vectors = np.linalg.eigh(np.asarray(dual, dtype=np.float64))
    roots = np.sqrt(np.maximum(values[..., 1:], 0.0))
    h = vectors[..., :, 1:] * roots[..., None, :]
    return np.asarray(h[..., 1] + 1j * h[..., 0])


def inverse_focal_squared(point: ArrayLike) -> Array:
    """1 / f^2 from circular points (..., 3), the principal point at the origin: -Re(I3^2 / (I1^2 + I2^2)).

    The imaginary part is zero for exact points. The result is negative or zero if no camera with square pixels and this
    principal point sees these points.
    """
    i = np.asarray(point, dtype=np.complex128)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(-np.real(i[..., 2] ** 2 / (i[..., 0] ** 2 + i[..., 1] ** 2)), dtype=np.float64)


def focal_from_dual(dual: ArrayLike) -> float:
    """Focal length from Cinf* (3, 3), for square pixels; the principal point is at the origin.

    Raises
    ------
    ValueError
        If the plane is parallel to the image, where every focal length fits, or if none does.
    """
    d = np.asarray(dual, dtype=np.float64)
    point = circular_points(d / np.linalg.norm(d))
    if abs(point[2]) < _AT_INFINITY * float(np.linalg.norm(point)):
        raise ValueError(
            "the circles are parallel to the image: their vanishing line is at infinity, and every focal length "
            "explains them; tilt their plane"
        )
    inverse = float(inverse_focal_squared(point))
    if not inverse > 0:
        raise ValueError(
            "no focal length fits: with this principal point and square pixels the circular points lie on no camera's "
            "absolute conic; the plane is too near to parallel to the image, or the circles are too far away"
        )
    return 1.0 / float(np.sqrt(inverse))


def focal_from_line(conics: ArrayLike, line: ArrayLike, principal_point: ArrayLike) -> float:
    """Focal length in pixels from circles of one plane and its vanishing line, for square pixels.

    Parameters
    ----------
    conics : (N, 3, 3) array_like
        Images of the circles, in undistorted pixels.
    line : (3,) array_like
        In the same pixels.
    principal_point : (2,) array_like

    Raises
    ------
    ValueError
        As `focal_from_dual`; or if a conic is not an ellipse.
    """
    principal = np.asarray(principal_point, dtype=np.float64)
    images = np.asarray(conics, dtype=np.float64)
    x, y, a, _, _ = ellipse_of_conic(images[0])
    size = float(np.hypot(x - principal[0], y - principal[1]) + a)
    frame = image_frame(principal, size)
    moved = _unit(np.asarray(line, dtype=np.float64) @ np.linalg.inv(frame))
    return size * focal_from_dual(dual_circular_points(moved_conic(images, frame), moved).mean(axis=0))


def normal_from_line(line: ArrayLike, K: ArrayLike) -> Array:
    """Unit normal (..., 3) of a plane in the camera frame, with z <= 0 (toward the camera), from its vanishing line.

    A plane whose vanishing line passes through the principal point has z = 0: the sign is then arbitrary.
    """
    normal = _unit(np.asarray(line, dtype=np.float64) @ np.asarray(K, dtype=np.float64))
    return np.asarray(np.where(normal[..., 2:] > 0, -normal, normal))


def image_frame(principal_point: ArrayLike, size_px: float) -> Array:
    """Matrix (3, 3) from pixels to coordinates with the principal point at the origin and `size_px` as the unit.

    Points transform as T x, lines as T^-T v, conics as T^-T C T^-1.
    """
    x, y = np.asarray(principal_point, dtype=np.float64)
    return np.array([[1.0, 0.0, -x], [0.0, 1.0, -y], [0.0, 0.0, size_px]]) / size_px


def moved_conic(conic: ArrayLike, frame: ArrayLike) -> Array:
    """Conics (..., 3, 3) in the coordinates of `image_frame`, positive inside, of unit norm."""
    inverse = np.linalg.inv(np.asarray(frame, dtype=np.float64))
    c = inverse.T @ np.asarray(conic, dtype=np.float64) @ inverse
    c = (c + np.swapaxes(c, -1, -2)) / (2.0 * np.linalg.norm(c, axis=(-2, -1), keepdims=True))
    return np.asarray(c * np.where(np.linalg.det(c) < 0, -1.0, 1.0)[..., None, None])


def _times(matrix: Array, vector: Array) -> Array:
    return np.asarray((matrix @ vector[..., None])[..., 0])


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector, axis=-1, keepdims=True))
