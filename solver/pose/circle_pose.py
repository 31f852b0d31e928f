"""Both poses of a circle of known radius from its image, in closed form.

The choice between them is the task of `solver.ambiguity`.

The cone over the image ellipse {c + S u, |u| = 1} has the dual A^-1 = p p^T - W W^T with p = K^-1 [c; 1] and
W = K^-1 [S; 0] (errata, section 2). The columns of the 3x3 matrix M = [W p] are orthogonalised with rotations that
preserve J = diag(-1, -1, 1): a one-sided Jacobi method (hyperbolic singular values). A^-1 = M J M^T is never formed, so
the small eigenvalues of an ellipse of 1e-5 px keep all their digits, whereas the eigenvalues of K^T C K lose them (the
errata measured 14 % there).

A few circles are solved in plain floats (`circle_pose_scalar`), many in chunks whose arrays stay in the processor's
cache (`circle_pose_batch`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.solver.pose.circle_pose_batch import (
    centre_and_shape_of_conic,
    centre_and_shape_of_ellipse,
    poses_of_shape,
)
from roundel.solver.pose.circle_pose_scalar import pose_of_conic, pose_of_ellipse

Array = NDArray[np.float64]

# About 25 arrays of a chunk are in use at a time: with 32 KiB each they fit a second-level cache of 1 MiB.
_CHUNK = 4096
_FEW = 24  # ellipses for which plain floats are faster


@dataclass(frozen=True)
class CirclePoses:
    """Both poses that explain one image of a circle.

    Attributes
    ----------
    normal : (..., 2, 3) array
        Unit normals out of the printed face, in the camera frame. Index 0 has the smaller normal_z (closer to
        fronto-parallel; the errata's candidate `+`); at a tie, the larger normal_x.
    centre_m : (..., 2, 3) array
        Centres of the circle in the camera frame, metres.
    """

    normal: Array
    centre_m: Array


def poses_from_conic(conic: ArrayLike, K: ArrayLike, radius_m: ArrayLike) -> CirclePoses:
    """Both poses of a circle from the conic of its image.

    A float64 conic represents an ellipse of semi-axis a px at d px from the origin only to about 1e-16 (d / a)^2; for
    very small ellipses call `poses_from_ellipse`, which has no such loss.

    Parameters
    ----------
    conic : (..., 3, 3) array_like
        In undistorted pixel coordinates, of any scale and sign.
    K : (..., 3, 3) array_like
        Calibration matrix, pixels; skew and unequal focal lengths are allowed. One for all, or one for each.
    radius_m : (...) array_like

    Returns
    -------
    CirclePoses
        Its leading axes are those of the three arguments, broadcast together.

    Raises
    ------
    ValueError
        If a conic is not an ellipse, K is singular, a radius is not positive, or a number is not finite.
    """
    c, k, radius = (np.asarray(v, dtype=np.float64) for v in (conic, K, radius_m))
    if c.shape == k.shape == (3, 3) and radius.ndim == 0:
        one = pose_of_conic(c.tolist(), k.tolist(), float(radius))
        if one is not None:
            return CirclePoses(np.array(one[0]), np.array(one[1]))
    if c.ndim < 2 or c.shape[-2:] != (3, 3):
        raise ValueError(f"a conic is a 3x3 matrix; this array has shape {c.shape}")
    return _in_chunks(c.reshape(*c.shape[:-2], 9), k, radius)


def poses_from_ellipse(ellipse: ArrayLike, K: ArrayLike, radius_m: ArrayLike) -> CirclePoses:
    """Both poses of a circle from the parameters of its image, to full accuracy at any size.

    Parameters
    ----------
    ellipse : (..., 5) array_like
        x_px, y_px, a_px, b_px (semi-axes, in any order), angle_deg from +x toward +y; undistorted pixel coordinates.
    K : (..., 3, 3) array_like
    radius_m : (...) array_like

    Returns
    -------
    CirclePoses

    Raises
    ------
    ValueError
        As `poses_from_conic`.
    """
    e, k, radius = (np.asarray(v, dtype=np.float64) for v in (ellipse, K, radius_m))
    if e.ndim and e.shape[-1] == 5 and e.size <= 5 * _FEW and k.shape == (3, 3) and radius.ndim == 0:
        rows, r = k.tolist(), float(radius)
        one_by_one = [pose_of_ellipse(one, rows, r) for one in e.reshape(-1, 5).tolist()]
        sound = [pair for pair in one_by_one if pair is not None]
        if len(sound) == len(one_by_one):
            pairs = np.array(sound).reshape(*e.shape[:-1], 2, 2, 3)
            return CirclePoses(pairs[..., 0, :, :].copy(), pairs[..., 1, :, :].copy())
    if e.ndim == 0 or e.shape[-1] != 5:
        raise ValueError(f"an ellipse has five parameters in its last axis; this array has shape {e.shape}")
    return _in_chunks(e, k, radius)


def poses_up_to_scale(ellipse: ArrayLike, K: ArrayLike) -> CirclePoses:
    """Both poses of a circle of unknown size: one image gives its normal, and its centre in units of its radius.

    `centre_m` is in units of the radius: multiply it by the radius to get the centre, and normalise it to get the
    direction. Its length is the distance in radii, twice that in diameters. Arguments as `poses_from_ellipse`.
    """
    return poses_from_ellipse(ellipse, K, 1.0)


def _in_chunks(image: Array, K: Array, radius: Array) -> CirclePoses:
    """Poses of conics (..., 9) or ellipses (..., 5)."""
    if not np.all(np.isfinite(radius) & (radius > 0)):
        raise ValueError("the radius must be a positive, finite number of metres")
    k = _calibration(K)
    try:
        leading = np.broadcast_shapes(image.shape[:-1], k.shape[:-1], radius.shape)
    except ValueError:
        raise ValueError(
            f"images {image.shape[:-1]}, matrices K {k.shape[:-1]} and radii {radius.shape} do not broadcast together"
        ) from None
    count = int(np.prod(leading))
    images = np.broadcast_to(image, (*leading, image.shape[-1])).reshape(count, image.shape[-1])
    many_k = k if k.ndim == 1 else np.broadcast_to(k, (*leading, 5)).reshape(count, 5)
    many_radii = radius if radius.ndim == 0 else np.broadcast_to(radius, leading).reshape(count)
    normal, centre = np.empty((count, 2, 3)), np.empty((count, 2, 3))
    for start in range(0, count, _CHUNK):
        part = slice(start, start + _CHUNK)
        columns = np.array(images[part].T, order="C")
        # Values beyond float64's range are detected at the end, in the result.
        with np.errstate(all="ignore"):
            of = centre_and_shape_of_conic if len(columns) == 9 else centre_and_shape_of_ellipse
            poses_of_shape(
                of(columns),
                many_k if many_k.ndim == 1 else np.array(many_k[part].T, order="C"),
                many_radii if many_radii.ndim == 0 else many_radii[part],
                (normal[part], centre[part]),
            )
    return CirclePoses(normal.reshape(*leading, 2, 3), centre.reshape(*leading, 2, 3))


def _calibration(K: Array) -> Array:
    """Fx, skew, cx, fy, cy: (..., 5)."""
    if K.ndim < 2 or K.shape[-2:] != (3, 3):
        raise ValueError(f"K must be a 3x3 matrix; this array has shape {K.shape}")
    if not np.all(np.isfinite(K)):
        raise ValueError("K has a value that is not finite")
    if np.any(K[..., 2, :2] != 0.0) or np.any(K[..., 1, 0] != 0.0):
        raise ValueError("K must be upper triangular, [[fx, skew, cx], [0, fy, cy], [0, 0, 1]]")
    if np.any(np.diagonal(K, axis1=-2, axis2=-1) == 0.0):
        raise ValueError("K is singular: its focal lengths and its last element must not be zero")
    return np.asarray(K.reshape(*K.shape[:-2], 9)[..., [0, 1, 2, 4, 5]] / K[..., 2, 2, None])
