"""Objects of everyday size: boxes, books, bottles, cups, cans, balls, tools and cables, each drawn from a generator."""

from __future__ import annotations

import colorsys
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.surroundings.bodies import Body, Colour, Material, frame_on, pose_from_axes

Array = NDArray[np.float64]

# Stands on the plane through `foot` with normal `up`, turned about it by an angle.
Maker = Callable[[np.random.Generator, Array, Array], Body]


def standing(
    shape: str, half: Array, foot: Array, up: Array, turn_rad: float, material: Material, profile: Array | None = None
) -> Body:
    """A body that stands on `foot`, its own Z along `up`."""
    x, y = frame_on(up, turn_rad)
    return Body(shape, pose_from_axes(x, y, up, foot + half[2] * up), half, material, profile)


def paint(rng: np.random.Generator, saturation: float = 0.7) -> Colour:
    """A colour as painted or printed things have it, linear."""
    hue, sat, value = rng.uniform(), rng.uniform(0.1, saturation), rng.uniform(0.25, 0.9)
    r, g, b = (c**2.2 for c in colorsys.hsv_to_rgb(hue, sat, value))
    return (r, g, b)


def _turn(rng: np.random.Generator) -> float:
    return float(rng.uniform(0.0, 2 * np.pi))


def box(rng: np.random.Generator, foot: Array, up: Array) -> Body:
    """A cardboard or painted box."""
    half = rng.uniform([0.03, 0.03, 0.02], [0.12, 0.1, 0.11])
    kind = "cardboard" if rng.uniform() < 0.5 else "plastic"
    colour = (0.42, 0.28, 0.16) if kind == "cardboard" else paint(rng)
    return standing("box", half, foot, up, _turn(rng), Material(kind, colour, 0.25, int(rng.integers(8))))


def book(rng: np.random.Generator, foot: Array, up: Array) -> Body:
    """A book that lies flat."""
    half = rng.uniform([0.055, 0.08, 0.006], [0.09, 0.13, 0.022])
    return standing("box", half, foot, up, _turn(rng), Material("plastic", paint(rng), 0.35))


def bottle(rng: np.random.Generator, foot: Array, up: Array) -> Body:
    """A bottle, as a solid of revolution."""
    radius, height = rng.uniform(0.028, 0.042), rng.uniform(0.18, 0.3)
    neck = radius * rng.uniform(0.3, 0.42)
    # A shoulder in many small steps: normals that differ much from their faces would leave black rims.
    ease = np.linspace(0.0, 1.0, 25)
    shoulder = neck + (radius - neck) * (1 + np.cos(np.pi * ease)) / 2
    body = [[0.0, 0.0], [0.92 * radius, 0.0], [radius, 0.02 * height]]
    profile = np.vstack(
        [body, np.column_stack([shoulder, (0.55 + 0.29 * ease) * height]), [[neck, height], [0.0, height]]]
    )
    profile[:, 1] -= height / 2
    kind = "glass" if rng.uniform() < 0.35 else "plastic"
    colour = (0.9, 0.95, 0.9) if kind == "glass" else paint(rng)
    if kind == "glass":
        profile = profile[1:-1]  # without its ends: a path has too few steps left to pass four panes
    material = Material(kind, colour, 0.1)
    return standing("lathe", np.array([radius, radius, height / 2]), foot, up, 0.0, material, profile=profile)


def cup(rng: np.random.Generator, foot: Array, up: Array) -> Body:
    """A cup without a handle, open at the top."""
    radius, height, wall = rng.uniform(0.035, 0.05), rng.uniform(0.08, 0.12), 0.004
    low = radius * rng.uniform(0.7, 1.0)
    profile = np.array(
        [[0.0, 0.0], [low, 0.0], [radius, height], [radius - wall, height], [low - wall, wall], [0.0, wall]]
    )
    profile[:, 1] -= height / 2
    material = Material("plastic", paint(rng, 0.5), 0.12)
    return standing("lathe", np.array([radius, radius, height / 2]), foot, up, 0.0, material, profile=profile)


def can(rng: np.random.Generator, foot: Array, up: Array) -> Body:
    """A can: a cylinder of painted or bare metal."""
    radius, height = rng.uniform(0.026, 0.05), rng.uniform(0.08, 0.14)
    bare = rng.uniform() < 0.4
    material = Material("metal" if bare else "plastic", (0.75, 0.74, 0.72) if bare else paint(rng), 0.2)
    return standing("cylinder", np.array([radius, radius, height / 2]), foot, up, _turn(rng), material)


def ball(rng: np.random.Generator, foot: Array, up: Array) -> Body:
    """A ball."""
    radius = rng.uniform(0.02, 0.06)
    kind = str(rng.choice(["plastic", "matte", "metal"]))
    colour = (0.8, 0.78, 0.75) if kind == "metal" else paint(rng, 0.9)
    return standing("sphere", np.full(3, radius), foot, up, 0.0, Material(kind, colour, 0.15))


def tool(rng: np.random.Generator, foot: Array, up: Array) -> Body:
    """A shaft or a bar of metal that lies flat."""
    length, radius = rng.uniform(0.05, 0.14), rng.uniform(0.004, 0.012)
    x, y = frame_on(up, _turn(rng))
    material = Material("metal", (0.6, 0.6, 0.62), float(rng.uniform(0.1, 0.3)))
    if rng.uniform() < 0.5:
        pose = pose_from_axes(y, up, x, foot + radius * up)
        return Body("cylinder", pose, np.array([radius, radius, length]), material)
    return Body("box", pose_from_axes(x, y, up, foot + radius * up), np.array([length, 2.5 * radius, radius]), material)


def cable(rng: np.random.Generator, foot: Array, up: Array) -> Body:
    """A cable that lies in curves."""
    radius, t = rng.uniform(0.002, 0.004), np.linspace(0.0, 1.0, 60)
    a, b, phase = rng.uniform(0.04, 0.1), rng.uniform(0.02, 0.06), _turn(rng)
    path = np.column_stack(
        [0.3 * (t - 0.5) + 0.3 * a * np.sin(5 * t + phase), a * np.sin(7 * t) + b * np.cos(11 * t + phase), 0 * t]
    )
    path -= (path.max(axis=0) + path.min(axis=0)) / 2
    half = np.maximum(np.abs(path).max(axis=0), 0) + radius
    material = Material("plastic", (0.03, 0.03, 0.035) if rng.uniform() < 0.6 else paint(rng), 0.3)
    x, y = frame_on(up, _turn(rng))
    return Body("tube", pose_from_axes(x, y, up, foot + radius * up), half, material, path=path, radius_m=radius)


HOUSEHOLD: tuple[Maker, ...] = (box, book, bottle, cup, can, ball)
WORKSHOP: tuple[Maker, ...] = (box, can, tool, tool, cable, ball)
STREET: tuple[Maker, ...] = (box, can, bottle, ball)
