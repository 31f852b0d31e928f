"""A prior on the normal: a direction, or a plane it lies in, each with a standard deviation.

Both poses are mirror images across a plane through the camera, and a reflection preserves volumes of positions and of
directions. A uniform prior over poses therefore gives both exactly the same weight. A prior over normals weights them
by its density, convolved with the uncertainty of each candidate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.solver.ambiguity.observation import MISFIT, MISTAKES, Observation, Verdict
from roundel.solver.ambiguity.viewing_cone import viewing_cone

Array = NDArray[np.float64]

_LOG_VISIBLE = -math.log(2.0 * math.pi)  # uniform density over the normals that face the camera, per steradian


# Part of a basis: the declared knowledge is unlikely for both candidates.
FITS_NEITHER = "it fits neither"


@dataclass(frozen=True, eq=False)
class NormalPrior:
    """The normal is near a known direction: gravity, an inertial sensor, the previous frame.

    Attributes
    ----------
    normal : (3,) array
        Out of the printed face, in the camera frame; any length.
    spread_deg : float
        Standard deviation along one axis of a normal distribution on the tangent plane: the density of the true normal
        falls as exp(-theta^2 / (2 spread^2)), theta the angle to `normal`.
    source : str
        Description of its source.
    """

    normal: Array
    spread_deg: float = 10.0
    source: str = "the declared normal"

    def problem(self) -> str:
        """What is wrong with it; empty if nothing is."""
        return _problem(self.normal, self.spread_deg)

    def verdict(self, observation: Observation) -> Verdict:
        """Density of the prior at each candidate, convolved with the candidate's covariance."""
        mean = _unit(self.normal)
        s2 = math.radians(self.spread_deg) ** 2
        log, far, angles = [], [], []
        for n, cov in zip(observation.normal.tolist(), _normal_cov(observation), strict=True):
            across = _cross(n, mean)
            sine = math.sqrt(_dot(across, across))
            angle = math.atan2(sine, _dot(n, mean))
            # u points from the candidate toward the prior in the candidate's tangent plane, v is perpendicular to it.
            v = [x / sine for x in across] if sine > 1e-12 else _unit(_cross(n, _least(n)))
            u = _cross(v, n)
            cu = [_dot(row, u) for row in cov]
            uu, uv, vv = s2 + _dot(u, cu), _dot(v, cu), s2 + _dot(v, [_dot(row, v) for row in cov])
            determinant = uu * vv - uv * uv
            far.append(angle * angle * vv / determinant)
            log.append(-0.5 * far[-1] - 0.5 * math.log(determinant) - math.log(2.0 * math.pi))
            angles.append(math.degrees(angle))
        return _weigh(log, far, f"{self.source} (+-{self.spread_deg:g} deg)", angles, "off")


@dataclass(frozen=True, eq=False)
class GreatCirclePrior:
    """The normal is near the plane perpendicular to an axis: that of a wall is horizontal in any direction.

    Attributes
    ----------
    axis : (3,) array
        In the camera frame; any length.
    spread_deg : float
        Standard deviation of the angle between the normal and that plane.
    toward : (3,) array or None
        If given, the normal is on this side (its dot product with `toward` is positive).
    source : str
    """

    axis: Array
    spread_deg: float = 10.0
    toward: Array | None = None
    source: str = "the declared plane of the normal"

    def problem(self) -> str:
        """What is wrong with it; empty if nothing is."""
        return _problem(self.axis, self.spread_deg) or ("" if self.toward is None else _problem(self.toward, 1.0))

    def verdict(self, observation: Observation) -> Verdict:
        """As `NormalPrior.verdict`; along the great circle the density is uniform."""
        axis = _unit(self.axis)
        toward = None if self.toward is None else _unit(self.toward)
        length = 2.0 * math.pi if toward is None else math.pi  # of the circle or half circle
        s2 = math.radians(self.spread_deg) ** 2
        log, far, angles = [], [], []
        for n, cov in zip(observation.normal.tolist(), _normal_cov(observation), strict=True):
            angle = math.asin(max(-1.0, min(1.0, _dot(n, axis))))
            variance = s2 + _dot(axis, [_dot(row, axis) for row in cov])
            distance = angle * angle / variance
            value = -0.5 * distance - 0.5 * math.log(2.0 * math.pi * variance) - math.log(length)
            if toward is not None:
                z = _dot(n, toward) / math.sqrt(s2 + _dot(toward, [_dot(row, toward) for row in cov]))
                value += math.log(max(0.5 * math.erfc(-z / math.sqrt(2.0)), 1e-300))
                distance += min(z, 0.0) ** 2
            far.append(distance)
            log.append(value)
            angles.append(abs(math.degrees(angle)))
        return _weigh(log, far, f"{self.source} (+-{self.spread_deg:g} deg)", angles, "out of it")


def _problem(vector: ArrayLike, spread_deg: float) -> str:
    v = np.asarray(vector, dtype=np.float64)
    if v.shape != (3,) or not np.all(np.isfinite(v)) or not np.any(v) or not 0 < spread_deg < math.inf:
        return "a prior normal must be a finite, non-zero vector of three numbers, with a positive standard deviation"
    return ""


# Plain floats: one array operation on three numbers takes as long as a whole verdict, which every detection needs.
def _dot(a: list[float], b: list[float]) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: list[float], b: list[float]) -> list[float]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _unit(vector: ArrayLike) -> list[float]:
    x, y, z = (float(v) for v in np.asarray(vector).tolist())
    length = math.hypot(x, y, z)
    return [x / length, y / length, z / length]


def _least(n: list[float]) -> list[float]:
    """The coordinate axis that is farthest from n."""
    i = min(range(3), key=lambda j: abs(n[j]))
    return [float(j == i) for j in range(3)]


def _normal_cov(observation: Observation) -> list[list[list[float]]]:
    """Covariance (2, 3, 3) of both normals: as given, else from ellipse and camera, else zero."""
    if observation.cov is not None:
        own: list[list[list[float]]] = observation.cov[:, 3:, 3:].tolist()
        if math.isfinite(sum(map(sum, own[0])) + sum(map(sum, own[1]))):
            return own
    cone = viewing_cone(observation)
    if cone is None:
        return [[[0.0] * 3] * 3] * 2
    g = cone.spread(cone.normal)
    both: list[list[list[float]]] = (g @ g.swapaxes(-1, -2)).tolist()
    return both


def _weigh(log: list[float], far: list[float], source: str, angles: list[float], how: str) -> Verdict:
    even = math.log(MISTAKES) + _LOG_VISIBLE
    top = max(*log, even)
    first, second = (math.log((1.0 - MISTAKES) * math.exp(v - top) + math.exp(even - top)) for v in log)
    basis = f"{source}: the candidates are {angles[0]:.1f} and {angles[1]:.1f} deg {how}"
    if min(far) > MISFIT:
        basis += f", {FITS_NEITHER}"
    return Verdict(first - second, basis)


def previous_normal(
    normal: ArrayLike, spread_deg: float = 10.0, camera_from_previous: ArrayLike | None = None
) -> NormalPrior:
    """The normal of the previous frame as a prior.

    Parameters
    ----------
    normal : (3,) array_like
        Chosen normal of the previous frame, in that frame's camera coordinates.
    spread_deg : float
        Standard deviation of the rotation of marker and camera since then, including the previous estimate's error.
    camera_from_previous : (3, 3) array_like, optional
        Rotation from the previous camera coordinates to the current ones, if known.
    """
    n = np.asarray(normal, dtype=np.float64)
    if camera_from_previous is not None:
        n = np.asarray(camera_from_previous, dtype=np.float64) @ n
    return NormalPrior(n, spread_deg, "the normal of the previous frame")


def on_floor(gravity: ArrayLike | None = None, spread_deg: float = 10.0) -> NormalPrior | GreatCirclePrior:
    """A marker on a floor or a table: its normal points up.

    Parameters
    ----------
    gravity : (3,) array_like, optional
        Direction of gravity in the camera frame (x right, y down, z forward): (0, 1, 0) for a level camera. By default
        the image is taken as upright (no roll), with unknown pitch of the camera.
    spread_deg : float
        Standard deviation of gravity and the floor together; without gravity, of the camera's roll.
    """
    return _lying(gravity, spread_deg, -1.0, "a floor")


def on_ceiling(gravity: ArrayLike | None = None, spread_deg: float = 10.0) -> NormalPrior | GreatCirclePrior:
    """A marker on a ceiling: its normal points down; see `on_floor`."""
    return _lying(gravity, spread_deg, 1.0, "a ceiling")


def on_wall(gravity: ArrayLike | None = None, spread_deg: float = 10.0) -> GreatCirclePrior:
    """A marker on a wall: its normal is horizontal, with unknown heading.

    Parameters
    ----------
    gravity : (3,) array_like, optional
        As in `on_floor`; by default the camera is level, within `spread_deg`.
    spread_deg : float
    """
    known = gravity is not None
    axis = np.asarray(gravity if known else (0.0, 1.0, 0.0), dtype=np.float64)
    return GreatCirclePrior(axis, spread_deg, source="a wall" if known else "a wall seen by a level camera")


def _lying(gravity: ArrayLike | None, spread_deg: float, sign: float, what: str) -> NormalPrior | GreatCirclePrior:
    if gravity is not None:
        return NormalPrior(sign * np.asarray(gravity, dtype=np.float64), spread_deg, what)
    upright, down = np.array([1.0, 0.0, 0.0]), np.array([0.0, sign, 0.0])
    return GreatCirclePrior(upright, spread_deg, down, f"{what} in an upright image")
