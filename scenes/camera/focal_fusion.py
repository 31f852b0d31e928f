"""Two statements about one focal length, fused: a prior, and a measurement from the image."""

from __future__ import annotations

import math
from dataclasses import replace

from roundel.scenes.camera.model import Camera


def fused_focal_px(prior_px: float, prior_sigma: float, focal_px: float, focal_sigma_px: float) -> tuple[float, float]:
    """The focal length that a prior and a measurement agree on best.

    Both are normal distributions of log f: a focal length is positive, its prior is given as a fraction of it, and the
    product of two such distributions has the mean weighted by the inverse variances.

    Parameters
    ----------
    prior_px, prior_sigma : float
        The prior's focal length, and its standard deviation as a fraction of it; 0 if it is exact.
    focal_px, focal_sigma_px : float
        The measurement and its standard deviation, in pixels.

    Returns
    -------
    focal_px, sigma : float
        The fused focal length, and its standard deviation as a fraction of it.
    """
    if prior_sigma <= 0 or not (focal_px > 0 and focal_sigma_px >= 0) or not math.isfinite(focal_sigma_px):
        return prior_px, prior_sigma
    sigma = focal_sigma_px / focal_px
    if sigma == 0:
        return focal_px, 0.0
    weight = prior_sigma**2 / (prior_sigma**2 + sigma**2)
    fused = math.exp((1 - weight) * math.log(prior_px) + weight * math.log(focal_px))
    return fused, sigma * math.sqrt(weight)


def with_focal(camera: Camera, focal_px: float) -> Camera:
    """The camera with another focal length fx; the ratio of fy to fx is kept."""
    k = camera.K.copy()
    k[:2, :2] *= focal_px / k[0, 0]
    return replace(camera, K=k)


def fused_camera(camera: Camera, prior_sigma: float, focal_px: float, focal_sigma_px: float) -> Camera:
    """The camera with its focal length fused with a measured one; itself where it is exact (`prior_sigma` 0)."""
    if prior_sigma <= 0:
        return camera
    return with_focal(camera, fused_focal_px(float(camera.K[0, 0]), prior_sigma, focal_px, focal_sigma_px)[0])
