"""Focal length from one view of a known plane: square pixels and a known principal point.

The plane's homography H = [h1 h2 h3], in coordinates centred on the principal point, gives two constraints on
w = diag(1, 1, f^2) / f^2 (Liebowitz and Zisserman, 1998; Zhang, 2000, equations 3 and 4):

    h1^T w h2 = 0          f^2 = -(h1x h2x + h1y h2y) / (h1z h2z)
    h1^T w h1 = h2^T w h2  f^2 = -(h1x^2 + h1y^2 - h2x^2 - h2y^2) / (h1z^2 - h2z^2)

Each is singular for some directions of the tilt (the first for a tilt about an axis of the square, the second about a
diagonal), and both without perspective. Their weighted combination starts a fit of the pose and the focal length
together. Near fronto-parallel the error of that fit is not normal, so its standard deviation comes from the profile of
the likelihood: the focal lengths that the points exclude at 95 %.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.solver.pose.direct_homography import homography
from roundel.solver.pose.focal_uncertainty import profile_sigma
from roundel.solver.pose.plane_pose import PlanePoints, PlanePose, normalised, plane_poses, refined_pose

Array = NDArray[np.float64]

# Logarithms of focal lengths over the camera's from which a fit starts if the closed form's has failed or exceeds its
# degrees of freedom by more than WELL_FITTED (a chance of 1 in 3,000 for a square); none farther than FARTHEST_LOG.
OTHER_STARTS, WELL_FITTED, FARTHEST_LOG = (-0.7, 0.0, 0.7), 12.0, 5.0
FRONTO_PARALLEL = (
    "the plane is too close to fronto-parallel: its points do not bound the focal length; tilt it or move closer"
)


@dataclass(frozen=True, eq=False)
class PlaneFocal:
    """Focal length (fx) with its standard deviation, px, and the pose that goes with it."""

    focal_px: float
    sigma_px: float
    pose: PlanePose


def squared_focals(h: ArrayLike) -> tuple[float, float]:
    """f^2 by each of the two constraints; `h` maps to coordinates centred on the principal point, square pixels.

    Infinite, of either sign, or NaN where a constraint is singular.
    """
    m = np.asarray(h, dtype=np.float64)
    (a1, b1), (a2, b2) = _constraints(m)
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(np.float64(-a1) / b1), float(np.float64(-a2) / b2)


def _constraints(h: Array) -> tuple[tuple[float, float], tuple[float, float]]:
    """(a, b) of each constraint a / f^2 + b = 0."""
    first, second = h[:, 0], h[:, 1]
    return (
        (float(first[:2] @ second[:2]), float(first[2] * second[2])),
        (float(first[:2] @ first[:2] - second[:2] @ second[:2]), float(first[2] ** 2 - second[2] ** 2)),
    )


def focal_from_plane(given: PlanePoints, square: bool = False) -> PlaneFocal:
    """Focal length from one view of a plane, with an honest standard deviation.

    Parameters
    ----------
    given : PlanePoints
        The camera's fx / fy and principal point are taken as known, its focal length is not used.
    square : bool
        See `plane_poses`.

    Raises
    ------
    ValueError
        If the points do not bound the focal length.
    """
    best = _best_fit(given, square)
    if best is None:
        raise ValueError(FRONTO_PARALLEL)
    sigma = _log_sigma(given, best, square)
    if sigma is None:
        raise ValueError(FRONTO_PARALLEL)
    focal = float(given.camera.K[0, 0] * np.exp(best.log_scale))
    return PlaneFocal(focal, sigma * focal, best)


def _best_fit(given: PlanePoints, square: bool) -> PlanePose | None:
    """The joint fit of pose and focal length, from the closed form; from other focal lengths if that fits badly."""
    # In units of the camera's focal length: square pixels, centred on the principal point.
    (a1, b1), (a2, b2) = _constraints(homography(given.points_m[:, :2], normalised(given, 0.0)))
    squared = -(a1 * b1 + a2 * b2) / max(b1 * b1 + b2 * b2, 1e-300)
    closed = [0.5 * float(np.log(squared))] if 1e-3 < squared < 1e3 else []
    best: PlanePose | None = None
    for start in [*closed, *OTHER_STARTS]:
        for pose in plane_poses(given, start, square):
            free = refined_pose(given, pose.camera_from_marker, start, free=True)
            if free is None or abs(free.log_scale) > FARTHEST_LOG or free.normal @ free.centre_m >= 0:
                continue
            if best is None or free.chi2 < best.chi2:
                best = free
        if best is not None and best.chi2 < 2 * len(given.pixels) - 7 + WELL_FITTED:
            break
    return best


def _log_sigma(given: PlanePoints, best: PlanePose, square: bool) -> float | None:
    """Standard deviation of log f by the profile of chi^2, minimised over the pose; None if it bounds nothing."""
    starts = [best.camera_from_marker, *(p.camera_from_marker for p in plane_poses(given, best.log_scale, square)[1:])]

    def chi2(log_scale: float) -> float:
        poses = [refined_pose(given, start, log_scale) for start in starts]
        return min((pose.chi2 for pose in poses if pose is not None), default=np.inf)

    variance = float(np.linalg.pinv(best.information, hermitian=True)[6, 6])
    return profile_sigma(chi2, best.log_scale, best.chi2, np.sqrt(max(variance, 0.0)))
