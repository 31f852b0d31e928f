"""Quadrature nodes of a prediction: lens, time, diffraction, soft edges."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera
from roundel.scenes.camera.motion import Motion

Array = NDArray[np.float64]

# The Airy pattern is truncated where x = 2 pi A alpha / lambda reaches this, and renormalised.
AIRY_LIMIT = 64.0
_AIRY_TABLE = 8192

_SEED = 20_260_101


@dataclass(frozen=True)
class Nodes:
    """Equally weighted points (n,) over everything that blurs an edge.

    Attributes
    ----------
    lens_m : (n, 2) array
        In the plane of the aperture.
    time_s : (n,) array
        Relative to mid-exposure.
    airy_px : (n, 2) array
        Offset from a pixel's sample to the scene point that it sees.
    ramp : (n, 2) array
        In -0.5 .. 0.5: position on the ramps of soft edges.
    """

    lens_m: Array
    time_s: Array
    airy_px: Array
    ramp: Array

    def __len__(self) -> int:
        return len(self.time_s)

    def few(self, count: int) -> Nodes:
        """`count` of the nodes, evenly spread over all of them."""
        return self.part(np.arange(0, len(self), max(1, len(self) // count)))

    def part(self, start: int | NDArray[np.int64], size: int = 1) -> Nodes:
        """`size` nodes from index `start` on, or those with the given indices."""
        which = slice(start, start + size) if isinstance(start, int) else start
        return Nodes(self.lens_m[which], self.time_s[which], self.airy_px[which], self.ramp[which])


def _disc(u: Array, v: Array) -> Array:
    """Map the unit square to the unit disc, area-preserving and smooth at the centre (Shirley and Chiu 1997)."""
    a, b = 2 * u - 1, 2 * v - 1
    first = np.abs(a) > np.abs(b)
    with np.errstate(divide="ignore", invalid="ignore"):
        angle = np.where(first, np.pi / 4 * b / a, np.pi / 2 - np.pi / 4 * a / b)
    radius = np.where(first, a, b)
    angle = np.where(radius == 0, 0.0, angle)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)


def _polygon(disc: Array, corners: int, turn_deg: float) -> Array:
    """Map the unit disc to a regular polygon with corners on its circle, area-preserving: sectors become triangles."""
    radius = np.hypot(disc[:, 0], disc[:, 1])
    which, share = np.divmod(np.mod(np.arctan2(disc[:, 1], disc[:, 0]) / (2 * np.pi), 1.0) * corners, 1.0)
    first = np.radians(turn_deg) + 2 * np.pi / corners * which
    second = first + 2 * np.pi / corners
    near, far = radius * (1 - share), radius * share
    return np.stack([near * np.cos(first) + far * np.cos(second), near * np.sin(first) + far * np.sin(second)], axis=-1)


@lru_cache(maxsize=1)
def _airy_table() -> tuple[Array, Array]:
    """Encircled energy 1 - J0^2 - J1^2 of the Airy pattern (Rayleigh 1881), truncated at AIRY_LIMIT and rescaled."""
    from scipy.special import j0, j1

    x = np.linspace(0.0, AIRY_LIMIT, _AIRY_TABLE)
    energy = 1 - j0(x) ** 2 - j1(x) ** 2
    return energy / energy[-1], x


def _airy_radius(u: Array) -> Array:
    """Radius x that contains a fraction u of the truncated Airy pattern's energy."""
    energy, x = _airy_table()
    return np.interp(u, energy, x)


def area_radius_m(camera: Camera) -> float:
    """Radius of the circle that has the aperture's area."""
    if camera.blades == 0:
        return camera.aperture_radius_m
    n = camera.blades
    return camera.aperture_radius_m * float(np.sqrt(n * np.sin(2 * np.pi / n) / (2 * np.pi)))


@lru_cache(maxsize=8)
def _sobol(dimensions: int, count: int) -> Array:
    """Points (count, dimensions) of a scrambled Sobol sequence; even steps if there is only one dimension.

    The mirror images of the even steps fall halfway between them.
    """
    from scipy.stats import qmc

    if dimensions == 1:
        return np.asarray(((np.arange(count) + 0.25) / count)[:, None], dtype=np.float64)
    engine = qmc.Sobol(dimensions, scramble=True, rng=np.random.default_rng(_SEED))
    return np.asarray(engine.random(count), dtype=np.float64)


def active_dimensions(camera: Camera, motion: Motion, softness_m: float) -> int:
    """Number of dimensions of an edge's blur."""
    diffracted = 0 if not camera.wavelengths_m else 2 + (len(camera.wavelengths_m) > 1)
    timed = motion.moves and motion.exposure_s > 0
    return 2 * (camera.aperture_radius_m > 0) + diffracted + timed + 2 * (softness_m > 0)


# Number of nodes for an error below 1e-3 of the contrast (RMS over the pixels of the edge): few suffice for one
# dimension; the long tail of the Airy pattern needs more.
_ALONG_ONE, _COMMON, _AIRY = 128, 1024, 2048


def _count(camera: Camera, dimensions: int) -> int:
    if dimensions == 1:
        return _ALONG_ONE
    return _AIRY if camera.wavelengths_m else _COMMON


def nodes_of(camera: Camera, motion: Motion, softness_m: float, count: int | None = None) -> Nodes:
    """Nodes for everything that blurs an edge: a single one if nothing does, else `count`, a power of two."""
    dimensions = active_dimensions(camera, motion, softness_m)
    count = _count(camera, dimensions) if count is None else count
    if dimensions == 0:
        return Nodes(np.zeros((1, 2)), np.zeros(1), np.zeros((1, 2)), np.zeros((1, 2)))
    # Half of the nodes mirror the others: a symmetric blur must not displace an edge.
    columns = iter(_sobol(dimensions, count // 2).T)
    half = count // 2
    lens, airy, ramp = (np.zeros((half, 2)) for _ in range(3))
    time = np.zeros(half)
    if camera.aperture_radius_m > 0:
        lens = _disc(next(columns), next(columns))
        if camera.blades:
            lens = _polygon(lens, camera.blades, camera.blade_turn_deg)
        lens = camera.aperture_radius_m * lens
    if motion.moves and motion.exposure_s > 0:
        time = motion.exposure_s * (next(columns) - 0.5)
    if camera.wavelengths_m:
        x, turn = _airy_radius(next(columns)), 2 * np.pi * next(columns)
        wavelengths = np.array(camera.wavelengths_m)
        which = np.zeros(half, dtype=np.int64)
        if len(wavelengths) > 1:
            which = np.minimum((next(columns) * len(wavelengths)).astype(np.int64), len(wavelengths) - 1)
        # x = 2 pi A alpha / lambda, alpha in normalised image coordinates.
        alpha = x * wavelengths[which] / (2 * np.pi * area_radius_m(camera))
        a, b = alpha * np.cos(turn), alpha * np.sin(turn)
        airy = np.stack([camera.K[0, 0] * a + camera.K[0, 1] * b, camera.K[1, 1] * b], axis=-1)
    if softness_m > 0:
        ramp = np.stack([next(columns), next(columns)], axis=-1) - 0.5
    # An aperture with an odd number of corners is not point-symmetric: it is only centred.
    odd = camera.blades % 2 == 1
    lens = lens - lens.mean(axis=0)
    return Nodes(
        np.concatenate([lens, lens if odd else -lens]),
        np.concatenate([time, -time]),
        np.concatenate([airy, -airy]),
        np.concatenate([ramp, -ramp]),
    )
