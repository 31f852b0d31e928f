"""OpenCV's fisheye (Kannala and Brandt, 2006) on normalised coordinates: forward, field, and the exact inverse.

    theta = angle from the optical axis,  theta_d = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)
    (x'', y'') = theta_d (cos phi, sin phi)

Source: OpenCV, module calib3d, "Fisheye camera model". The image is a function of the direction: it exists at 90
degrees from the axis and beyond, where undistorted coordinates x = tan(theta) cos(phi) do not. The field ends where
theta_d stops growing, or at 180 degrees.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Coefficients = tuple[float, ...]

# Newton's method within a bracket usually needs three steps; where theta_d levels off, bisection takes over.
_STEPS = 80
# Below this radius quotients of small numbers lose digits, and the next term of the series is 1e-18.
_NEAR_AXIS = 1e-3


def image_radius(coefficients: Coefficients, theta: Array) -> tuple[Array, Array]:
    """theta_d of angles from the axis in radians, and d theta_d / d theta."""
    k1, k2, k3, k4 = coefficients
    t2 = theta * theta
    value = theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
    slope = 1 + t2 * (3 * k1 + t2 * (5 * k2 + t2 * (7 * k3 + t2 * 9 * k4)))
    return value, slope


@lru_cache(maxsize=64)
def widest_angle(coefficients: Coefficients) -> float:
    """Angle from the axis, in radians, at which the field ends: the maximum of theta_d, or pi."""
    k1, k2, k3, k4 = coefficients
    # As a polynomial in 1 / theta^2: its leading coefficient is always 1, and the largest root is the one needed.
    roots = np.roots([1.0, 3 * k1, 5 * k2, 7 * k3, 9 * k4])
    # The root finder returns a double root, where theta_d is only stationary, with a small imaginary part.
    real = roots.real[(np.abs(roots.imag) < 1e-7 * np.abs(roots)) & (roots.real > 0)]
    return min(float(real.max()) ** -0.5, np.pi) if len(real) else np.pi


def distort(coefficients: Coefficients, xy: Array) -> tuple[Array, Array]:
    """Image of normalised coordinates (..., 2), and the Jacobian (..., 2, 2); NaN outside the field."""
    k1, k2, _, _ = coefficients
    r2 = xy[..., 0] ** 2 + xy[..., 1] ** 2
    r = np.sqrt(r2)
    near = r < _NEAR_AXIS
    safe = np.where(near, 1.0, r)
    with np.errstate(over="ignore", invalid="ignore"):
        theta = np.arctan(r)
        value, slope = image_radius(coefficients, theta)
        first, second = k1 - 1 / 3, k2 - k1 + 1 / 5  # theta_d = r (1 + first r^2 + second r^4 + ...)
        scale = np.where(near, 1 + r2 * (first + r2 * second), value / safe)
        bend = np.where(near, 2 * first + 4 * second * r2, (slope / (1 + r2) - scale) / safe**2)
        scale = np.where(theta < widest_angle(coefficients), scale, np.nan)
        out = xy * scale[..., None]
        jacobian = xy[..., :, None] * xy[..., None, :] * bend[..., None, None] + scale[..., None, None] * np.eye(2)
    return out, jacobian


def angle_of(coefficients: Coefficients, radius: Array) -> Array:
    """Angle from the axis, in radians, that is imaged at a radius theta_d >= 0; NaN outside the field."""
    end = widest_angle(coefficients)
    limit = float(image_radius(coefficients, np.array(end))[0])
    low, high = np.zeros_like(radius), np.full_like(radius, end)
    theta = np.minimum(radius, end)
    with np.errstate(divide="ignore", invalid="ignore"):
        for _ in range(_STEPS):
            value, slope = image_radius(coefficients, theta)
            miss = radius - value
            low, high = np.where(miss > 0, theta, low), np.where(miss < 0, theta, high)
            guess = theta + miss / slope
            guess = np.where((guess >= low) & (guess <= high), guess, (low + high) / 2)
            moved = np.max(np.abs(guess - theta), initial=0.0, where=radius <= limit)
            theta = np.where(miss == 0, theta, guess)
            if moved < 5e-16:
                break
    return np.where(radius <= limit, theta, np.nan)


def direction(coefficients: Coefficients, xy: Array) -> Array:
    """Unit vectors (..., 3) of the rays through distorted normalised coordinates (..., 2); NaN beyond the field."""
    radius = np.hypot(xy[..., 0], xy[..., 1])
    theta = angle_of(coefficients, radius)
    # On the axis both numerator and radius are zero: sin(theta) / radius tends to 1.
    across = np.where(radius > 0, np.sin(theta) / np.where(radius > 0, radius, 1.0), 1.0)
    return np.concatenate([xy * across[..., None], np.cos(theta)[..., None]], axis=-1)


def undistort(coefficients: Coefficients, xy: Array) -> Array:
    """The inverse of `distort`: normalised coordinates (..., 2); NaN at 90 degrees from the axis and beyond."""
    ray = direction(coefficients, xy)
    z = np.where(ray[..., 2:] > 0, ray[..., 2:], np.nan)
    return np.asarray(ray[..., :2] / z)
