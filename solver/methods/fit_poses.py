"""Both poses, with covariance, of the ellipses that were fitted in a frame, all at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from roundel.solver.fit.ellipse import EllipseFit, FailedFit
from roundel.solver.fit.pixel_covariance import PixelFit
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera
from roundel.solver.pose.camera_covariance import shape_covariance_of_camera
from roundel.solver.pose.centre_rows import MovingEllipse, poses_at_centre_rows
from roundel.solver.pose.circle_pose import CirclePoses
from roundel.solver.pose.pose_covariance import poses_with_covariance
from roundel.solver.pose.pose_curvature import curved_covariance, focal_curvature

Array = NDArray[np.float64]
Posed = tuple[CirclePoses, Array | None]


def poses_of_fits(
    fits: Sequence[EllipseFit | FailedFit], uncertain: UncertainCamera, radius_m: float
) -> list[Posed | FailedFit]:
    """Both poses of each ellipse and their covariance; of a failed fit, or an ellipse without a pose, the failure.

    Parameters
    ----------
    fits : sequence of EllipseFit or FailedFit
    uncertain : UncertainCamera
        Its standard deviations enter the covariance.
    radius_m : float

    Returns
    -------
    list
        Of each fit (CirclePoses, covariance (2, 6, 6) or None), or FailedFit.
    """
    out: list[Posed | FailedFit] = []
    still = [fit for fit in fits if isinstance(fit, EllipseFit) and not _moves(fit, uncertain)]
    together = iter(_posed(still, uncertain, radius_m))
    for fit in fits:
        if isinstance(fit, FailedFit):
            out.append(fit)
        elif isinstance(fit, PixelFit) and _moves(fit, uncertain):
            out.append(_at_centre_rows(fit, uncertain, radius_m))
        else:
            out.append(next(together))
    return out


def _moves(fit: EllipseFit, uncertain: UncertainCamera) -> bool:
    return isinstance(fit, PixelFit) and bool(np.any(fit.rates)) and uncertain.row_time is not None


def _posed(fits: Sequence[EllipseFit], uncertain: UncertainCamera, radius_m: float) -> list[Posed | FailedFit]:
    if not fits:
        return []
    k, sigmas = uncertain.camera.K, (uncertain.focal_sigma, uncertain.principal_sigma_px)
    ellipses, shape_covs = np.array([f.ellipse for f in fits]), np.array([f.shape_cov for f in fits])
    known = np.isfinite(shape_covs).all(axis=(1, 2))
    shape_covs[~known] = 0.0
    if uncertain.covariance is not None:
        shape_covs += shape_covariance_of_camera(ellipses, uncertain.camera, uncertain.covariance)
    try:
        poses, cov = poses_with_covariance(ellipses, shape_covs, k, radius_m, *sigmas)
        assert cov is not None, "all covariances are finite"
        cov = curved_covariance(poses, cov, ellipses, shape_covs, k, radius_m)
        if uncertain.focal_sigma > 0:
            cov += focal_curvature(poses, ellipses, k, radius_m, uncertain.focal_sigma)
    except ValueError as error:
        if len(fits) == 1:
            return [FailedFit(str(error))]
        return [one for fit in fits for one in _posed([fit], uncertain, radius_m)]  # most still have poses
    return [(CirclePoses(poses.normal[i], poses.centre_m[i]), cov[i] if known[i] else None) for i in range(len(fits))]


def _at_centre_rows(fit: PixelFit, uncertain: UncertainCamera, radius_m: float) -> Posed | FailedFit:
    camera, row_time = uncertain.camera, uncertain.row_time
    assert row_time is not None, "a global shutter has no rates"
    shape_cov = fit.shape_cov
    if uncertain.covariance is not None:
        shape_cov = shape_cov + shape_covariance_of_camera(fit.ellipse, camera, uncertain.covariance)
    moving = MovingEllipse(fit.ellipse, fit.rates, shape_cov, fit.rates_cov, fit.row_zero_px)
    sigmas = uncertain.focal_sigma, uncertain.principal_sigma_px
    try:
        return poses_at_centre_rows(moving, camera, row_time, radius_m, *sigmas)
    except np.linalg.LinAlgError:  # sheared to a line
        return FailedFit("the motion during the readout leaves no pose at the row of the circle's centre")
    except ValueError as error:
        return FailedFit(str(error))
