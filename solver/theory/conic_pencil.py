"""The pencil of a circle's image and the image of the absolute conic, omega = K^-T K^-1: the paper's framework.

Among the conics C - l omega three are degenerate, one for each generalised eigenvalue. That of the middle eigenvalue is
a pair of real lines: the vanishing line of the circle's plane, and the vanishing line of the other plane that explains
the image. All three meet in the vertices of the common self-polar triangle (the paper's "base points").

Everything is invariant: for K x' = x the pair (C, omega) becomes (A, I) with A = K^T C K, so that generalised
eigenvectors are K times the orthonormal eigenvectors e_i of A.

Source: the paper, section IV-A, with the corrections of the errata, section 2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# l2 and l3 have rounding errors of about 1e-16 of l3; closer than this they are equal. The normals are then 4e-7 rad
# apart.
_DOUBLE_ROOT = 1e-13
# Two normals whose z differ by less are tied, as in `solver.pose.circle_pose`.
_TIE = 1e-12


@dataclass(frozen=True, eq=False)
class ConicPencil:
    """The pencil C - l omega of an ellipse, C and omega scaled to determinant 1.

    Attributes
    ----------
    eigenvalue : (..., 3) array
        l1 > 0 > l2 >= l3, of product 1.
    axis : (..., 3, 3) array
        Rows e1, e2, e3: orthonormal, in the camera frame; e1 and e3 point forward. e1 is the axis of the viewing cone
        that passes through the ellipse.
    base_point : (..., 3, 3) array
        Rows z1, z2, z3 ~ K e_i, homogeneous pixels, z_i^T omega z_j = 1 if i = j, else 0. z1 (inside the ellipse) and
        z3 are the images of the limiting points, z2 the vanishing point of the direction in the circle's plane
        that is orthogonal to the line from the foot of the camera to the circle's centre.
    member : (..., 3, 3, 3) array
        D1, D2, D3 with D_i = C - l_i omega and D_i z_i = 0.
    line : (..., 2, 3) array
        v = a + b and a - b, the lines of D2 = (v1 v2^T + v2 v1^T) / 2: candidates for the vanishing line.
    normal : (..., 2, 3) array
        The corresponding unit normals out of the printed face, -K^T v, in the order of `CirclePoses`.
    single : (...) array of bool
        The camera is on the circle's axis: l2 = l3, both lines coincide, D2 has rank 1, and e2, e3 are any two
        directions orthogonal to e1.
    """

    eigenvalue: Array
    axis: Array
    base_point: Array
    member: Array
    line: Array
    normal: Array
    single: NDArray[np.bool_]


def absolute_conic(K: ArrayLike) -> Array:
    """Image of the absolute conic, omega = K^-T K^-1, scaled to determinant 1.

    Parameters
    ----------
    K : (3, 3) array_like
        Calibration matrix, pixels; skew and unequal focal lengths are allowed.

    Returns
    -------
    (3, 3) array

    Raises
    ------
    ValueError
        If K is not a calibration matrix.
    """
    inverse = np.linalg.inv(_unit_calibration(K))
    return np.asarray(inverse.T @ inverse, dtype=np.float64)


def conic_pencil(conic: ArrayLike, K: ArrayLike) -> ConicPencil:
    """The pencil of an ellipse and the image of the absolute conic.

    - Signs: C > 0 inside has the signature (1, 2), like every ellipse; so det C > 0 and l1 > 0 > l2 >= l3. -C has the
      eigenvalues -l: the middle one remains the middle one, z1 and z3 are exchanged.
    - Signatures (#positive, #negative) of D1, D2, D3: their eigenvalues relative to omega are l_j - l_i, so (0, 2),
      (1, 1), (2, 0): only D2 is a pair of real lines.
    - Lines: sum over i of l_i e_i e_i^T minus l2 I = (l1 - l2) e1 e1^T - (l2 - l3) e3 e3^T is a difference of squares,
      (a' + b')(a' - b'), a' = sqrt(l1 - l2) e1, b' = sqrt(l2 - l3) e3; as lines of the image a = K^-T a' =
      sqrt(l1 - l2) omega z1 and b likewise. (The printed (2) and (3) are valid only for omega ~ I.)
    - Normals: N ~ K^T v = a' +- b', of length sqrt(l1 - l3).

    The normals are accurate to about 1e-15, magnified like the root of l2 - l3 if that is small; only l1 loses digits
    for small ellipses, 1e-16 (d / a)^2 for a semi-axis of a px at d px, which is the loss of the conic itself.

    Parameters
    ----------
    conic : (..., 3, 3) array_like
        In undistorted pixel coordinates, of any scale and sign.
    K : (3, 3) array_like

    Returns
    -------
    ConicPencil

    Raises
    ------
    ValueError
        If a conic is not an ellipse, K is not a calibration matrix, or a number is not finite.
    """
    c, k = _checked_ellipse(conic), _unit_calibration(K)
    values, vectors = np.linalg.eigh(np.swapaxes(k, -1, -2) @ c @ k)
    # Descending for an ellipse that is positive inside; else the conic and its eigenvalues are negated.
    flip = values[..., 1] > 0
    values = np.where(flip[..., None], -values, values[..., ::-1])
    axis = np.swapaxes(np.where(flip[..., None, None], vectors, vectors[..., ::-1]), -1, -2)
    if not np.all((values[..., 0] > 0) & (values[..., 1] < 0)):
        raise ValueError("not an ellipse: the conic has no real points, or it is too small for its digits")
    root = np.cbrt(np.prod(values, axis=-1, keepdims=True))
    eigenvalue = values / root
    l1, l2, l3 = (eigenvalue[..., i, None] for i in range(3))
    single = (l2 - l3)[..., 0] <= _DOUBLE_ROOT * -l3[..., 0]
    a = np.sqrt(l1 - l2)
    b = np.where(single[..., None], 0.0, np.sqrt(l2 - l3))

    axis = _forward(axis, (b / np.sqrt(l1 - l3))[..., 0])
    along, across = a * axis[..., 0, :], b * axis[..., 2, :]
    back_projected = np.stack([along + across, along - across], axis=-2)
    scaled = np.where(flip[..., None, None], -c, c) / root[..., None]
    return ConicPencil(
        eigenvalue=eigenvalue,
        axis=axis,
        base_point=axis @ k.T,
        member=scaled[..., None, :, :] - eigenvalue[..., None, None] * absolute_conic(k),
        line=back_projected @ np.linalg.inv(k),
        normal=-back_projected / np.sqrt(l1 - l3)[..., None],
        single=np.asarray(single),
    )


def signature(conic: ArrayLike, K: ArrayLike | None = None, tolerance: float = 1e-10) -> NDArray[np.int64]:
    """Numbers of positive and of negative eigenvalues, (..., 2).

    (The paper's footnote defines (max, min) of both, which does not distinguish (2, 0) from (0, 2).) The numbers do not
    depend on coordinates (Sylvester), but rounding does, so conics of an image are counted in those of the camera,
    K^T C K.

    Parameters
    ----------
    conic : (..., 3, 3) array_like
        Symmetric.
    K : (3, 3) array_like, optional
        Pass it for conics in pixel coordinates.
    tolerance : float
        Eigenvalues smaller than this fraction of the largest count as zero.
    """
    c = np.asarray(conic, dtype=np.float64)
    if K is not None:
        k = _unit_calibration(K)
        c = k.T @ c @ k
    values = np.linalg.eigvalsh(c)
    zero = tolerance * np.max(np.abs(values), axis=-1, keepdims=True)
    return np.stack([np.sum(values > zero, axis=-1), np.sum(values < -zero, axis=-1)], axis=-1)


def _forward(axis: Array, sine: Array) -> Array:
    """Axes with e1 and e3 pointing forward, so that a + b belongs to the smaller normal_z (at a tie, the larger x)."""
    e1, e2, e3 = (axis[..., i, :] for i in range(3))
    e1 = np.where(e1[..., 2:] < 0, -e1, e1)
    x, y, z = (2.0 * sine * e3[..., i] for i in range(3))  # differences of both normals, a - b minus a + b
    back = np.where(np.abs(z) > _TIE, z < 0, np.where(np.abs(x) > _TIE, x > 0, y > 0))
    e3 = np.where(back[..., None], -e3, e3)
    return np.stack([e1, e2, e3], axis=-2)


def _checked_ellipse(conic: ArrayLike) -> Array:
    c = np.asarray(conic, dtype=np.float64)
    if c.ndim < 2 or c.shape[-2:] != (3, 3):
        raise ValueError(f"a conic is a 3x3 matrix; this array has shape {c.shape}")
    if not np.all(np.isfinite(c)):
        raise ValueError("the conic has a value that is not finite")
    norm = np.linalg.norm(c, axis=(-2, -1), keepdims=True)
    if np.any(norm == 0.0):
        raise ValueError("not an ellipse: the conic is the zero matrix")
    c = (c + np.swapaxes(c, -1, -2)) / (2.0 * norm)
    if not np.all(c[..., 0, 0] * c[..., 1, 1] > c[..., 0, 1] ** 2):
        raise ValueError("not an ellipse: the conic is a hyperbola, a parabola or a pair of lines")
    return np.asarray(c)


def _unit_calibration(K: ArrayLike) -> Array:
    """K scaled to determinant 1, or -1 if an axis is mirrored, so that the third row stays positive."""
    k = np.asarray(K, dtype=np.float64)
    if k.shape != (3, 3):
        raise ValueError(f"K must be one 3x3 matrix; this one has shape {k.shape}")
    if not np.all(np.isfinite(k)):
        raise ValueError("K has a value that is not finite")
    if np.any(k[2, :2] != 0.0) or k[1, 0] != 0.0:
        raise ValueError("K must be upper triangular, [[fx, skew, cx], [0, fy, cy], [0, 0, 1]]")
    if np.any(np.diag(k) == 0.0):
        raise ValueError("K is singular: its focal lengths and its last element must not be zero")
    k = k / k[2, 2]
    return np.asarray(k / np.cbrt(abs(k[0, 0] * k[1, 1])))
