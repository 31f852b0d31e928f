"""One fitted ellipse to a record: both poses with their covariance, the choice between them, and what all rests on."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.solver.ambiguity.disambiguation import Knowledge, choose
from roundel.solver.ambiguity.observation import Sighting
from roundel.solver.detect.detect import Detection
from roundel.solver.estimates import Estimate
from roundel.solver.fit.ellipse import EllipseFit, FailedFit
from roundel.solver.fit.pixel_fit import PixelFit
from roundel.solver.intrinsics.uncertain_camera import AssumedCamera
from roundel.solver.pose.pose_covariance import poses_with_covariance

Array = NDArray[np.float64]


def estimate_of(
    fit: EllipseFit | FailedFit,
    assumed: AssumedCamera,
    diameter_m: float,
    knowledge: Knowledge,
    key: tuple[int, int, str, str],
    detection: Detection | None = None,
    grey: NDArray[Any] | None = None,
) -> Estimate:
    """Both poses of a fitted ellipse.

    Parameters
    ----------
    fit : EllipseFit or FailedFit
    assumed : AssumedCamera
        Its spreads go into the covariance.
    diameter_m : float
    knowledge : str, Evidence, a sequence of them, or None
        See `choose`.
    key : tuple
        (frame_id, detection_id, method, intrinsics).
    detection : Detection, optional
        Where the ellipse comes from an image.
    grey : (H, W) array, optional
        The image, for knowledge that is to be read from its marks.
    """
    about: dict[str, Any] = {"focal_sigma": assumed.focal_sigma, "intrinsics_basis": assumed.basis}
    if detection is not None:
        about |= {"confidence": detection.confidence, "contrast_dn": float(detection.edges.contrast_dn)}
        about["blur_px"] = float(detection.edges.blur_px)
    if isinstance(fit, FailedFit):
        return Estimate(*key, status="failed", reason=fit.reason, camera=assumed.camera, **about)
    if isinstance(fit, PixelFit):
        about |= {"contrast_dn": fit.contrast_dn, "blur_px": fit.blur_px}
    known = assumed.camera.K, diameter_m / 2, assumed.focal_sigma, assumed.principal_sigma_px
    try:
        poses, cov = poses_with_covariance(fit.ellipse, fit.shape_cov, *known)
    except ValueError as error:
        return Estimate(*key, status="failed", reason=str(error), ellipse=fit.ellipse, camera=assumed.camera, **about)
    shape_cov = fit.shape_cov if np.all(np.isfinite(fit.shape_cov)) else None
    sighting = Sighting(
        poses.normal, cov, fit.ellipse, shape_cov, assumed, image=grey, blur_px=about.get("blur_px", 0.5)
    )
    choice = choose(sighting, knowledge)
    return Estimate(
        *key,
        status="ok",
        ellipse=fit.ellipse,
        camera=assumed.camera,
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
