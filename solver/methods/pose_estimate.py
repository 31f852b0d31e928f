"""The `Estimate` of one fitted ellipse: both poses, covariance, and the choice between them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.geometry.conic import Ellipse
from roundel.solver.ambiguity.disambiguation import Knowledge, choose
from roundel.solver.ambiguity.observation import Observation
from roundel.solver.detect.confidence import confidence_of_fit
from roundel.solver.detect.detect import Detection
from roundel.solver.estimates import Estimate, EstimateKey
from roundel.solver.fit.ellipse import EllipseFit, FailedFit
from roundel.solver.fit.pixel_covariance import PixelFit
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera
from roundel.solver.methods.estimate_caveats import caveats_of
from roundel.solver.methods.fit_poses import Posed
from roundel.solver.methods.roundel_fits import Detections

Array = NDArray[np.float64]


def estimate_of(
    fit: EllipseFit | FailedFit,
    posed: Posed | FailedFit,
    uncertain: UncertainCamera,
    knowledge: Knowledge,
    key: EstimateKey,
    detection: Detection | None = None,
    seen: Detections | None = None,
) -> Estimate:
    """Both poses of a fitted ellipse, and the choice between them.

    Parameters
    ----------
    fit : EllipseFit or FailedFit
    posed : (CirclePoses, array) or FailedFit
        Its poses and their covariance, see `poses_of_fits`.
    uncertain : UncertainCamera
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
        if detection is not None:
            about["confidence"] = confidence_of_fit(detection.confidence, fit.misfit)
    ellipse = Ellipse.from_array(fit.ellipse)
    if isinstance(posed, FailedFit):
        return Estimate(*key, status="failed", reason=posed.reason, ellipse=ellipse, camera=uncertain.camera, **about)
    poses, cov = posed
    shape_cov = fit.shape_cov + fit.motion_cov if isinstance(fit, PixelFit) else fit.shape_cov
    image = None if seen is None else seen.grey
    observation = Observation(
        poses.normal,
        cov,
        fit.ellipse,
        shape_cov if np.all(np.isfinite(shape_cov)) else None,
        uncertain,
        image=image,
        blur_px=about.get("blur_px", 0.5),
        noise_dn=fit.noise_dn if isinstance(fit, PixelFit) else None,
        contrast_dn=about.get("contrast_dn"),
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
