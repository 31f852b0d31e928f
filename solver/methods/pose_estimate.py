"""The `Estimate` of one fitted ellipse: both poses, covariance, and the choice between them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.geometry.conic import Ellipse
from roundel.solver.ambiguity.disambiguation import Knowledge, choose
from roundel.solver.ambiguity.observation import Observation
from roundel.solver.detect.detect import Detection
from roundel.solver.estimates import Estimate, EstimateKey
from roundel.solver.fit.ellipse import EllipseFit, FailedFit
from roundel.solver.fit.pixel_covariance import PixelFit
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera
from roundel.solver.methods.estimate_caveats import caveats_of
from roundel.solver.methods.roundel_fits import Detections
from roundel.solver.pose.centre_rows import MovingEllipse, poses_at_centre_rows
from roundel.solver.pose.pose_covariance import poses_with_covariance
from roundel.solver.pose.pose_curvature import curved_covariance

Array = NDArray[np.float64]


def estimate_of(
    fit: EllipseFit | FailedFit,
    uncertain: UncertainCamera,
    diameter_m: float,
    knowledge: Knowledge,
    key: EstimateKey,
    detection: Detection | None = None,
    seen: Detections | None = None,
) -> Estimate:
    """Both poses of a fitted ellipse.

    Parameters
    ----------
    fit : EllipseFit or FailedFit
    uncertain : UncertainCamera
        Its standard deviations enter the covariance.
    diameter_m : float
    knowledge : str, Evidence, a sequence of them, or None
        See `choose`.
    key : EstimateKey
    detection : Detection, optional
        The detection, if the ellipse comes from an image.
    seen : Detections, optional
        The image, for cues that are measured in it, and its photometry.
    """
    about: dict[str, Any] = {"focal_sigma": uncertain.focal_sigma, "intrinsics_basis": uncertain.basis}
    about |= caveats_of(fit, key.method, detection, seen)
    if detection is not None:
        about |= {"confidence": detection.confidence, "contrast_dn": float(detection.edges.contrast_dn)}
        about["blur_px"] = float(detection.edges.blur_px)
    if isinstance(fit, FailedFit):
        return Estimate(*key, status="failed", reason=fit.reason, camera=uncertain.camera, **about)
    if isinstance(fit, PixelFit):
        about |= {"contrast_dn": fit.contrast_dn, "blur_px": fit.blur_px}
    ellipse = Ellipse.from_array(fit.ellipse)
    known = uncertain.camera.K, diameter_m / 2, uncertain.focal_sigma, uncertain.principal_sigma_px
    try:
        poses, cov = poses_with_covariance(fit.ellipse, fit.shape_cov, *known)
        if isinstance(fit, PixelFit) and np.any(fit.rates) and uncertain.row_time is not None:
            camera, row_time = uncertain.camera, uncertain.row_time
            row_s = row_time.row_s(camera.width_px, camera.height_px)
            rates = fit.rates, fit.shape_cov, fit.rates_cov
            moving = MovingEllipse(fit.ellipse, *rates, fit.row_zero_px, row_s, row_time.along_x)
            poses, cov = poses_at_centre_rows(poses, moving, camera, *known[1:])
        elif cov is not None:
            cov = curved_covariance(poses, cov, fit.ellipse, fit.shape_cov, uncertain.camera.K, diameter_m / 2)
    except ValueError as error:
        return Estimate(*key, status="failed", reason=str(error), ellipse=ellipse, camera=uncertain.camera, **about)
    shape_cov = fit.shape_cov if np.all(np.isfinite(fit.shape_cov)) else None
    image = None if seen is None else seen.grey
    observation = Observation(
        poses.normal,
        cov,
        fit.ellipse,
        shape_cov,
        uncertain,
        image=image,
        blur_px=about.get("blur_px", 0.5),
    )
    choice = choose(observation, knowledge)
    return Estimate(
        *key,
        status="ok",
        ellipse=ellipse,
        camera=uncertain.camera,
        normal=poses.normal,
        centre_m=poses.centre_m,
        probability=choice.probability,
        chosen=choice.chosen,
        choice_basis=choice.basis,
        edge_points=fit.n,
        edge_sigma_px=fit.sigma_px,
        cov=cov,
        **about,
    )
