"""Chen: focal length, normal and centres from two or more coplanar circles, by a search over the focal length.

For a focal length f, each ellipse has two supporting planes. In coordinates with the principal point at the origin,
with the eigenvalues l1 >= l2 > 0 > l3 of diag(1, 1, 1/f) C diag(1, 1, 1/f) (C negative inside) and eigenvectors V,

    n = V [S2 h, 0, -S1 g]^T,    g = sqrt((l2 - l3) / (l1 - l3)),    h = sqrt((l1 - l2) / (l1 - l3)),    S1, S2 = +-1.

At the true focal length one normal of each circle is that of the common plane. The search minimises the angle between
the closest normals of the circles over log f, with both normals of the first circle carried through; then all unknowns
are refined together (`roundel.solver.pose.coplanar_circles`). These eigenvectors are those of `circle_pose`, whose
one-sided Jacobi method is used for them.

The cost is shaped like a V, so intervals are narrowed, not derivatives followed; where the plane is parallel to the
image every focal length explains the circles, which is refused.

Source: Q. Chen, H. Wu, T. Wada, Camera calibration with two arbitrary coplanar circles, ECCV (2004), sections 3 and 4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.geometry.conic import conic_of_ellipse, ellipse_of_conic
from roundel.scenes.geometry.pose import angle_deg
from roundel.solver.fit.ellipse import FailedFit
from roundel.solver.methods.plugin import Found, View
from roundel.solver.pose.circle_pose import poses_from_ellipse
from roundel.solver.pose.coplanar_circles import CoplanarFit, fit_coplanar
from roundel.solver.views.plane_of_view import (
    focal_of_fit,
    founds_in_plane,
    measurements,
    printed_circles,
    refuse_misfit,
)

Array = NDArray[np.float64]

# Focal lengths that are searched, in units of the distance from the principal point to the farthest ellipse.
_SHORTEST, _LONGEST = 0.12, 100.0
_STEPS = 160
_STEP = math.log(_LONGEST / _SHORTEST) / (_STEPS - 1)
_ZOOM = 80  # steps of an interval that is narrowed: calls cost more than poses
_ROUNDS = 9  # each narrows it to a fortieth
_NOT_ZERO_DEG = 1e-3  # a minimum that stays above it has another value than zero
_SETTLED_DEG = 1e-9  # rounding of a normal is a hundredth of it
_STARTS = 6  # minima of the search that are refined, those of the smallest angles
_FLAT = 1.05  # a focal length that is wrong by this factor must explain the circles worse


@dataclass(frozen=True, eq=False)
class PlaneOfCircles:
    """A focal length with the plane of the circles.

    Attributes
    ----------
    focal_px : float
    normal : (3,) array
        Mean of the closest normals, toward the camera.
    centre_image_px : (n, 2) array
        Images of the circles' centres.
    angle_deg : float
        Largest angle between the closest normals and their mean.
    """

    focal_px: float
    normal: Array
    centre_image_px: Array
    angle_deg: float


def planes_of_circles(
    conics: ArrayLike, principal_point: ArrayLike, tolerance_deg: float = 1e-4
) -> list[PlaneOfCircles]:
    """All focal lengths at which the circles lie in one plane, the best first.

    Parameters
    ----------
    conics : (n, 3, 3) array_like
        Images of two circles or more, in undistorted, square pixels.
    principal_point : (2,) array_like
    tolerance_deg : float
        Largest angle between the normals. For exact conics the search ends at about 1e-9 degrees.

    Returns
    -------
    list of PlaneOfCircles
        One, or two if one circle lies inside the other without being concentric.

    Raises
    ------
    ValueError
        If there is one circle only, a conic is not an ellipse, no focal length makes the circles coplanar, or every
        focal length does.
    """
    c = np.asarray(conics, dtype=np.float64)
    if c.ndim != 3 or len(c) < 2:
        raise ValueError("two coplanar circles or more are needed; one circle alone does not determine a focal length")
    pp = np.asarray(principal_point, dtype=np.float64)
    ellipses, size = _scaled(ellipse_of_conic(c) - np.array([pp[0], pp[1], 0.0, 0.0, 0.0]))
    out: list[PlaneOfCircles] = []
    minima = _minima(ellipses)
    smallest = minima[0].angle_deg
    for minimum in minima[:_STARTS]:
        best, angle = _narrowed(minimum, ellipses)
        smallest = min(smallest, angle)
        if angle > tolerance_deg or any(abs(math.log(o.focal_px / size) - best) < 1e-3 for o in out):
            continue
        beside = _cost(best + math.log(_FLAT) * np.array([-1.0, 1.0]), ellipses, minimum.first)
        if float(beside.min()) <= tolerance_deg:
            raise ValueError(
                "the circles are parallel to the image within the tolerance: every focal length explains them; "
                "tilt their plane"
            )
        out.append(_plane(best, ellipses, minimum.first, angle, size, pp))
    if not out:
        raise ValueError(
            f"no focal length makes the circles coplanar: their normals stay {smallest:.2g} degrees apart; they lie in "
            "different planes, or are not circles"
        )
    return sorted(out, key=lambda plane: plane.angle_deg)


class _Minimum(NamedTuple):
    """A minimum of the search, in units of the image's size; `first` is the first circle's normal that it follows."""

    angle_deg: float
    log_focal: float
    first: int
    normal: Array


def _scaled(ellipses: Array) -> tuple[Array, float]:
    """Ellipses in units of the distance from the origin to the farthest one, and that distance."""
    size = float(np.max(np.hypot(ellipses[:, 0], ellipses[:, 1]) + ellipses[:, 2]))
    return ellipses / np.array([size, size, size, size, 1.0]), size


def _minima(ellipses: Array) -> list[_Minimum]:
    """The minima of the search on its grid, for both normals of the first circle; the smallest angle first."""
    log_f = np.asarray(math.log(_SHORTEST) + _STEP * np.arange(_STEPS), dtype=np.float64)
    normals = _normals(log_f, ellipses)
    out = []
    for first in (0, 1):
        mean, _ = _closest(normals, first)
        cost = _spread_deg(normals, first)
        ends = np.concatenate([[np.inf], cost, [np.inf]])
        lowest = np.flatnonzero((cost <= ends[:-2]) & (cost <= ends[2:]))
        out += [_Minimum(float(cost[i]), float(log_f[i]), first, mean[i]) for i in lowest]
    return sorted(out, key=lambda minimum: minimum.angle_deg)


def _normals(log_f: Array, ellipses: Array) -> Array:
    """Both normals of each circle (m, n, 2, 3) for each focal length."""
    f = np.exp(log_f)
    k = np.zeros((len(f), 1, 3, 3))
    k[:, 0, 0, 0], k[:, 0, 1, 1], k[:, 0, 2, 2] = f, f, 1.0
    return poses_from_ellipse(ellipses[None], k, 1.0).normal


def _closest(normals: Array, first: int) -> tuple[Array, Array]:
    """Of each circle the normal closest to one of the first circle's: their mean (m, 3), and each (m, n, 3)."""
    reference = normals[:, 0, first]
    mean = reference
    # Closest to the first circle's normal, then to the mean of those: the choice does not depend on one noisy ellipse.
    for _ in range(2):
        which = np.argmax(np.sum(normals * mean[:, None, None], axis=-1), axis=-1)
        chosen = np.take_along_axis(normals, which[..., None, None], axis=2)[:, :, 0]
        chosen[:, 0] = reference
        mean = chosen.mean(axis=1)
        mean = mean / np.linalg.norm(mean, axis=-1, keepdims=True)
    return mean, chosen


def _spread_deg(normals: Array, first: int) -> Array:
    mean, chosen = _closest(normals, first)
    return np.asarray(np.max(angle_deg(chosen, mean[:, None]), axis=-1))


def _cost(log_f: Array, ellipses: Array, first: int) -> Array:
    return _spread_deg(_normals(log_f, ellipses), first)


def _narrowed(minimum: _Minimum, ellipses: Array) -> tuple[float, float]:
    """Place and value of the least cost within a step of the grid."""
    log_f, value, reach, stalls = minimum.log_focal, minimum.angle_deg, _STEP, 0
    for _ in range(_ROUNDS):
        trial, before = log_f + reach * np.linspace(-1.0, 1.0, _ZOOM + 1), value
        cost = _cost(trial, ellipses, minimum.first)
        i = int(np.argmin(cost))
        log_f, value, reach = float(trial[i]), float(cost[i]), reach * 2.0 / _ZOOM
        # A minimum at zero falls to a fortieth each round, or to a sixth where a circle is seen along its axis and its
        # normals turn like a square root; by chance a point of a round may be as good as the best of the next.
        stalls = stalls + 1 if value > 0.5 * before else 0
        if (stalls == 2 and value > _NOT_ZERO_DEG) or value < _SETTLED_DEG:
            break
    return log_f, value


def _plane(
    log_f: float, ellipses: Array, first: int, angle: float, size: float, principal_point: Array
) -> PlaneOfCircles:
    f = math.exp(log_f)
    normal = _closest(_normals(np.array([log_f]), ellipses), first)[0][0]
    poses = poses_from_ellipse(ellipses, np.diag([f, f, 1.0]), 1.0)
    which = np.argmax(poses.normal @ normal, axis=-1)
    centre = np.take_along_axis(poses.centre_m, which[:, None, None], axis=1)[:, 0]
    image = f * centre[:, :2] / centre[:, 2:]
    return PlaneOfCircles(f * size, normal, image * size + principal_point, angle)


def measured_plane(ellipses: ArrayLike, shape_covs: ArrayLike, K: ArrayLike) -> CoplanarFit | FailedFit:
    """Focal length and plane of noisy ellipses: the search, then the refinement of all unknowns.

    Parameters
    ----------
    ellipses, shape_covs, K
        See `fit_coplanar`; the focal length of K is not used.

    Returns
    -------
    CoplanarFit or FailedFit
        The best of the refined minima of the search.
    """
    e, k = np.asarray(ellipses, dtype=np.float64), np.asarray(K, dtype=np.float64)
    square = np.eye(3)
    square[:2, :2] = k[:2, :2] / k[0, 0]
    moved = ellipse_of_conic(square.T @ conic_of_ellipse(e - np.concatenate([k[:2, 2], np.zeros(3)])) @ square)
    scaled, size = _scaled(moved)
    best: CoplanarFit | FailedFit = FailedFit("no focal length makes the circles coplanar")
    for minimum in _minima(scaled)[:_STARTS]:
        start_k = k.copy()
        start_k[:2, :2] *= math.exp(minimum.log_focal) * size / k[0, 0]
        fit = fit_coplanar(e, shape_covs, start_k, minimum.normal)
        if not isinstance(fit, FailedFit) and (isinstance(best, FailedFit) or fit.chi2 < best.chi2 - 1e-9):
            best = fit
    return best


def find(view: View) -> list[Found]:
    """Focal length, and a pose of each of two or more coplanar circles.

    Where the image does not determine a focal length (a plane almost parallel to it, circles far away), none is stated,
    and the poses are those with the view's camera.
    """
    circles, diameters_m = printed_circles(view, 2)
    ellipses, covs = measurements(circles)
    fit = measured_plane(ellipses, covs, view.camera.K)
    if not isinstance(fit, FailedFit):
        refuse_misfit(fit, "the circles are not in one plane")
    return founds_in_plane(view, circles, diameters_m, focal_of_fit(fit))
