"""The pixels of one marker in a view, and the pose and focal length of its fitted print as a `Found`."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.focal_fusion import fused_camera
from roundel.scenes.camera.model import Camera, distort_px, distorts, undistort_px
from roundel.scenes.geometry.conic import ellipse_of_conic
from roundel.solver.detect.grey_image import noise_dn
from roundel.solver.methods.plugin import Found, View
from roundel.solver.photometry.image_levels import grey_levels
from roundel.solver.views.disc_pattern import Pixels
from roundel.solver.views.homography_pose import (
    FocalMeasurement,
    MeasuredHomography,
    PlanePose,
    focal_of_homography,
    poses_of_homography,
)

Array = NDArray[np.float64]

MOST_PIXELS = 6000


@dataclass(frozen=True, eq=False)
class LightImage:
    """A view's grey levels, linear in light as far as its curve is known, with their noise and camera."""

    levels: NDArray[np.float64]
    noise_dn: float
    camera: Camera

    def at(self, undistorted_px: Array) -> Array:
        """Levels at undistorted positions (..., 2), bilinear; NaN outside the image."""
        from scipy.ndimage import map_coordinates

        places = distort_px(self.camera, undistorted_px)
        places = np.where(np.isfinite(places), places, -10.0)
        return np.asarray(
            map_coordinates(self.levels, (places[..., 1], places[..., 0]), order=1, cval=np.nan), dtype=np.float64
        )


def light_image(view: View) -> LightImage:
    """The grey levels of a view."""
    grey, _ = grey_levels(view.image, view.curve)
    return LightImage(np.asarray(grey, dtype=np.float64), float(noise_dn(grey)), view.camera)


def pixels_inside(image: LightImage, conic: Array, reach: float) -> Pixels | None:
    """The pixels inside a conic grown by a factor about its centre; every n-th if there are many.

    None if part of it is outside the image, or it has fewer pixels than a print has unknowns.
    """
    x, y, a, b, angle = ellipse_of_conic(conic)
    height, width = image.levels.shape
    turn = np.arange(64) * (2 * np.pi / 64)
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    along, across = reach * a * np.cos(turn), reach * b * np.sin(turn)
    rim = np.stack([x + along * c - across * s, y + along * s + across * c], axis=1)
    seen = distort_px(image.camera, rim)
    if not np.all(np.isfinite(seen)):
        return None
    low, high = np.floor(seen.min(axis=0)).astype(int), np.ceil(seen.max(axis=0)).astype(int)
    if low.min() < 0 or high[0] >= width or high[1] >= height:
        return None
    rows, columns = np.mgrid[low[1] : high[1] + 1, low[0] : high[0] + 1]
    places = np.stack([columns.ravel(), rows.ravel()], axis=1).astype(np.float64)
    if distorts(image.camera):
        places = undistort_px(image.camera, places)
    u, v = places[:, 0] - x, places[:, 1] - y
    inside = np.flatnonzero(((u * c + v * s) / a) ** 2 + ((v * c - u * s) / b) ** 2 < reach**2)
    if len(inside) < 40:
        return None
    # A step that shares no factor with a row's length would be better still; rows of an ellipse differ in length.
    inside = inside[:: -(-len(inside) // MOST_PIXELS)]
    return Pixels(places[inside], image.levels[rows.ravel()[inside], columns.ravel()[inside]])


def conic_of_homography(matrix: Array) -> Array:
    """Image of the unit circle, (3, 3), positive inside, unit Frobenius norm."""
    inverse = np.linalg.inv(matrix)
    conic = -inverse.T @ np.diag([1.0, 1.0, -1.0]) @ inverse
    return np.asarray(conic / np.linalg.norm(conic))


@dataclass(frozen=True, eq=False)
class MetricReading:
    """What a measured homography says: focal length from it alone, the camera of the poses, both poses, best first."""

    focal: FocalMeasurement | None
    camera: Camera
    poses: list[PlanePose]


def metric_reading(view: View, measured: MeasuredHomography) -> MetricReading:
    """Focal length and poses: those for the view's focal length, fused with the measured one if it is uncertain."""
    focal = focal_of_homography(measured, view.camera.K, view.camera.width_px)
    camera = view.camera
    if focal is not None:
        camera = fused_camera(camera, view.focal_sigma, focal.focal_px, focal.sigma_px)
    return MetricReading(focal, camera, poses_of_homography(measured, camera.K))


def found_of(view: View, measured: MeasuredHomography, identity: int | None, confidence: float) -> Found:
    """The single pose that explains a homography best, with the focal length that it says by itself."""
    reading = metric_reading(view, measured)
    best = reading.poses[0]
    origin = measured.matrix[:2, 2] / measured.matrix[2, 2]
    return Found(
        poses=[(best.normal, best.centre * view.diameter_m / 2)],
        ellipse=ellipse_of_conic(conic_of_homography(measured.matrix)),
        centre_px=distort_px(view.camera, origin),
        chosen=0,
        confidence=confidence,
        identity=identity,
        focal_px=None if reading.focal is None else reading.focal.focal_px,
        focal_sigma_px=None if reading.focal is None else reading.focal.sigma_px,
        camera=None if reading.camera is view.camera else reading.camera,
    )
