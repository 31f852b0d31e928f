"""Pollefeys: three or more views give the calibration of each by the absolute dual quadric.

The absolute dual quadric Omega, a 4x4 matrix of rank 3, projects to the dual image of the absolute conic:

    omega*_i = K_i K_i^T ~ P_i Omega P_i^T.

In coordinates with the principal point at the origin, for square pixels without skew, omega*_12 = omega*_13 =
omega*_23 = 0 and omega*_11 = omega*_22: four linear equations a view in the ten elements of Omega, whatever the focal
length of each view is. Three views or more determine it, and it upgrades the projective reconstruction to a metric one.
Views that are only translated, or only turned about the optical axis, leave a family of solutions (critical motions:
P. Sturm, CVPR 1997), seen in the singular values.

This linear self-calibration is complete (`dual_quadric`, `calibrations`, `metric_upgrade`). What differs for images of
markers (`find`): their circles lie in one plane, of which no projective reconstruction exists. What the plane shows of
the quadric is Cinf*_i = H_i diag(1, 1, 0) H_i^T: omega*_i less a matrix of rank 1, so that the first two columns h1, h2
of H_i satisfy h1^T omega h2 = 0 and h1^T omega h1 = h2^T omega h2. Of three views or more, with dots of known places,
one focal length that all share follows linearly, then by the least Mahalanobis distance of these equations with the
covariances of the homographies (`roundel.solver.pose.plane_homography`). The paper's refinement by bundle adjustment is
left out.

Read was the paper's abstract and what textbooks say of it: R. Hartley, A. Zisserman, Multiple View Geometry (2004),
section 19.3.
Source: M. Pollefeys, R. Koch, L. Van Gool, Self-calibration and metric reconstruction in spite of varying and unknown
intrinsic camera parameters, Int. J. Computer Vision 32(1) (1999).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.solver.fit.ellipse import FailedFit
from roundel.solver.methods.plugin import Found, MethodFailure, View
from roundel.solver.pose.direct_homography import pose_of_homography
from roundel.solver.pose.focal_uncertainty import MeasuredFocal, profiled_focal
from roundel.solver.pose.plane_homography import PlaneHomography, fit_homography
from roundel.solver.views.circles_of_view import CircleImage, circles_of_view
from roundel.solver.views.dual_circular_points import image_frame
from roundel.solver.views.plane_of_view import LARGEST_SIGMA, camera_of, measurements, refuse_misfit

Array = NDArray[np.float64]

LEAST_VIEWS = 3
_UNIT_PX = 1000.0  # of the order of a focal length, so that the elements of omega* are of one order
# Ratio of singular values: below it a second solution is as good as the first. Exact projections leave 1e-12.
_UNDETERMINED = 1e-8
_PAIRS = [(i, j) for i in range(4) for j in range(i, 4)]


def dual_quadric(projections: ArrayLike, principal_point: ArrayLike, tolerance: float = 0.05) -> Array:
    """The absolute dual quadric of a projective reconstruction, for square pixels and a known principal point.

    Parameters
    ----------
    projections : (n, 3, 4) array_like
        Projection matrices of three views or more, each of any scale, in one projective frame.
    principal_point : (2,) array_like
        In pixels, of all views.
    tolerance : float
        Largest element of omega*, relative to the diagonal ones in its row and column, that should be zero.

    Returns
    -------
    (4, 4) array
        Symmetric, positive semidefinite, of rank 3 and unit Frobenius norm.

    Raises
    ------
    ValueError
        If there are fewer than three views, the motion is critical, or no camera fits.
    """
    p = np.asarray(projections, dtype=np.float64)
    if p.ndim != 3 or p.shape[1:] != (3, 4) or not np.all(np.isfinite(p)):
        raise ValueError(f"projections are 3x4 matrices of finite numbers; this array has shape {p.shape}")
    _refuse_few(len(p))
    p = image_frame(principal_point, _UNIT_PX) @ p
    p = p / np.linalg.norm(p, axis=(-2, -1), keepdims=True)
    rows = []
    for x, y, z in p:
        rows += [_form(x, x) - _form(y, y), _form(x, y), _form(x, z), _form(y, z)]
    _, values, vectors = np.linalg.svd(np.array(rows))
    if values[8] < _UNDETERMINED * values[0]:
        raise ValueError(
            "the motion is critical: the views are only translated, or only turned about the optical axis, and more "
            "than one quadric fits; turn the camera about other axes between the views"
        )
    q = np.zeros((4, 4))
    for (i, j), value in zip(_PAIRS, vectors[9], strict=True):
        q[i, j] = q[j, i] = value
    q = q * np.sign(np.trace(p[0] @ q @ p[0].T))
    weights, axes = np.linalg.eigh(q)
    if not weights[1] > 0:
        raise ValueError(
            "no camera with square pixels fits the views: the quadric that they give is not that of a sphere"
        )
    weights[0] = 0.0
    q = (axes * weights) @ axes.T
    for dual in p @ q @ np.swapaxes(p, -1, -2):
        flat, third = (dual[0, 0] + dual[1, 1]) / 2, dual[2, 2]
        zeros = [(dual[0, 0] - dual[1, 1]) / 2, dual[0, 1], *(dual[:2, 2] * math.sqrt(flat / max(third, 1e-300)))]
        if not (third > 0 and np.abs(zeros).max() <= tolerance * flat):
            raise ValueError(
                "no camera with square pixels and this principal point fits the views: the best leaves "
                f"{np.abs(zeros).max() / flat:.2g} of the absolute conic"
            )
    return np.asarray(q / np.linalg.norm(q))


def calibrations(projections: ArrayLike, principal_point: ArrayLike) -> Array:
    """Calibration matrix (n, 3, 3) of each view; the focal length of each may be another. See `dual_quadric`."""
    p = np.asarray(projections, dtype=np.float64)
    q = dual_quadric(p, principal_point)
    moved = image_frame(principal_point, _UNIT_PX) @ p
    dual = moved @ q @ np.swapaxes(moved, -1, -2)
    focal2 = (dual[:, 0, 0] + dual[:, 1, 1]) / (2.0 * dual[:, 2, 2])
    k = np.zeros((len(p), 3, 3))
    k[:, 0, 0] = k[:, 1, 1] = _UNIT_PX * np.sqrt(focal2)
    k[:, :2, 2], k[:, 2, 2] = np.asarray(principal_point, dtype=np.float64), 1.0
    return k


def metric_upgrade(quadric: ArrayLike) -> Array:
    """T (4, 4) with Omega = T diag(1, 1, 1, 0) T^T: the cameras P T are metric, up to a similarity."""
    weights, axes = np.linalg.eigh(np.asarray(quadric, dtype=np.float64))
    return np.asarray(axes[:, ::-1] * np.sqrt(np.append(np.maximum(weights[:0:-1], 0.0), 1.0)))


def focal_of_homographies(homographies: ArrayLike, K: ArrayLike) -> float:
    """Focal length that all views share, from homographies (n, 3, 3) of metric planes; linear.

    The focal length of K (3, 3) is not used.

    Raises
    ------
    ValueError
        If there are fewer than three views, all planes are parallel to the image, or no focal length fits.
    """
    h = np.asarray(homographies, dtype=np.float64)
    _refuse_few(len(h))
    h = _square_frame(K) @ h
    # A + B / F = 0 for each view, with F = (1 / f)^2: products of the coordinates x, y, and of the third.
    flat, third = _products(h, np.array([1.0, 1.0, 0.0])), _products(h, np.array([0.0, 0.0, 1.0]))
    scale = np.sum(h[:, :2, :2] ** 2, axis=(1, 2))[:, None]
    flat, third = flat / scale, third / scale
    if float(np.linalg.norm(third)) < 1e-9:
        raise ValueError("the plane is parallel to the image in all views: every focal length explains them; tilt it")
    inverse = -float(np.sum(flat * third)) / float(np.sum(flat * flat)) if np.any(flat) else 0.0
    if not inverse > 0:
        raise ValueError("no focal length fits: the planes are too near to parallel to the image, or too far away")
    return _UNIT_PX / math.sqrt(inverse)


def find(view: View) -> list[Found]:
    """Focal length from this view and its companions, and the pose of each dot in this one."""
    own = _dots_of(view)
    homographies = [own[0]]
    for other in view.companions():
        try:
            homographies.append(_dots_of(other)[0])
        except MethodFailure:
            continue  # a view that shows no ring of dots tells nothing
    _refuse_few(len(homographies), MethodFailure)
    measured = shared_focal(homographies, view.camera.K)
    if measured is not None and not measured.sigma <= LARGEST_SIGMA:
        measured = None
    camera = camera_of(view, measured)
    plane, circles, places = own
    pose = pose_of_homography(plane.H, camera.K)
    normal, centres = pose[:3, 2], pose[:3, 3] + places @ pose[:3, :2].T
    return [
        Found(
            poses=[(normal, centre)],
            ellipse=circle.ellipse,
            confidence=circle.confidence,
            focal_px=None if measured is None else measured.focal_px,
            focal_sigma_px=None if measured is None else measured.sigma * measured.focal_px,
            camera=None if camera is view.camera else camera,
        )
        for circle, centre in zip(circles, centres, strict=True)
    ]


def shared_focal(homographies: Sequence[PlaneHomography], K: ArrayLike) -> MeasuredFocal | None:
    """The focal length of the least Mahalanobis distance of both equations of all views; None if there is none."""
    try:
        start = focal_of_homographies([plane.H for plane in homographies], K)
    except ValueError:
        return None
    frame = _square_frame(K)
    moved = [
        (frame @ plane.H, np.kron(frame, np.eye(3)) @ plane.cov @ np.kron(frame, np.eye(3)).T) for plane in homographies
    ]

    def chi2(log_focal: float) -> float:
        omega = np.array([1.0, 1.0, math.exp(2.0 * log_focal)])
        total = 0.0
        for h, cov in moved:
            (miss,) = _products(h[None], omega)
            first, second = omega * h[:, 0], omega * h[:, 1]
            by_element = np.zeros((2, 3, 3))
            by_element[0, :, 0], by_element[0, :, 1] = 2.0 * first, -2.0 * second
            by_element[1, :, 0], by_element[1, :, 1] = 2.0 * second, 2.0 * first
            rate = by_element.reshape(2, 9)
            total += float(miss @ np.linalg.solve(rate @ cov @ rate.T, miss))
        return total

    log_start = math.log(start / _UNIT_PX)
    found = profiled_focal(chi2, log_start, 0.02)
    return None if found is None else MeasuredFocal(found.focal_px * _UNIT_PX, found.sigma)


def _products(h: Array, omega: Array) -> Array:
    """h1^T w h1 - h2^T w h2 and 2 h1^T w h2 (n, 2) of homographies (n, 3, 3), for a diagonal w."""
    one, two = h[..., 0], h[..., 1]
    return np.stack(
        [np.sum((one * one - two * two) * omega, axis=-1), 2.0 * np.sum(one * two * omega, axis=-1)], axis=-1
    )


def _square_frame(K: ArrayLike) -> Array:
    """From pixels to square ones with the principal point at the origin, in units of `_UNIT_PX`."""
    k = np.array(K, dtype=np.float64)
    k[:2, :2] *= _UNIT_PX / k[0, 0]
    return np.asarray(np.linalg.inv(k), dtype=np.float64)


def _form(a: Array, b: Array) -> Array:
    """Coefficients (10,) of a^T Q b in the elements of a symmetric Q."""
    return np.array([a[i] * b[j] + (a[j] * b[i] if i != j else 0.0) for i, j in _PAIRS])


def _dots_of(view: View) -> tuple[PlaneHomography, list[CircleImage], Array]:
    """The homography of a view's ring of dots, its dots, and their places in the plane (n, 2).

    Raises
    ------
    MethodFailure
        If no ring of dots is printed, or not all of its dots are found.
    """
    printed = [marker for marker in view.markers if "ring_diameter_m" in (marker.get("layout") or {})]
    if not printed:
        raise MethodFailure("it reads dot_ring, dots at known places; none is printed")
    layout = printed[0]["layout"]
    count, radius = int(layout["dots"]), float(layout["ring_diameter_m"]) / 2
    circles = circles_of_view(view)[:count]
    if len(circles) < count or count < 4:
        raise MethodFailure(f"{len(circles)} of {count} dots of the ring are found; it needs all of four or more")
    ellipses, covs = measurements(circles)
    # Counter-clockwise in the print is counter-clockwise in the image, whose y points down. Which dot is the first does
    # not matter: the ring looks the same from each.
    from_middle = ellipses[:, :2] - ellipses[:, :2].mean(axis=0)
    order = np.argsort(-np.arctan2(from_middle[:, 1], from_middle[:, 0]))
    angle = 2.0 * np.pi * np.arange(count) / count
    places = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    dot = float(printed[0]["diameter_m"]) / 2
    fit = fit_homography(ellipses[order], covs[order], places, np.full(count, dot))
    if isinstance(fit, FailedFit):
        raise MethodFailure(f"the circles found are not the dots of the ring: {fit.reason}")
    refuse_misfit(fit, "the circles found are not the dots of the ring")
    return fit, [circles[i] for i in order], places


def _refuse_few(count: int, kind: type[ValueError] = ValueError) -> None:
    if count < LEAST_VIEWS:
        raise kind(f"it needs {LEAST_VIEWS} views by one camera or more; there are {count}")
