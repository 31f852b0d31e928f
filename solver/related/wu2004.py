"""Wu: both normals of a circle's plane from its image and a known camera; two circles of one view choose.

With the cone A = K^T C K of a circle's image (for K = diag(f, f, 1) it is diag(f, f, 1) C diag(f, f, 1)), scaled so
that its eigenvalues are l1 >= l2 > 0 > l3, and its orthonormal eigenvectors as the columns of V, the planes that cut
the cone in circles have the normals

    n = V [+-h, 0, +-g]^T,    g = sqrt((l2 - l3) / (l1 - l3)),    h = sqrt((l1 - l2) / (l1 - l3)),

which are two planes up to the sign of n; the centre follows from the radius. The algebra is that of
`roundel.solver.pose.circle_pose` (its e3 is the third column here), which computes it without the loss of digits of
these eigenvalues, and is what is called.

Wu measures the gaze from the limbus of each iris, a circle. Of both eyes, whose irises are parallel when they look at
something far away, the most parallel pair of normals is the true one; here, of any circles of the view.

Source: H. Wu, Q. Chen, T. Wada, Conic-based algorithm for visual line estimation from one image, Int. Conf. on
Automatic Face and Gesture Recognition (2004), section 2.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.geometry.conic import ellipse_of_conic
from roundel.scenes.geometry.pose import angle_deg
from roundel.solver.methods.plugin import Found, MethodFailure, View
from roundel.solver.pose.circle_pose import CirclePoses, poses_from_ellipse
from roundel.solver.pose.pose_covariance import poses_with_covariance
from roundel.solver.views.circles_of_view import circles_of_view, require_kind
from roundel.solver.views.plane_of_view import measurements

Array = NDArray[np.float64]

# Two exactly parallel circles agree to the rounding of their conics. A focal length that is 11.5 % wrong turns the
# normals of circles beside the axis by some degrees, and each by its own; noise adds its own sigmas.
_PARALLEL_DEG = 10.0
_SIGMAS = 4.0


@dataclass(frozen=True, eq=False)
class ParallelNormals:
    """The most parallel normals of some circles.

    Attributes
    ----------
    chosen : (n,) array of int
        Which of both normals of each circle is meant.
    angle_deg : float
        Largest angle between two of them.
    """

    chosen: NDArray[np.int64]
    angle_deg: float


def both_poses(conic: ArrayLike, K: ArrayLike, radius_m: ArrayLike) -> CirclePoses:
    """Both normals and both centres of a circle.

    Parameters
    ----------
    conic : (..., 3, 3) array_like
        In undistorted pixels.
    K : (3, 3) array_like
    radius_m : (...) array_like

    Raises
    ------
    ValueError
        If a conic is not an ellipse, or K or a radius is invalid.
    """
    return poses_from_ellipse(ellipse_of_conic(conic), K, radius_m)


def most_parallel(normals: ArrayLike, tolerance_deg: float = _PARALLEL_DEG) -> ParallelNormals:
    """Choose one normal of each circle, so that all are as parallel as possible.

    Parameters
    ----------
    normals : (n, 2, 3) array_like
        Both unit normals of each of two circles or more.
    tolerance_deg : float
        Largest angle between the chosen normals.

    Raises
    ------
    ValueError
        If there is one circle only, or no choice makes them parallel.
    """
    n = np.asarray(normals, dtype=np.float64)
    if n.ndim != 3 or n.shape[1:] != (2, 3) or len(n) < 2:
        raise ValueError("two circles or more are needed to choose; one alone has two normals that explain it equally")
    best, least = np.zeros(len(n), dtype=np.int64), np.inf
    # One circle's normal decides for all others which is closer: 2 n choices instead of 2^n.
    for i, k in product(range(len(n)), range(2)):
        chosen = np.argmax(n @ n[i, k], axis=1)
        of = n[np.arange(len(n)), chosen]
        widest = float(np.max(angle_deg(of[:, None], of[None])))
        if widest < least:
            best, least = chosen, widest
    if least > tolerance_deg:
        raise ValueError(
            f"the circles are not parallel: their closest normals are {least:.3g} degrees apart, so none can be chosen"
        )
    return ParallelNormals(best, least)


def find(view: View) -> list[Found]:
    """Both poses of each circle; of several circles in one plane, the parallel ones are chosen."""
    boards = "disc_with_chessboard", "disc_with_charuco"
    require_kind(view, "disc", "disc_with_tick", "ring", "rings", "coded_rings", "ring_code", *boards)
    circles = circles_of_view(view)
    if not circles:
        return []
    ellipses, covs = measurements(circles)
    poses, cov = poses_with_covariance(ellipses, covs, view.camera.K, view.diameter_m / 2)
    chosen: list[int | None] = [None] * len(circles)
    if len(circles) > 1:
        sigma = 0.0 if cov is None else float(np.sqrt(np.trace(cov[..., 3:, 3:], axis1=-2, axis2=-1).max()))
        try:
            parallel = most_parallel(poses.normal, _PARALLEL_DEG + _SIGMAS * np.degrees(sigma))
        except ValueError as error:
            raise MethodFailure(str(error)) from error
        chosen = [int(i) for i in parallel.chosen]
    return [
        Found(
            poses=[(poses.normal[i, j], poses.centre_m[i, j]) for j in range(2)],
            ellipse=circle.ellipse,
            chosen=chosen[i],
            confidence=circle.confidence,
        )
        for i, circle in enumerate(circles)
    ]
