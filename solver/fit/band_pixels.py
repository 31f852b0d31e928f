"""The pixels of a band and their distances to an ellipse, with derivatives, also under lens distortion.

The image is never undistorted. An ellipse in undistorted pixel coordinates maps to a curve in the image; a pixel's
distance is the distance to that curve in image pixels, in which blur and pixel area are defined.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera, denormalise, distort_normalised, distort_px, normalise, undistort_px
from roundel.scenes.geometry.conic import ellipse_points
from roundel.scenes.geometry.edge_spread_function import ellipse_curvature
from roundel.solver.fit.edge_band import Band, kept, shape_jacobian
from roundel.solver.fit.ellipse_distance import foot_points

Array = NDArray[np.float64]

_OUTLINE = 256  # points on the distorted contour that determine its curvature


@dataclass(frozen=True, eq=False)
class BandPixels:
    """Pixels near a contour: the band in the image, and the derivative of each distance by the ellipse.

    Attributes
    ----------
    band : Band
        Distances, normals and curvatures of the curve in the image.
    jacobian : (N, 5) array
        Derivative of the distance by (x, y, S11, S12, S22) of the ellipse in undistorted pixel coordinates.
    """

    band: Band
    jacobian: Array


def band_pixels(band: Band, shape: Array, camera: Camera | None) -> BandPixels:
    """Distances and derivatives of the pixels of a band, for the ellipse of shape (x, y, S11, S12, S22).

    Parameters
    ----------
    band : Band
        The pixels; everything except positions, values and sectors is replaced.
    shape : (5,) array
        Ellipse in undistorted pixel coordinates.
    camera : Camera or None
        With distortion; None if image and undistorted pixels are the same.

    Returns
    -------
    BandPixels
        Without the pixels outside the field of the lens model.
    """
    x, y, s11, s12, s22 = (float(v) for v in shape)
    mean, half, turn = (s11 + s22) / 2, math.hypot((s11 - s22) / 2, s12), math.atan2(s12, (s11 - s22) / 2) / 2
    ellipse = np.array([x, y, mean + half, mean - half, math.degrees(turn)])
    if camera is not None:
        straight = undistort_px(camera, band.pixel_px)
        seen = np.asarray(np.isfinite(straight).all(axis=1))
        band, straight = kept(band, seen), straight[seen]
    else:
        straight = band.pixel_px
    distance, normal, u = foot_points(ellipse, straight)
    jacobian = shape_jacobian(normal, u)
    c, s = math.cos(turn), math.sin(turn)
    cos_t, sin_t = u[:, 0] * c + u[:, 1] * s, u[:, 1] * c - u[:, 0] * s
    if camera is None:
        curvature, curvature_ss = ellipse_curvature(ellipse[2], ellipse[3], cos_t, sin_t)
    else:
        feet = normalise(camera, straight - distance[:, None] * normal)
        imaged, lens = distort_normalised(camera, feet)
        k = camera.K[:2, :2]
        lens = k @ lens @ np.linalg.inv(k)
        # The normal of a line element transforms by the inverse transpose; its length scales the distance.
        carried = np.linalg.solve(np.swapaxes(lens, 1, 2), normal[..., None])[..., 0]
        stretch = 1.0 / np.hypot(carried[:, 0], carried[:, 1])
        normal = carried * stretch[:, None]
        jacobian *= stretch[:, None]
        offset = band.pixel_px - denormalise(camera, imaged)
        along = offset[:, 1] * normal[:, 0] - offset[:, 0] * normal[:, 1]
        curvature, curvature_ss = _curvature_in_image(camera, ellipse, np.arctan2(sin_t, cos_t))
        # The foot point in the image differs slightly from the image of the foot point.
        distance = np.sum(offset * normal, axis=1) + curvature * along**2 / 2
        sound = np.isfinite(distance)
        if not np.all(sound):
            band, jacobian, distance, normal, u = (
                kept(band, sound),
                jacobian[sound],
                distance[sound],
                normal[sound],
                u[sound],
            )
            curvature, curvature_ss = curvature[sound], curvature_ss[sound]
    nx, ny = np.abs(normal).T
    band = replace(
        band,
        distance=distance,
        normal=normal,
        u=u,
        half_sum=(nx + ny) / 2,
        half_difference=(nx - ny) / 2,
        curvature=curvature,
        curvature_ss=curvature_ss,
    )
    return BandPixels(band, jacobian)


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
