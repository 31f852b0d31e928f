"""Roundel's own methods: the ellipse of a detection, by one of five fits.

Lens distortion is removed from edge points and pixel positions, never from the image: resampling destroys sub-pixel
edges.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera, distorts, undistort_px
from roundel.scenes.camera.response_curve import ResponseCurve
from roundel.scenes.geometry.conic import ellipse_points
from roundel.solver.catalogue import FITS
from roundel.solver.detect.detect import Detection, detect
from roundel.solver.fit.edge_fit import EdgeFit, fit_edges
from roundel.solver.fit.edges import EdgePoints, edge_points
from roundel.solver.fit.ellipse import (
    EllipseFit,
    FailedFit,
    direct_ellipse,
    ellipse_of_shape,
    fit_ellipse,
    shape_of_ellipse,
)
from roundel.solver.fit.ellipse_distance import foot_points
from roundel.solver.fit.guaranteed_fit import guaranteed_ellipse
from roundel.solver.fit.pixel_fit import fit_pixels
from roundel.solver.fit.row_motion import RowMotion
from roundel.solver.photometry.curve_displacement import displaced, edge_displacement_px
from roundel.solver.photometry.curve_evidence import curve_evidence
from roundel.solver.photometry.edge_levels import overshoots, side_levels
from roundel.solver.photometry.photometry import PLAIN, Photometry

Array = NDArray[np.float64]

METHODS = FITS
DEFAULT_METHOD = "pixels"
_MIN_IMAGE_PX = 8
OUTSIDE_FIELD = "the contour is outside the field of the camera's lens model"
_CLIPPED = 254.5 / 255.0
# Standard deviation of the displacement by JPEG, which depends on levels and blur that are only known roughly: a part
# of it, and more where the table is so coarse that it is large (at a quality of 20 it is 0.10 px instead of 0.055 px).
_SHIFT_SIGMA, _MORE_PER_PX = 0.5, 12.0


@dataclass(frozen=True, eq=False)
class Detections:
    """An image and its detections.

    Attributes
    ----------
    grey : (H, W) float32 array
        Grey levels, linear in light.
    full_scale_dn : float
        The level at which its pixels saturate.
    detections : list of Detection
        The strongest first.
    photometry : Photometry
        Of the grey levels.
    """

    grey: NDArray[Any]
    full_scale_dn: float
    detections: list[Detection]
    photometry: Photometry = PLAIN


@dataclass(frozen=True, eq=False)
class FallbackFit(EdgeFit):
    """An ellipse fitted to edge points because the fit to the pixels failed, for the given reason."""

    reason: str


def detect_circles(
    grey: NDArray[Any], full_scale_dn: float, photometry: Photometry | None = None, own_ellipses: bool = True
) -> Detections:
    """Detect the circles of an image; an image that is too small has none.

    `own_ellipses`: also compute EdgeDrawing's own ellipses, which only the method `edgedrawing` needs.
    """
    levels = np.require(grey, np.float32, ["C", "W"])
    large = min(grey.shape) >= _MIN_IMAGE_PX
    found = detect(grey, full_scale_dn, own_ellipses=own_ellipses, levels=levels) if large else []
    return Detections(levels, full_scale_dn, found, photometry or PLAIN)


def with_estimated_curve(
    seen: Detections, linearise: Callable[[ResponseCurve], tuple[NDArray[Any], float]]
) -> Detections:
    """The detections of an image after its response curve was estimated from them, and undone.

    Parameters
    ----------
    seen : Detections
        Of the levels as delivered.
    linearise : callable
        Returns the grey levels after a curve was undone, and their saturation level.
    """
    contours = [edges for d in seen.detections for edges in (d.edges, *d.inner)]
    curve = curve_evidence(seen.grey, contours, seen.full_scale_dn).curve
    photometry = seen.photometry.with_curve(curve)
    if curve.identity:
        return replace(seen, photometry=photometry)
    grey, full_scale_dn = linearise(curve)

    def again(edges: EdgePoints) -> EdgePoints:
        found = edge_points(grey, edges.ellipse, full_scale_dn, polish=False, known=edges)
        return edges if isinstance(found, FailedFit) else found

    found = [replace(d, edges=again(d.edges), inner=[again(e) for e in d.inner]) for d in seen.detections]
    return Detections(grey, full_scale_dn, found, photometry)


def fit_detection(
    seen: Detections, detection: Detection, camera: Camera, method: str, motion: RowMotion | None = None
) -> EllipseFit | FailedFit:
    """Ellipse of a detection in undistorted pixel coordinates, by one of `METHODS`.

    If the pixels do not determine an ellipse, or their fit does not converge, `pixels` falls back to the edge points of
    the detection; the result is then a `FallbackFit` with the reason. If the response curve is unknown, the covariance
    includes linear and sRGB levels; if the camera processed the image, what that displaces edges by.
    """
    photometry, blur_px = seen.photometry, detection.edges.blur_px
    sides = side_levels(seen.grey, detection.edges)
    fit = _fit_of(seen, detection, camera, method, motion, sides)
    if isinstance(fit, FailedFit):
        return fit
    if not photometry.curve.known:
        # Between the contours of both curves.
        inside, outside = (level / photometry.top_dn for level in sides)
        half = edge_displacement_px(inside, outside, blur_px) / 2
        # The level of a clipped side is not known, and the displacement grows with it: up to three times this one.
        clipped = max(sides) >= _CLIPPED * seen.full_scale_dn
        return displaced(fit, -half, (3.0 if clipped else 1.0) * abs(half))
    shift = photometry.displacement_px(*sides, blur_px)
    sigma_px = _SHIFT_SIGMA * abs(shift) * (1.0 + _MORE_PER_PX * abs(shift))
    by_camera = photometry.processed_px(*sides, blur_px, _is_sharpened(seen, detection))
    return displaced(fit, -shift, math.hypot(sigma_px, by_camera)) if shift or by_camera else fit


def _is_sharpened(seen: Detections, detection: Detection) -> bool:
    """Whether the camera sharpened the image: by its record, or by an edge that overshoots its levels."""
    return seen.photometry.sharpened or overshoots(seen.grey, detection.edges)


def _fit_of(
    seen: Detections,
    detection: Detection,
    camera: Camera,
    method: str,
    motion: RowMotion | None,
    sides: tuple[float, float],
) -> EllipseFit | FailedFit:
    if method == "pixels":
        floor = seen.photometry.noise_floor(*sides, detection.edges.blur_px)
        fit = fit_pixels(seen.grey, detection.edges, camera, seen.full_scale_dn, floor, motion)
        if not isinstance(fit, FailedFit):
            return fit
        instead = _fit_of(seen, detection, camera, "ml", motion, sides)
        if isinstance(instead, FailedFit):
            return instead
        return FallbackFit(**vars(instead), reason=fit.reason)
    if method == "edgedrawing":
        return _edgedrawing(detection, camera)
    # The points of a detection are only accurate enough to decide on it, so they are computed again.
    rough = detection.edges
    settled = edge_points(seen.grey, rough.ellipse, seen.full_scale_dn, known=rough)
    edges = rough if isinstance(settled, FailedFit) else settled
    if method == "ml":
        return _fit_edges(edges, camera, motion)
    return fit_points(edges.points_px, edges.sigma_px, camera, method)


def _edgedrawing(detection: Detection, camera: Camera) -> EllipseFit | FailedFit:
    if detection.edgedrawing is None:
        return FailedFit("EdgeDrawing found no ellipse on this contour")
    ellipse: Array | FailedFit = ellipse_of_shape(shape_of_ellipse(detection.edgedrawing))
    if distorts(camera):
        outline = undistort_px(camera, ellipse_points(detection.edgedrawing, 64))
        ellipse = direct_ellipse(outline[np.isfinite(outline).all(axis=1)])
    points = undistort_px(camera, detection.edges.points_px)
    points = points[np.isfinite(points).all(axis=1)]
    return ellipse if isinstance(ellipse, FailedFit) else _plain_fit(ellipse, points)


def _fit_edges(edges: EdgePoints, camera: Camera, motion: RowMotion | None) -> EdgeFit | FailedFit:
    points = undistort_px(camera, edges.points_px)
    seen = np.isfinite(points).all(axis=1)
    if len(points) and not seen.any():
        return FailedFit(OUTSIDE_FIELD)
    start = None if distorts(camera) else edges.ellipse
    return fit_edges(points[seen], edges.sigma_px[seen], motion, edges.points_px[seen], start)


def fit_points(points_px: Array, sigma_px: Array | None, camera: Camera, method: str) -> EllipseFit | FailedFit:
    """Ellipse through edge points in image pixels, in undistorted pixel coordinates.

    Points without undistorted coordinates (outside the lens model's field, or beyond 90 degrees) are left out.
    """
    points = undistort_px(camera, points_px)
    seen = np.isfinite(points).all(axis=1)
    if len(points) and not seen.any():
        return FailedFit(OUTSIDE_FIELD)
    points, sigma_px = points[seen], None if sigma_px is None else sigma_px[seen]
    if method in ("ml", "pixels"):  # only points are available
        return fit_ellipse(points, sigma_px)
    if method == "guaranteed":
        return guaranteed_ellipse(points, sigma_px)
    if method == "direct":
        ellipse = direct_ellipse(points)
        return ellipse if isinstance(ellipse, FailedFit) else _plain_fit(ellipse, points)
    return FailedFit("EdgeDrawing needs an image, but there are only points")


def _plain_fit(ellipse: Array, points: Array) -> EllipseFit:
    """An ellipse without a covariance."""
    residual = foot_points(ellipse, points)[0]
    sigma = float(np.sqrt(np.sum(residual**2) / max(len(points) - 5, 1)))
    unknown = np.full((5, 5), np.nan)
    return EllipseFit(ellipse, unknown, sigma, len(points), unknown, residual)
