"""The inverse of the lens model inside the tracer, in float32: image positions to the rays that the lens images there.

The exact inverses of `roundel.scenes.camera.lens_opencv` and `lens_fisheye` are computed here with a fixed number of
Newton steps, which gives one kernel without branches. The steps start from a polynomial fitted, for each camera, to the
exact inverse of the radial part: they start on the right branch, close enough to stay on it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.lens_fisheye import image_radius, widest_angle
from roundel.scenes.camera.lens_opencv import field_of, tilt_matrix
from roundel.scenes.camera.model import Camera, distorts, normalise

Array = NDArray[np.float64]

# The start: kappa, the least s, 2 / (1 - least), and a polynomial in z = (s - least) 2 / (1 - least) - 1 with
# s = sqrt(1 - kappa rho^2); then the guard, the largest radius of a solution. Where the field ends, the inverse behaves
# like a square root, which a polynomial in s can represent and one in rho cannot.
_START_TERMS = 8
_HEAD = 3 + _START_TERMS + 1

# The start is accurate to about 1e-3, and each step squares the error: two would suffice. If the image reaches the edge
# of the field, a step only halves the error, and five reduce it below 0.01 px within 0.1 % of the edge.
_STEPS = 5

# The diffracted light of a pixel also comes from beyond the image border.
_MARGIN = 1.1

_SHORT_OF_EDGE = 0.995

_TILT = 14


def lens_numbers(camera: Camera) -> tuple[float, ...]:
    """The values that `undistorted` and `directions` take; empty for a camera without distortion.

    Their number depends only on the model and its number of coefficients: cameras that differ only in values share a
    kernel.
    """
    if not distorts(camera):
        return ()
    edges = [(u, v) for u in (-0.5, camera.width_px - 0.5) for v in (-0.5, camera.height_px - 0.5)]
    c = camera.distortion
    corners = normalise(camera, np.array(edges))
    if camera.distortion_model == "fisheye":
        end = widest_angle(c)
        theta = np.linspace(0.0, end, 513)
        return (*_start(image_radius(c, theta)[0], theta, _reach(corners)), end, *c)
    field = field_of(c)
    tilt: tuple[float, ...] = ()
    if len(c) == _TILT:
        back = np.linalg.inv(tilt_matrix(*c[12:]))
        tilt = tuple(float(v) for v in back.ravel())
        corners = np.column_stack([corners, np.ones(4)]) @ back.T
        corners = corners[:, :2] / corners[:, 2:]
    farthest = float(np.max(field.edge))
    return (*_start(field.image, field.radius, _reach(corners)), min(farthest, 1e6), *c[:12], *tilt)


def _reach(corners: Array) -> float:
    return float(_MARGIN * np.linalg.norm(corners, axis=-1).max())


def _start(image: Array, radius: Array, reach: float) -> tuple[float, ...]:
    """The coefficients of the start, by least squares over the image."""
    # Stop short of the field's edge, where the radial image flattens; started inside, Newton's method stays inside.
    rho_max = min(reach, _SHORT_OF_EDGE * float(image[-1]))
    kappa = min(2 * rho_max, float(image[-1])) ** -2.0
    least = np.sqrt(max(0.0, 1 - kappa * rho_max**2))
    # Chebyshev nodes prevent oscillation of the polynomial at the ends.
    z = np.cos(np.pi * (np.arange(64) + 0.5) / 64)
    s = least + (1 - least) * (1 + z) / 2
    rho = np.sqrt((1 - s * s) / kappa)
    powers = z[:, None] ** np.arange(_START_TERMS)
    fitted, *_ = np.linalg.lstsq(powers, np.interp(rho, image, radius) / rho, rcond=None)
    return (kappa, float(least), float(2 / (1 - least)), *(float(f) for f in fitted))


def _factor(dr: Any, head: Any, rho2: Any) -> Any:
    s = dr.sqrt(dr.maximum(1 - head[0] * rho2, 0.0))
    return _polynomial(head[3:-1], (dr.maximum(s, head[1]) - head[1]) * head[2] - 1)


def _polynomial(terms: Any, x: Any) -> Any:
    value = terms[-1]
    for term in reversed(terms[:-1]):
        value = term + x * value
    return value


def undistorted(dr: Any, mi: Any, model: str, numbers: Any, xd: Any, yd: Any) -> tuple[Any, Any]:
    """Undistorted normalised coordinates of distorted ones, for OpenCV's model.

    Parameters
    ----------
    dr, mi : module
    model : str
        `opencv`; a fisheye has `directions`.
    numbers : sequence of Float
        `lens_numbers`, each opaque to the tracer.
    xd, yd : Float

    Returns
    -------
    x, y : Float
        Finite everywhere: outside the lens's field, where there is no solution, the start is returned.
    """
    if model != "opencv":
        raise ValueError(f"undistorted: the lens model {model!r} has no undistorted coordinates everywhere")
    head, (k1, k2, p1, p2, *more) = numbers[:_HEAD], numbers[_HEAD:]
    if len(more) > 8:
        h, more = more[8:], more[:8]
        w = h[6] * xd + h[7] * yd + h[8]
        xd, yd = (h[0] * xd + h[1] * yd + h[2]) / w, (h[3] * xd + h[4] * yd + h[5]) / w
    factor = _factor(dr, head, xd * xd + yd * yd)
    start_x, start_y = xd * factor, yd * factor
    x, y = start_x, start_y
    for _ in range(_STEPS):
        # The same terms as in scenes.camera.lens_opencv, which explains each.
        u = x * x + y * y
        radial, slope = _polynomial([1.0, k1, k2, *more[:1]], u), _slope([k1, k2, *more[:1]], u)
        if len(more) >= 4:
            below = 1 / _polynomial([1.0, *more[1:4]], u)
            radial = radial * below
            slope = (slope - radial * _slope(more[1:4], u)) * below
        decentring = 2 * (p1 * y + p2 * x)
        along, cross = radial + decentring, x * y * slope + 2 * (p1 * x + p2 * y)
        miss_x, miss_y = xd - x * along - p2 * u, yd - y * along - p1 * u
        a, b, c, d = along + x * x * slope + 4 * p2 * x, cross, cross, along + y * y * slope + 4 * p1 * y
        if len(more) >= 8:
            s1, s2, s3, s4 = more[4:8]
            miss_x, miss_y = miss_x - u * (s1 + u * s2), miss_y - u * (s3 + u * s4)
            prism_x, prism_y = 2 * s1 + 4 * s2 * u, 2 * s3 + 4 * s4 * u
            a, b, c, d = a + prism_x * x, b + prism_x * y, c + prism_y * x, d + prism_y * y
        over = 1 / (a * d - b * c)
        x, y = x + (d * miss_x - b * miss_y) * over, y + (a * miss_y - c * miss_x) * over
    # The comparison is also false for values that are not finite.
    good = x * x + y * y < dr.square(head[-1])
    return dr.select(good, x, start_x), dr.select(good, y, start_y)


def _slope(terms: Any, u: Any) -> Any:
    """Twice the derivative of 1 + terms[0] u + terms[1] u^2 + ..."""
    return _polynomial([2 * (i + 1) * term for i, term in enumerate(terms)], u)


def directions(dr: Any, mi: Any, numbers: Any, xd: Any, yd: Any) -> Any:
    """Unit directions of the rays that a fisheye images at distorted normalised coordinates.

    Parameters
    ----------
    dr, mi : module
    numbers : sequence of Float
        `lens_numbers`, each opaque to the tracer.
    xd, yd : Float

    Returns
    -------
    Vector3f
        Valid to 90 degrees from the axis and beyond; the lens's widest angle where it images nothing.
    """
    head, (k1, k2, k3, k4) = numbers[:_HEAD], numbers[_HEAD:]
    rho2 = xd * xd + yd * yd
    rho = dr.sqrt(rho2)
    theta = rho * _factor(dr, head, rho2)
    for _ in range(_STEPS):
        t2 = theta * theta
        value = theta * _polynomial([1.0, k1, k2, k3, k4], t2)
        theta = theta + (rho - value) / _polynomial([1.0, 3 * k1, 5 * k2, 7 * k3, 9 * k4], t2)
        theta = dr.clip(theta, 0.0, head[-1])
    sine, cosine = dr.sincos(theta)
    # On the axis sin(theta) / rho tends to 1.
    across = dr.select(rho > 1e-6, sine / rho, 1.0)
    return mi.Vector3f(xd * across, yd * across, cosine)
