"""Huang: common self-polar triangles of two concentric circles in three or more views give the calibration matrix.

A triangle is self-polar with respect to a conic if each side is the polar of the opposite vertex. Two concentric
circles have infinitely many in common. All of them share one vertex, the centre, and the side opposite to it, the line
at infinity; each is right-angled at the centre, because two points at infinity that are conjugate for a circle are
orthogonal directions. In an image the vertices are generalised eigenvectors of (C1, C2): the odd one is o, the image
of the centre; the double eigenvalue has a plane of eigenvectors, not two, and that plane is the vanishing line v = C o.
Any two points p, q of v with p^T C q = 0 are vanishing points of orthogonal directions: p^T omega q = 0. Two such
pairs, (p, q) and, for p^T C p = q^T C q, (p + q, p - q), are all that a view tells; three views give the five numbers
of omega = K^-T K^-1 linearly.

Read was the paper's abstract; the derivation is our own. Of images, the principal point and the shape of the pixels are
taken from the view's camera, so that one number remains, the focal length of all views together; its linear solution is
refined with the ellipses of all views (`coplanar_circles`, concentric).

Source: H. Huang, H. Zhang, Y.-M. Cheung, The common self-polar triangle of concentric circles and its application to
camera calibration, CVPR (2015).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.geometry.conic import ellipse_of_conic
from roundel.solver.fit.ellipse import FailedFit
from roundel.solver.methods.plugin import Found, MethodFailure, View
from roundel.solver.pose.coplanar_circles import fit_coplanar
from roundel.solver.pose.focal_uncertainty import MeasuredFocal, profiled_focal
from roundel.solver.related.kim2005 import concentric_pair, measured_pair
from roundel.solver.views.circles_of_view import CircleImage, circles_of_view, require_kind
from roundel.solver.views.plane_of_view import LARGEST_SIGMA, founds_in_plane, measurements, refuse_misfit

Array = NDArray[np.float64]

LEAST_VIEWS = 3
# Smallest ratio of singular values of the constraints that still determine a camera: exact conics leave 1e-13.
_UNDETERMINED = 1e-9


@dataclass(frozen=True, eq=False)
class SelfPolarTriangles:
    """The common self-polar triangles of two concentric circles' images.

    Attributes
    ----------
    centre : (3,) array
        The vertex that all share, homogeneous.
    line : (3,) array
        The side that all share, of unit norm.
    pairs : (2, 2, 3) array
        Two pairs of vertices on it, each an orthogonal pair of vanishing points.
    """

    centre: Array
    line: Array
    pairs: Array


def self_polar_triangles(outer: ArrayLike, inner: ArrayLike, tolerance: float = 1e-5) -> SelfPolarTriangles:
    """Common self-polar triangles of the images of two concentric circles (3, 3).

    Raises
    ------
    ValueError
        As `concentric_pair`.
    """
    pair = concentric_pair(outer, inner, tolerance)
    x, y, a, b, angle = ellipse_of_conic(outer)
    cos, sin = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    to_px = np.array([[a * cos, -b * sin, x], [a * sin, b * cos, y], [0.0, 0.0, 1.0]])
    # In the frame of the outer ellipse C is diag(-1, -1, 1): p is the direction of the line, q its point nearest to the
    # origin, which are conjugate, each scaled to p^T C p = q^T C q = -1.
    u, v, w = pair.line @ to_px
    length = math.hypot(u, v)
    along = np.array([-v, u, 0.0]) / length
    # -|q|^2 + q3^2 = -1 on u q1 + v q2 + w q3 = 0, q orthogonal to p: q = (-w u, -w v, length^2) / (length s).
    s = math.sqrt(max(w * w - length * length, 0.0))
    nearest = np.array([-w * u, -w * v, length * length]) / (length * s) if s > 0 else np.array([u, v, 0.0]) / length
    p, q = to_px @ along, to_px @ nearest
    return SelfPolarTriangles(np.append(pair.centre_px, 1.0), pair.line, np.array([[p, q], [p + q, p - q]]))


def calibration_of_views(outer: ArrayLike, inner: ArrayLike, tolerance: float = 1e-5) -> Array:
    """Calibration matrix from two concentric circles in three views or more.

    Parameters
    ----------
    outer, inner : (n, 3, 3) array_like
        Images of the circles in each view, in undistorted pixels of one camera, which may have skew and pixels of any
        shape.
    tolerance : float
        See `concentric_pair`.

    Returns
    -------
    (3, 3) array
        Upper triangular, K[2, 2] = 1.

    Raises
    ------
    ValueError
        If there are fewer than three views, circles are not concentric, or the views do not determine a camera: the
        planes are parallel to each other, as after a pure translation.
    """
    c1, c2 = np.asarray(outer, dtype=np.float64), np.asarray(inner, dtype=np.float64)
    _refuse_few(len(c1))
    triangles = [self_polar_triangles(one, two, tolerance) for one, two in zip(c1, c2, strict=True)]
    ellipses = ellipse_of_conic(c1)
    middle = ellipses[:, :2].mean(axis=0)
    size = float(np.max(np.hypot(*(ellipses[:, :2] - middle).T) + ellipses[:, 2]))
    # The unit is of the order of a focal length; omega's elements are then of one order.
    unit = 3.0 * size
    frame = np.array([[1.0, 0.0, -middle[0]], [0.0, 1.0, -middle[1]], [0.0, 0.0, unit]]) / unit
    rows = []
    for triangle in triangles:
        for p, q in triangle.pairs @ frame.T:
            p, q = p / np.linalg.norm(p), q / np.linalg.norm(q)
            rows.append(
                [
                    p[0] * q[0],
                    p[0] * q[1] + p[1] * q[0],
                    p[1] * q[1],
                    p[0] * q[2] + p[2] * q[0],
                    p[1] * q[2] + p[2] * q[1],
                    p[2] * q[2],
                ]
            )
    _, values, vectors = np.linalg.svd(np.array(rows))
    if values[4] < _UNDETERMINED * values[0]:
        raise ValueError(
            "the views do not determine the camera: too many planes of the circles are parallel to each other, as "
            "after a pure translation; turn camera or marker between the views"
        )
    a, b, c, d, e, f = vectors[5]
    omega = np.array([[a, b, d], [b, c, e], [d, e, f]]) * np.sign(a + c)
    try:
        root = np.linalg.cholesky(omega)  # omega = L L^T, K^-1 ~ L^T
    except np.linalg.LinAlgError:
        raise ValueError("no camera fits the views: their circles are not concentric, or too noisy") from None
    k = np.linalg.inv(frame) @ np.linalg.inv(root.T)
    return np.asarray(k / k[2, 2])


def find(view: View) -> list[Found]:
    """Focal length from this view and its companions, and the pose of the marker in this one."""
    require_kind(view, "ring", "rings", "coded_rings", "ring_code")
    own = _pair_of(view)
    if own is None:
        return []
    pairs = [own, *(pair for other in view.companions() if (pair := _pair_of(other)) is not None)]
    _refuse_few(len(pairs), MethodFailure)
    measured = focal_of_pairs(pairs, view.camera.K)
    if measured is not None and not measured.sigma <= LARGEST_SIGMA:
        measured = None
    ratio = math.sqrt(float(np.prod(own[1].ellipse[2:4]) / np.prod(own[0].ellipse[2:4])))
    return founds_in_plane(view, own, view.diameter_m * np.array([1.0, ratio]), measured, concentric=True)[:1]


def focal_of_pairs(pairs: Sequence[Sequence[CircleImage]], K: Array) -> MeasuredFocal | None:
    """Focal length that all views agree on best; None if they do not determine it. The focal length of K is not used.

    Raises
    ------
    MethodFailure
        If the circles of fewer than three pairs are concentric.
    """
    parts, starts = [], []
    problem = ""
    for pair in pairs:
        try:
            ellipses, covs = measurements(pair)
            fit = measured_pair(pair, K)
            if isinstance(fit, FailedFit):
                raise MethodFailure(fit.reason)
            refuse_misfit(fit, "the circles are not concentric")
        except ValueError as error:
            problem = problem or f": in a view {error}"
            continue
        parts.append((ellipses, covs, fit.normal))
        starts.append((math.log(fit.focal_px), 1.0 / max(fit.focal_sigma, 1e-6) ** 2))
    if len(parts) < LEAST_VIEWS:
        raise MethodFailure(
            f"{len(parts)} of {len(pairs)} views have concentric circles; it needs {LEAST_VIEWS}{problem}"
        )
    where, weight = np.array(starts).T
    if not weight.any():
        return None

    def chi2(log_focal: float) -> float:
        k = np.array(K)
        k[:2, :2] *= math.exp(log_focal) / K[0, 0]
        total = 0.0
        for ellipses, covs, normal in parts:
            fit = fit_coplanar(ellipses, covs, k, normal, concentric=True, focal_known=True)
            total += math.inf if isinstance(fit, FailedFit) else fit.chi2
        return total

    return profiled_focal(chi2, float(np.average(where, weights=weight)), float(weight.sum()) ** -0.5)


def _pair_of(view: View) -> tuple[CircleImage, CircleImage] | None:
    """The strongest outer circle with the inner one that is nearest to half its size."""
    for circle in circles_of_view(view, inner=True):
        if circle.inner:
            half = 0.5 * float(circle.ellipse[2])
            return circle, min(circle.inner, key=lambda inner: abs(float(inner.ellipse[2]) - half))
    return None


def _refuse_few(count: int, kind: type[ValueError] = ValueError) -> None:
    if count < LEAST_VIEWS:
        raise kind(f"it needs {LEAST_VIEWS} views of two concentric circles by one camera or more; there are {count}")
