"""The homography of a circle's plane, from the circle's image and the vanishing line alone.

Equation (1) of the paper in its corrected, general form (errata, section 1). It does not use a calibration, so it is
valid for any camera. H = S_I^-1 M S_P with

- S_I, the image's similarity: a translation and a rotation that move the ellipse to the origin, with its axes along x
  and y. In that frame the conic is C' = diag(C'11, C'22, C'33), and (u, v, 1) ~ C'^-1 v'_inf is the image of the
  circle's centre. Both must be in that frame: equation (1) is wrong with (u, v) in pixels.
- M, which maps the unit circle to C' and the origin to (u, v, 1):

        M = [ C'33    C'22 u v   u ]
            [  0        -g       v ] diag(r, 1, s),    g = C'11 u^2 + C'33,  q = C'11 u^2 + C'22 v^2 + C'33,
            [-C'11 u  C'22 v     1 ]                    r = sqrt(C'22 q / (C'11 C'33)),  s = sqrt(-C'22 g).

- S_P, the plane's similarity: here a scaling by 1 / radius.

Proof: multiply out M^T C' M = C'22 g q diag(1, 1, -1), M e3 = s (u, v, 1).
H is unique up to a rotation of the plane about the circle's centre, which a circle does not determine, and a
reflection, which the sign of r decides: det M = -g q r s is negative, because g and q have the same sign, and M e3 has
a positive third coordinate.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.geometry.conic import ellipse_of_conic

Array = NDArray[np.float64]


def homography_from_conic(conic: ArrayLike, vanishing_line: ArrayLike, radius_m: ArrayLike = 1.0) -> Array:
    """Homography from the plane of a circle to the image, from the circle's image and the plane's vanishing line.

    Parameters
    ----------
    conic : (..., 3, 3) array_like
        Image of the circle, of any scale and sign.
    vanishing_line : (..., 3) array_like
        Of any scale and sign; candidates come from `conic_pencil(conic, K).line`.
    radius_m : (...) array_like
        Radius of the circle in the plane's coordinates; 1 makes it the unit circle.

    Returns
    -------
    (..., 3, 3) array
        As `homography_from_ellipse`.

    Raises
    ------
    ValueError
        As `homography_from_ellipse`, or if the conic is not an ellipse.
    """
    c = np.asarray(conic, dtype=np.float64)
    if c.ndim < 2 or c.shape[-2:] != (3, 3) or not np.all(np.isfinite(c)):
        raise ValueError(f"a conic is a 3x3 matrix of finite numbers; this array has shape {c.shape}")
    return homography_from_ellipse(ellipse_of_conic(c), vanishing_line, radius_m)


def homography_from_ellipse(ellipse: ArrayLike, vanishing_line: ArrayLike, radius_m: ArrayLike = 1.0) -> Array:
    """Homography from the plane of a circle to the image, from the circle's ellipse and the plane's vanishing line.

    Parameters
    ----------
    ellipse : (..., 5) array_like
        x_px, y_px, a_px, b_px, angle_deg.
    vanishing_line : (..., 3) array_like
        Of any scale and sign.
    radius_m : (...) array_like

    Returns
    -------
    (..., 3, 3) array
        H with H[2, 2] = 1 maps (X_m, Y_m, 1) in the plane, origin at the circle's centre, to homogeneous pixels; the
        third coordinate is positive in front of the camera. Of the two orientations of the plane's axes it has
        det H < 0: Z = X x Y then points out of the printed face, toward the camera (for H ~ K [r1 r2 t] with t_z > 0,
        det = det K r3 . t / t_z^3 has the sign of normal . centre).

    Raises
    ------
    ValueError
        If the ellipse or the radius is invalid, or the vanishing line meets the ellipse, which is impossible for a
        circle that is entirely in front of the camera.
    """
    e, line = np.asarray(ellipse, dtype=np.float64), np.asarray(vanishing_line, dtype=np.float64)
    radius = np.asarray(radius_m, dtype=np.float64)
    if e.ndim == 0 or e.shape[-1] != 5 or not np.all(np.isfinite(e)) or not np.all(e[..., 2:4] > 0):
        raise ValueError("an ellipse is x, y, a, b, angle: five finite numbers, both semi-axes positive")
    if line.ndim == 0 or line.shape[-1] != 3 or not np.all(np.isfinite(line)):
        raise ValueError(f"a vanishing line is three finite numbers; this array has shape {line.shape}")
    if not np.all(np.isfinite(radius) & (radius > 0)):
        raise ValueError("the radius must be a positive, finite number of metres")
    angle = np.radians(e[..., 4])
    cos, sin, zero = np.cos(angle), np.sin(angle), np.zeros_like(angle)
    to_image = np.stack(
        [
            np.stack([cos, -sin, e[..., 0]], axis=-1),
            np.stack([sin, cos, e[..., 1]], axis=-1),
            np.stack([zero, zero, zero + 1.0], axis=-1),
        ],
        axis=-2,
    )  # S_I^-1; lines transform in the opposite direction with its transpose
    diagonal = np.stack([e[..., 2] ** -2.0, e[..., 3] ** -2.0, zero - 1.0], axis=-1)
    pole = (np.swapaxes(to_image, -1, -2) @ line[..., None])[..., 0] / diagonal
    with np.errstate(divide="ignore", invalid="ignore"):
        centre = pole[..., :2] / pole[..., 2:]
    h = to_image @ canonical_homography(diagonal, centre)
    h = h * np.stack(np.broadcast_arrays(1.0 / radius, 1.0 / radius, 1.0), axis=-1)[..., None, :]  # S_P
    return np.asarray(h / h[..., 2:, 2:], dtype=np.float64)


def canonical_homography(diagonal: ArrayLike, centre: ArrayLike) -> Array:
    """M of equation (1), corrected: maps the unit circle to diag(C'11, C'22, C'33) and the origin to (u, v).

    Parameters
    ----------
    diagonal : (..., 3) array_like
        C'11, C'22, C'33 of an ellipse, of any common scale and sign.
    centre : (..., 2) array_like
        u, v: image of the circle's centre in that frame.

    Returns
    -------
    (..., 3, 3) array
        M with M^T C' M ~ diag(1, 1, -1).

    Raises
    ------
    ValueError
        If the centre is not inside the ellipse, that is, the vanishing line meets it, or C' is not an ellipse.
    """
    c = np.asarray(diagonal, dtype=np.float64)
    c11, c22, c33 = (c[..., i] for i in range(3))
    u, v = (np.asarray(centre, dtype=np.float64)[..., i] for i in range(2))
    if not np.all((c11 * c22 > 0) & (c11 * c33 < 0)):
        raise ValueError("C' must be the diagonal of a real ellipse: C'11 and C'22 of the same sign, C'33 of the other")
    g = c11 * u * u + c33
    q = g + c22 * v * v
    if not np.all(c33 * q > 0):
        raise ValueError("the vanishing line meets the ellipse: the circle is not entirely in front of the camera")
    r, s = np.sqrt(c22 * q / (c11 * c33)), np.sqrt(-c22 * g)
    zero, one = np.zeros_like(q), np.ones_like(q)
    rows = [[c33 * r, c22 * u * v, u * s], [zero, -g, v * s], [-c11 * u * r, c22 * v, one * s]]
    return np.stack([np.stack(np.broadcast_arrays(*row, one)[:3], axis=-1) for row in rows], axis=-2)
