"""Distances of pixels to an ellipse, with derivatives, under lens distortion.

The image is never undistorted. An ellipse in undistorted pixel coordinates maps to a curve in the image; a pixel's
distance is the distance to that curve in image pixels, in which blur and pixel area are defined.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera, denormalise, distort_normalised, distort_px, normalise, undistort_px
from roundel.scenes.geometry.conic import ellipse_points
from roundel.solver.fit.ellipse import FailedFit
from roundel.solver.kernels.contour_pixels import (
    COLUMNS,
    CURVATURE,
    CURVATURE_SS,
    DISTANCE,
    HALF_DIFFERENCE,
    HALF_SUM,
    NORMAL_X,
    U_X,
    X,
)
from roundel.solver.kernels.contour_scene import place_at

Array = NDArray[np.float64]

_OUTLINE = 256  # points on the distorted contour that determine its curvature


def place_pixels(table: Array, ellipse: Array, camera: Camera | None) -> Array | FailedFit:
    """Write the distances of the pixels of a table for an ellipse, see `contour_pixels`; returns their derivatives.

    Parameters
    ----------
    table : (N, 12) array
        Positions and values are kept, everything else is replaced: by the curve in the image.
    ellipse : (5,) array
        In undistorted pixel coordinates.
    camera : Camera or None
        With distortion; None if image and undistorted pixels are the same.

    Returns
    -------
    (N, 5) array or FailedFit
        Derivative of the distance by (x, y, S11, S12, S22); a failure if the lens model has no such place.
    """
    jacobian = np.empty((len(table), 5))
    if camera is None:
        place_at(table, ellipse, jacobian)
        return jacobian
    straight = np.empty((len(table), COLUMNS))
    straight[:, X : X + 2] = undistort_px(camera, table[:, X : X + 2])
    if not np.isfinite(straight[:, X : X + 2]).all():
        return FailedFit("the contour leaves the field of the camera's lens model")
    place_at(straight, ellipse, jacobian)
    normal = straight[:, NORMAL_X : NORMAL_X + 2]
    feet = normalise(camera, straight[:, X : X + 2] - straight[:, DISTANCE, None] * normal)
    imaged, lens = distort_normalised(camera, feet)
    k = camera.K[:2, :2]
    lens = k @ lens @ np.linalg.inv(k)
    # The normal of a line element transforms by the inverse transpose; its length scales the distance.
    carried = np.linalg.solve(np.swapaxes(lens, 1, 2), normal[..., None])[..., 0]
    stretch = 1.0 / np.hypot(carried[:, 0], carried[:, 1])
    normal = carried * stretch[:, None]
    jacobian *= stretch[:, None]
    offset = table[:, X : X + 2] - denormalise(camera, imaged)
    along = offset[:, 1] * normal[:, 0] - offset[:, 0] * normal[:, 1]
    angle = np.radians(ellipse[4])
    c, s = np.cos(angle), np.sin(angle)
    u = straight[:, U_X : U_X + 2]
    curvature, curvature_ss = _curvature_in_image(
        camera, ellipse, np.arctan2(u[:, 1] * c - u[:, 0] * s, u[:, 0] * c + u[:, 1] * s)
    )
    # The foot point in the image differs slightly from the image of the foot point.
    distance = np.sum(offset * normal, axis=1) + curvature * along**2 / 2
    if not np.isfinite(distance).all():
        return FailedFit("the contour leaves the field of the camera's lens model")
    across_x, across_y = np.abs(normal).T
    table[:, DISTANCE] = distance
    table[:, NORMAL_X : NORMAL_X + 2], table[:, U_X : U_X + 2] = normal, u
    table[:, HALF_SUM], table[:, HALF_DIFFERENCE] = (across_x + across_y) / 2, (across_x - across_y) / 2
    table[:, CURVATURE], table[:, CURVATURE_SS] = curvature, curvature_ss
    return jacobian


def _curvature_in_image(camera: Camera, ellipse: Array, t: Array) -> tuple[Array, Array]:
    """Curvature of the distorted contour at eccentric angles t, and its second derivative by arc length."""
    outline = distort_px(camera, ellipse_points(ellipse, _OUTLINE))
    order = 1j * np.fft.fftfreq(_OUTLINE, 1.0 / _OUTLINE)

    def derivative(values: Array) -> Array:
        return np.real(np.fft.ifft(np.fft.fft(values, axis=0) * order.reshape(-1, *[1] * (values.ndim - 1)), axis=0))

    first = derivative(outline)
    second = derivative(first)
    speed = np.hypot(first[:, 0], first[:, 1])
    curvature = (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / speed**3
    curvature_ss = derivative(derivative(curvature) / speed) / speed
    at = np.linspace(0.0, 2 * np.pi, _OUTLINE + 1)
    t = np.mod(t, 2 * np.pi)
    return (
        np.interp(t, at, np.append(curvature, curvature[0])),
        np.interp(t, at, np.append(curvature_ss, curvature_ss[0])),
    )
