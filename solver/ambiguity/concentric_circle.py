"""A concentric circle (centre dot, inner edge of a ring) as a cue for the choice between both poses.

The two poses predict the image of the marker's centre on opposite sides of the outer ellipse's centre, at a distance of
a^2 sin(2 tilt) / (2 f) px; the ellipse of a concentric circle is displaced slightly less. Only the circle's position
distinguishes the poses, so only its centre is measured: its size carries no information and may be known roughly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera, distort_px, distorts, undistort_px
from roundel.scenes.geometry.edge_spread_function import PIXEL_VARIANCE, step_response
from roundel.solver.ambiguity.observation import MISFIT, MISTAKES, Observation, Verdict
from roundel.solver.ambiguity.viewing_cone import concentric_image, viewing_cone
from roundel.solver.fit.ellipse import FailedFit, ellipse_of_shape
from roundel.solver.fit.ellipse_distance import foot_points

Array = NDArray[np.float64]

# Error of a centre without noise: edges between pixels, ink that spreads unevenly.
_FLOOR_PX = 0.01
_REACH_PX = 3.0  # width of the band beside the circle's edge, in addition to its blur
_ROUNDS = 12


@dataclass(frozen=True)
class ConcentricCircle:
    """A circle about the marker's centre.

    Attributes
    ----------
    ratio : float
        Its diameter as a fraction of the marker's outer diameter.
    next_ratio : float
        Relative diameter of the next larger printed circle; 1 if that is the outer circle.
    hollow : bool
        Whether its interior is anything but one uniform shade.
    """

    ratio: float
    next_ratio: float = 1.0
    hollow: bool = False

    def problem(self) -> str:
        """What is invalid about it; empty if it is valid."""
        if 0 < self.ratio < self.next_ratio <= 1:
            return ""
        return (
            "a concentric circle has a diameter between 0 and that of the next larger one, as a fraction of the outer"
        )

    def verdict(self, observation: Observation) -> Verdict:
        """Likelihood of the measured centre under both poses."""
        name = f"concentric circle of {self.ratio:g} diameters"
        cone = viewing_cone(observation)
        if cone is None or observation.image is None or observation.uncertain_camera is None:
            return Verdict(0.0, f"{name}: not evaluated, because there is no image, ellipse or camera")
        centre, spread = concentric_image(cone.cone[:, None], cone.normal, cone.K[:, None], self.ratio)
        starts = [_ellipse(centre[0, i], spread[0, i]) for i in range(2)]
        gap = (self.next_ratio / self.ratio - 1.0) * float(starts[0][3])
        apart = float(np.hypot(*(centre[0, 0] - centre[0, 1])))
        outside = min(_REACH_PX + 2.0 * observation.blur_px, 0.6 * gap)
        inside = 0.5 * float(starts[0][3]) if self.hollow else math.inf
        if outside < 1.0:
            return Verdict(0.0, f"{name}: too close to the next circle to be resolved")
        camera = observation.uncertain_camera.camera
        fits = [fit_centre(observation.image, camera, e, inside, outside, observation.blur_px) for e in starts]
        found = [fit for fit in fits if not isinstance(fit, FailedFit)]
        if not found:
            return Verdict(0.0, f"{name}: not measured, {fits[0].reason if isinstance(fits[0], FailedFit) else ''}")
        best = min(found, key=lambda fit: fit.rms)
        log, far = [], []
        # A circle of another object may be anywhere in the search region.
        anywhere = -math.log(math.pi * (apart + outside) ** 2)
        for i in range(2):
            g = cone.spread(centre[:, i])
            total = best.cov + g @ g.T + _FLOOR_PX**2 * np.eye(2)
            miss = best.centre_px - centre[0, i]
            far.append(float(miss @ np.linalg.solve(total, miss)))
            value = -0.5 * far[-1] - 0.5 * math.log(float(np.linalg.det(total))) - math.log(2.0 * math.pi)
            log.append(float(np.logaddexp(math.log1p(-MISTAKES) + value, math.log(MISTAKES) + anywhere)))
        basis = f"{name}: its centre is {math.sqrt(far[0]):.1f} and {math.sqrt(far[1]):.1f} sigma from both predictions"
        if min(far) > MISFIT:
            basis += ", it fits neither"
        return Verdict(log[0] - log[1], f"{basis}, which are {apart:.2g} px apart")


@dataclass(frozen=True, eq=False)
class MeasuredCentre:
    """Centre of a small ellipse in undistorted pixels, its covariance (2, 2), and the RMS residual of the fit."""

    centre_px: Array
    cov: Array
    rms: float


def fit_centre(
    image: NDArray[Any], camera: Camera, ellipse: Array, inside_px: float, outside_px: float, blur_px: float
) -> MeasuredCentre | FailedFit:
    """Locate a filled ellipse of known shape: fit position, scale, two grey levels and a gradient of the light.

    The model is symmetric about the centre, as is the image of a dot under any symmetric blur. A wrong blur or size
    therefore increases the residual but does not shift the centre.

    Parameters
    ----------
    image : (H, W) array
    camera : Camera
    ellipse : (5,) array
        Predicted ellipse, undistorted pixels.
    inside_px, outside_px : float
        Largest distances of the used pixels from its edge.
    blur_px : float

    Returns
    -------
    MeasuredCentre or FailedFit
    """
    current = np.array(ellipse, dtype=np.float64)
    variance = max(blur_px, 0.15) ** 2
    pixels = _pixels_near(image, camera, current, outside_px + 1.0)
    if isinstance(pixels, FailedFit):
        return pixels
    places, values = pixels
    for _ in range(_ROUNDS):
        distance, normal, u = foot_points(current, places)
        keep = (distance <= outside_px) & (distance >= -inside_px)
        if np.count_nonzero(keep) < 16:
            return FailedFit("too few pixels around it")
        distance, normal, u, value = distance[keep], normal[keep], u[keep], values[keep]
        place = places[keep] - current[:2]
        nx, ny = np.abs(normal).T
        t, slope, _ = step_response(
            distance + (variance + PIXEL_VARIANCE) * _curvature(current, u) / 2, (nx + ny) / 2, (nx - ny) / 2, variance
        )
        levels = np.linalg.lstsq(np.stack([1.0 - t, t], axis=1), value, rcond=None)[0]
        plain = levels[0] * (1.0 - t) + levels[1] * t
        height = float(levels[1] - levels[0])
        # The foot point moves with the centre, and outward with the scale; the distance z decreases by as much.
        lean = -height * slope
        reach = np.sum(normal * (place - distance[:, None] * normal), axis=1)
        columns = np.stack(
            [
                lean * normal[:, 0],
                lean * normal[:, 1],
                lean * reach,
                1.0 - t,
                t,
                plain * place[:, 0],
                plain * place[:, 1],
            ],
            axis=1,
        )
        size = np.maximum(np.linalg.norm(columns, axis=0), 1e-12)
        solution, _, rank, _ = np.linalg.lstsq(columns / size, value - plain, rcond=1e-10)
        if rank < columns.shape[1]:
            return FailedFit("its pixels do not determine a centre")
        solution = solution / size
        move = np.clip(solution[:2], -1.0, 1.0)
        current[:2] += move
        current[2:4] *= 1.0 + float(np.clip(solution[2], -0.1, 0.1))
        if not (0.5 < current[2] / ellipse[2] < 2.0) or np.hypot(*(current[:2] - ellipse[:2])) > 3.0 * outside_px:
            return FailedFit("there is no circle where it should be")
        if np.hypot(*move) < 1e-4:
            break
    left = value - plain - columns @ solution
    noise2 = max(float(left @ left) / max(len(left) - columns.shape[1], 1), 1e-12)
    inverse = np.linalg.inv((columns / size).T @ (columns / size))[:2, :2] / np.outer(size[:2], size[:2])
    if abs(height) < 4.0 * math.sqrt(noise2 / len(left)) or abs(height) < 2.0 * math.sqrt(noise2):
        return FailedFit("its contrast is below the noise")
    return MeasuredCentre(current[:2].copy(), noise2 * inverse, math.sqrt(noise2))


def _pixels_near(
    image: NDArray[Any], camera: Camera, ellipse: Array, margin_px: float
) -> tuple[Array, Array] | FailedFit:
    """Undistorted positions (N, 2) and grey levels (N,) of the pixels in a box around an ellipse."""
    height, width = image.shape
    middle = distort_px(camera, ellipse[:2])
    if not np.all(np.isfinite(middle)):
        return FailedFit("it is outside the field of the camera's lens model")
    half = float(ellipse[2]) * (1.3 if distorts(camera) else 1.0) + margin_px
    low = np.floor(middle - half).astype(np.int64)
    high = np.ceil(middle + half).astype(np.int64) + 1
    if np.any(low < 0) or high[0] > width or high[1] > height:
        return FailedFit("it extends beyond the image")
    rows, columns = np.mgrid[low[1] : high[1], low[0] : high[0]]
    places = undistort_px(camera, np.stack([columns.ravel(), rows.ravel()], axis=1).astype(np.float64))
    seen = np.isfinite(places).all(axis=1)
    return places[seen], image[low[1] : high[1], low[0] : high[0]].ravel()[seen].astype(np.float64)


def _ellipse(centre: Array, spread: Array) -> Array:
    """Ellipse (5,) from its centre and S S^T."""
    value, vector = np.linalg.eigh(spread)
    root = (vector * np.sqrt(np.maximum(value, 1e-12))) @ vector.T
    return ellipse_of_shape(np.array([centre[0], centre[1], root[0, 0], root[0, 1], root[1, 1]]))


def _curvature(ellipse: Array, u: Array) -> Array:
    a, b, angle = float(ellipse[2]), float(ellipse[3]), math.radians(ellipse[4])
    along = u[:, 0] * math.cos(angle) + u[:, 1] * math.sin(angle)
    across = u[:, 1] * math.cos(angle) - u[:, 0] * math.sin(angle)
    return np.asarray(1.0 / (a * a * b * b * ((along / a) ** 2 + (across / b) ** 2) ** 1.5))
