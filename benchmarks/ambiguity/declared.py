"""Prior knowledge as a user would declare it of one circle whose true pose is known, for `ambiguity.py`.

What is declared is true in the sense of its own standard deviation. Tilt and azimuth of the study are symmetric about
the line of sight, so both poses of a circle are equally likely beforehand, and a probability of 0.8 should be right in
eight of ten cases:

- a *direction* (a known normal, gravity under a floor) is drawn about the true normal with the declared density;
- the gravity of a wall is drawn about the plane perpendicular to the true normal;
- without gravity, `floor`, `ceiling` and `wall` speak of the camera's own axes, which the frame fixes. A frame is then
  used with a probability proportional to the declared density at its true normal, and left out otherwise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from observed import Circle

from roundel.scenes.geometry.pose import minimal_rotation
from roundel.solver.ambiguity.concentric_circle import ConcentricCircle
from roundel.solver.ambiguity.disambiguation import Knowledge
from roundel.solver.ambiguity.normal_prior import NormalPrior, on_ceiling, on_floor, on_wall
from roundel.solver.ambiguity.pattern_cue import orientation_tick
from roundel.solver.theory.propositions import depth_product, plane_view, sufficient_conditions

Array = NDArray[np.float64]

PLAIN = ("disc", "dot", "ring")  # groups whose outer circle stands alone: enough for what says nothing of the print


@dataclass(frozen=True)
class Kind:
    """A kind of prior knowledge.

    Attributes
    ----------
    name : str
        As in `--knowledge`, where it has a word.
    groups : tuple of str
        Groups of the study that it is declared of.
    declare : callable
        Takes a circle and a generator; returns the knowledge, or None if it cannot be declared of that circle.
    """

    name: str
    groups: tuple[str, ...]
    declare: Callable[[Circle, Generator], Knowledge]


def about(generator: Generator, mean: Array, spread_deg: float) -> Array:
    """A direction with the density exp(-theta^2 / (2 spread^2)) over the sphere."""
    while True:
        step = np.radians(spread_deg) * generator.standard_normal(2)
        theta = float(np.hypot(*step))
        # The tangent plane's area shrinks by sin(theta) / theta on the sphere.
        if theta < np.pi and generator.uniform() < np.sinc(theta / np.pi):
            local = np.array([*(np.sinc(theta / np.pi) * step), np.cos(theta)])
            return np.asarray(minimal_rotation([0.0, 0.0, 1.0], mean) @ local)


def across(generator: Generator, normal: Array, spread_deg: float) -> Array:
    """A direction whose angle to the plane perpendicular to `normal` is normally distributed over the sphere."""
    while True:
        up = np.radians(spread_deg) * generator.standard_normal()
        if abs(up) < np.pi / 2 and generator.uniform() < np.cos(up):
            break
    turn = generator.uniform(-np.pi, np.pi)
    local = np.array([np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), np.sin(up)])
    return np.asarray(minimal_rotation([0.0, 0.0, 1.0], normal) @ local)


def _side(circle: Circle) -> str:
    return "same_side" if float(depth_product(circle.camera_from_marker, circle.radius_m)) >= 0 else "opposite_side"


def _sufficient(circle: Circle, _: Generator) -> Knowledge:
    if circle.normal[2] >= 0:  # the optical axis does not meet the plane in front of the camera
        return None
    first, second = sufficient_conditions(plane_view(circle.camera_from_marker, circle.radius_m))
    return "same_side" if bool(first & second) else None


def _upright(kind: str, spread_deg: float) -> Callable[[Circle, Generator], Knowledge]:
    """A word without gravity, of frames that are as likely as it says."""
    place = {"floor": on_floor, "ceiling": on_ceiling, "wall": on_wall}[kind]

    def declare(circle: Circle, generator: Generator) -> Knowledge:
        n = circle.normal
        along = n[1] if kind == "wall" else n[0]
        density = np.exp(-0.5 * (np.arcsin(along) / np.radians(spread_deg)) ** 2)
        right_way = kind == "wall" or (n[1] < 0) == (kind == "floor")
        return place(None, spread_deg) if right_way and generator.uniform() < density else None

    return declare


def _normal(spread_deg: float) -> Callable[[Circle, Generator], Knowledge]:
    return lambda circle, g: NormalPrior(about(g, circle.normal, spread_deg), spread_deg)


def _tick(circle: Circle, _: Generator) -> Knowledge:
    # A third of a second each: with the true camera every second frame.
    return orientation_tick() if circle.intrinsics == "default" or circle.frame_id % 2 == 0 else None


KINDS = (
    Kind("none", PLAIN, lambda circle, g: ()),
    Kind("same_side / opposite_side", PLAIN, lambda circle, g: _side(circle)),
    Kind("same_side, where (i) and (ii) hold", PLAIN, _sufficient),
    Kind("same_side, of every circle", PLAIN, lambda circle, g: "same_side"),
    Kind("normal, 10 deg", PLAIN, _normal(10.0)),
    Kind("normal, 30 deg", PLAIN, _normal(30.0)),
    Kind("floor with gravity, 10 deg", PLAIN, lambda circle, g: on_floor(-about(g, circle.normal, 10.0), 10.0)),
    Kind("wall with gravity, 10 deg", PLAIN, lambda circle, g: on_wall(across(g, circle.normal, 10.0), 10.0)),
    Kind("floor, upright camera, 10 deg", PLAIN, _upright("floor", 10.0)),
    Kind("ceiling, upright camera, 10 deg", PLAIN, _upright("ceiling", 10.0)),
    Kind("wall, level camera, 10 deg", PLAIN, _upright("wall", 10.0)),
    Kind(
        "normal, 30 deg + same_side / opposite_side",
        PLAIN,
        lambda circle, g: (NormalPrior(about(g, circle.normal, 30.0), 30.0), _side(circle)),
    ),
    Kind("circle:0.25 (a dot)", ("dot",), lambda circle, g: ConcentricCircle(0.25)),
    Kind("circle:0.5 (a ring)", ("ring",), lambda circle, g: ConcentricCircle(0.5)),
    Kind("tick", ("tick",), _tick),
)

# Declared although it is not true of every circle: what always choosing candidate 0 amounts to.
FALSE = ("same_side, of every circle",)
