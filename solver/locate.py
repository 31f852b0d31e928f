"""The whole chain for one image: detect, find the edge, undistort its points, fit, pose, choose.

Lens distortion is taken out of the edge points, never out of the image: resampling destroys what sub-pixel edges are
made of.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.camera import Camera, distorts, undistort_px
from roundel.scenes.conic import ellipse_points
from roundel.solver.choose import Knowledge, choose
from roundel.solver.circle_pose import poses_from_ellipse
from roundel.solver.detect import Detection, detect
from roundel.solver.ellipse import (
    EllipseFit,
    FailedFit,
    direct_ellipse,
    ellipse_of_shape,
    fit_ellipse,
    shape_of_ellipse,
)
from roundel.solver.estimates import Estimate
from roundel.solver.foot_points import foot_points
from roundel.solver.intrinsics import camera_for, parse_intrinsics

Array = NDArray[np.float64]

METHODS = ("ml", "direct", "edgedrawing")
_MIN_IMAGE_PX = 8


def locate(
    image: NDArray[Any], diameter_m: float, camera: Camera | None = None, knowledge: Knowledge = None
) -> list[Estimate]:
    """Find the circles of an image and estimate both poses of each.

    Parameters
    ----------
    image : (H, W) or (H, W, C) array
        Integer levels, or real numbers up to 1, 255 or 65,535; colours are averaged, a fourth channel is left out.
    diameter_m : float
        Outer diameter of the printed circles.
    camera : Camera, optional
        Left out: the default focal length, a centred principal point, square pixels, no distortion.
    knowledge : str, NormalPrior or None
        What is known of the pose, see `choose`.

    Returns
    -------
    list of Estimate
        The strongest detection first; empty if there is none.

    Raises
    ------
    ValueError
        If the image is not one, or the diameter is not positive.
    """
    grey, full_scale_dn = grey_levels(image)
    if not (math.isfinite(diameter_m) and diameter_m > 0):
        raise ValueError(f"the diameter must be a positive number of metres, not {diameter_m}")
    label = "default" if camera is None else "true"
    if camera is None:
        camera = camera_for(parse_intrinsics("default"), None, grey.shape[1], grey.shape[0])
    out = []
    for i, detection in enumerate(find(grey, full_scale_dn)):
        fit = fit_detection(detection, camera, "ml")
        out.append(estimate_of(fit, camera, diameter_m, knowledge, (0, i, "ml", label)))
    return out


def grey_levels(image: NDArray[Any]) -> tuple[NDArray[Any], float]:
    """Grey levels (H, W), and the level at which pixels saturate."""
    pixels = np.asarray(image)
    if pixels.ndim not in (2, 3) or (pixels.ndim == 3 and pixels.shape[2] not in (1, 3, 4)) or pixels.size == 0:
        raise ValueError(
            f"an image is (H, W) or (H, W, C) with 1, 3 or 4 channels; this array has shape {pixels.shape}"
        )
    if pixels.dtype == np.bool_:
        pixels = pixels.astype(np.uint8) * 255
    integers = np.issubdtype(pixels.dtype, np.integer)
    if not integers and not np.issubdtype(pixels.dtype, np.floating):
        raise ValueError(f"an image holds integers or real numbers, not {pixels.dtype}")
    if not integers and not np.all(np.isfinite(pixels)):
        raise ValueError("the image holds numbers that are not finite")
    # Real numbers do not say where they saturate: at 1 or at an integer's limit, whichever holds them.
    largest = float(np.max(pixels))
    limits = (1.0, 255.0, 65535.0, largest)
    full_scale = float(np.iinfo(pixels.dtype).max) if integers else next(v for v in limits if v >= largest)
    if pixels.ndim == 3:
        pixels = pixels[..., 0] if pixels.shape[2] == 1 else pixels[..., :3].mean(axis=2)
    return pixels, full_scale


def find(grey: NDArray[Any], full_scale_dn: float) -> list[Detection]:
    """Detections in grey levels (H, W); none in an image too small to hold one."""
    return detect(grey, full_scale_dn) if min(grey.shape) >= _MIN_IMAGE_PX else []


def fit_detection(detection: Detection, camera: Camera, method: str) -> EllipseFit | FailedFit:
    """Ellipse of a detection in undistorted pixel coordinates, by one of `METHODS`."""
    if method == "edgedrawing":
        if detection.edgedrawing is None:
            return FailedFit("EdgeDrawing found no ellipse on this contour")
        ellipse: Array | FailedFit = ellipse_of_shape(shape_of_ellipse(detection.edgedrawing))
        if distorts(camera):
            outline = undistort_px(camera, ellipse_points(detection.edgedrawing, 64))
            ellipse = direct_ellipse(outline[np.isfinite(outline).all(axis=1)])
        points = undistort_px(camera, detection.edges.points_px)
        points = points[np.isfinite(points).all(axis=1)]
        return ellipse if isinstance(ellipse, FailedFit) else _plain_fit(ellipse, points)
    return fit_points(detection.edges.points_px, detection.edges.sigma_px, camera, method)


def fit_points(points_px: Array, sigma_px: Array | None, camera: Camera, method: str) -> EllipseFit | FailedFit:
    """Ellipse through edge points in image pixels, in undistorted pixel coordinates.

    Points that have none (where the camera's lens images nothing, or beyond 90 degrees) are left out.
    """
    points = undistort_px(camera, points_px)
    seen = np.isfinite(points).all(axis=1)
    if len(points) and not seen.any():
        return FailedFit("the contour lies outside the field of the camera's lens model")
    points, sigma_px = points[seen], None if sigma_px is None else sigma_px[seen]
    if method == "ml":
        return fit_ellipse(points, sigma_px)
    if method == "direct":
        ellipse = direct_ellipse(points)
        return ellipse if isinstance(ellipse, FailedFit) else _plain_fit(ellipse, points)
    return FailedFit("EdgeDrawing needs an image, and there are only points")


def _plain_fit(ellipse: Array, points: Array) -> EllipseFit:
    """An ellipse that comes without a covariance."""
    residual = foot_points(ellipse, points)[0]
    sigma = float(np.sqrt(np.sum(residual**2) / max(len(points) - 5, 1)))
    unknown = np.full((5, 5), np.nan)
    return EllipseFit(ellipse, unknown, sigma, len(points), unknown, residual)


def estimate_of(
    fit: EllipseFit | FailedFit,
    camera: Camera,
    diameter_m: float,
    knowledge: Knowledge,
    key: tuple[int, int, str, str],
) -> Estimate:
    """Both poses of a fitted ellipse, with their covariance; `key` is (frame_id, detection_id, method, intrinsics)."""
    if isinstance(fit, FailedFit):
        return Estimate(*key, status="failed", reason=fit.reason)
    try:
        normal, centre_m, cov = _poses_with_covariance(fit, camera.K, diameter_m / 2)
    except ValueError as error:
        return Estimate(*key, status="failed", reason=str(error), ellipse=fit.ellipse, camera=camera)
    choice = choose(normal, knowledge)
    return Estimate(
        *key,
        status="ok",
        ellipse=fit.ellipse,
        camera=camera,
        normal=normal,
        centre_m=centre_m,
        probability=choice.probability,
        chosen=choice.chosen,
        edge_points=fit.n,
        edge_sigma_px=fit.sigma_px,
        cov=cov,
    )


def _poses_with_covariance(fit: EllipseFit, k: Array, radius_m: ArrayLike) -> tuple[Array, Array, Array | None]:
    """Normals (2, 3), centres (2, 3) and covariances (2, 6, 6): J Sigma J^T with J of the closed form.

    J comes from central differences of the shape parameters, which are regular for circles too. Near the breakdown tilt
    (errata, section 6) the pose is no longer linear in the ellipse and the covariance is too large.
    """
    # A step of 1e-5 of the size: rounding 1e-16 / 1e-5 and curvature 1e-10 both vanish.
    step = 1e-5 * float(fit.ellipse[3])
    shape = shape_of_ellipse(fit.ellipse)
    varied = np.concatenate([shape[None], shape + step * np.eye(5), shape - step * np.eye(5)])
    poses = poses_from_ellipse(np.concatenate([fit.ellipse[None], ellipse_of_shape(varied[1:])]), k, radius_m)
    normal, centre = poses.normal[0], poses.centre_m[0]
    if not np.all(np.isfinite(fit.shape_cov)):
        return normal, centre, None
    # A step may exchange the candidates, where they are nearly tied: follow each by its normal.
    kept = np.sum((poses.normal - normal) ** 2, axis=(1, 2))
    exchanged = np.sum((poses.normal[:, ::-1] - normal) ** 2, axis=(1, 2))
    both = np.concatenate([poses.centre_m, poses.normal], axis=-1)
    both = np.where((exchanged < kept)[:, None, None], both[:, ::-1], both)
    jacobian = (both[1:6] - both[6:11]) / (2.0 * step)
    return normal, centre, np.einsum("pci,pq,qcj->cij", jacobian, fit.shape_cov, jacobian)
