"""A known print inside the circle as a cue: predicted with both poses, over all in-plane rotations.

Source of the idea: A. Pagani et al., Circular markers for camera pose estimation, WIAMIS (2011): rectify with both
poses and keep the one nearer to the expected pattern. Here the print is predicted at the pixels instead of resampling
the pixels, and the likelihood is that of the pixels with the uncertain parameters marginalised: ellipse, focal length,
principal point, in-plane rotation, blur, grey levels and a gradient of the light. Inside the circle both poses differ
by a fraction of a pixel, so without marginalisation unrelated residuals would decide.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.markers.marker import Bar, Disc
from roundel.solver.ambiguity.observation import MISTAKES, Observation, Verdict
from roundel.solver.ambiguity.pattern_prediction import PredictedPrint, region_inside
from roundel.solver.ambiguity.viewing_cone import viewing_cone

Array = NDArray[np.float64]

# Limit set by the accuracy of a print's model: of 560 rendered ticks stated with more than 99 %, five were wrong.
_SURE = math.log(100.0)


@dataclass(frozen=True, eq=False)
class Pattern:
    """The print inside the outer circle.

    Attributes
    ----------
    texture : (n, n) array
        Reflectance over the bounding square of the outer circle: rows from the top (Y = +1 radius) down, columns from
        X = -1 radius to the right; the marker frame has X right, Y up.
    name : str
    """

    texture: Array
    name: str = "known pattern"

    def problem(self) -> str:
        """What is invalid about it; empty if it is valid."""
        t = np.asarray(self.texture)
        if t.ndim != 2 or t.shape[0] != t.shape[1] or t.shape[0] < 8 or not np.all(np.isfinite(t)):
            return "a pattern is a square array of at least 8 by 8 finite reflectances"
        return "" if np.ptp(t) > 0 else "a pattern of one shade carries no information"

    def verdict(self, observation: Observation) -> Verdict:
        """Likelihood of the pixels inside the outer contour under both poses."""
        cone = viewing_cone(observation)
        if cone is None or observation.image is None:
            return Verdict(0.0, f"{self.name}: not evaluated, because there is no image, ellipse or camera")
        region = region_inside(observation)
        if region is None:
            return Verdict(0.0, f"{self.name}: too few pixels inside the circle")
        print_ = PredictedPrint(np.asarray(self.texture, dtype=np.float64), cone, region, observation.blur_px)
        value, light = region.weight * region.value, region.weight[:, None] * print_.light
        plain = value - light @ np.linalg.lstsq(light, value, rcond=None)[0]
        fits = [print_.fit(i) for i in range(2)]
        noise2 = max(min(fit.left for fit in fits) / max(len(value) - 12, 1), 1.0 / 12.0)
        total = float(plain @ plain)
        seen = 1.0 - min(fit.left for fit in fits) / max(total, 1e-12)
        if seen < 0.5:
            return Verdict(
                0.0, f"{self.name}: not found, it explains {100 * max(seen, 0.0):.0f} % of the pixels' variance"
            )
        # With probability 1 % something else is printed there: then the pixels are as likely as without the pattern.
        other = math.log(MISTAKES) - 0.5 * total / noise2
        log = [float(np.logaddexp(math.log1p(-MISTAKES) + fit.log_likelihood(noise2), other)) for fit in fits]
        odds = max(-_SURE, min(_SURE, log[0] - log[1]))
        rms = [math.sqrt(fit.left / len(value)) for fit in fits]
        return Verdict(odds, f"{self.name}: its residuals under both poses are {rms[0]:.3g} and {rms[1]:.3g} DN")


def pattern_of(
    reflectance: Callable[[Array, Array], ArrayLike], name: str = "known pattern", size: int = 256
) -> Pattern:
    """A pattern from a function of marker coordinates.

    Parameters
    ----------
    reflectance : callable
        Takes X and Y (arrays, in outer radii; X right, Y up), returns reflectances of the same shape.
    name : str
    size : int
        Cells per side; each is the mean of 34 points.
    """
    # A Fibonacci lattice resolves edges to a 34th of a cell, also along the axes.
    total = np.zeros((size, size))
    for i in range(34):
        at = np.arange(size) * (2.0 / size) - 1.0
        x, y = np.meshgrid(at + (i + 0.5) / 34 * (2.0 / size), -at - ((21 * i) % 34 + 0.5) / 34 * (2.0 / size))
        total += np.asarray(reflectance(x, y), dtype=np.float64)
    return Pattern(total / 34, name)


def pattern_of_shapes(
    shapes: Sequence[Disc | Bar], radius_m: float, paper: float, name: str = "known pattern"
) -> Pattern:
    """A pattern from the discs and bars of a marker, painted in order (see `scenes.marker`)."""

    def reflectance(x: Array, y: Array) -> Array:
        out = np.full_like(x, paper)
        for shape in shapes:
            dx, dy = x * radius_m - shape.x_m, y * radius_m - shape.y_m
            if isinstance(shape, Disc):
                inside = np.hypot(dx, dy) < shape.radius_m
            else:
                c, s = math.cos(math.radians(shape.turn_deg)), math.sin(math.radians(shape.turn_deg))
                inside = (np.abs(c * dx + s * dy) < shape.length_m / 2) & (np.abs(c * dy - s * dx) < shape.width_m / 2)
            out[inside] = shape.reflectance
        return out

    return pattern_of(reflectance, name)


def orientation_tick(from_radii: float = 0.5, to_radii: float = 0.9, width_radii: float = 0.12) -> Pattern:
    """A bar of paper along +X in a disc of ink, as `roundel` prints it on the marker `disc_with_tick`.

    Its edges are exact fractions of cells, and the cells a fortieth of a pixel on a marker of 13 px: against noise of
    1 DN coarser ones are seen.
    """
    size = 1024
    edges = np.linspace(-1.0, 1.0, size + 1)

    def covered(low: float, high: float) -> Array:
        """Fraction of each cell between two coordinates."""
        inside = np.clip(edges, low, high)
        return np.diff(inside) * (size / 2.0)

    along, across = covered(from_radii, to_radii), covered(-width_radii / 2, width_radii / 2)
    return Pattern(np.outer(across[::-1], along), "orientation tick")
