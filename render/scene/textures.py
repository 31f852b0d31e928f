"""Procedural textures at real scale: wood, cardboard, plaster, brick, concrete and fabric, as arrays of reflectance."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]

SIDE_PX = 512
_side: ContextVar[int] = ContextVar("side", default=SIDE_PX)
# Extent of one tile in metres: the scale at which the pattern looks right.
TILE_M = {"wood": 0.6, "cardboard": 0.25, "plaster": 0.9, "brick": 1.0, "concrete": 1.2, "fabric": 0.06}


def _noise(rng: np.random.Generator, side: int, octaves: int, first: int, stretch: int = 1) -> Array:
    """Periodic value noise of mean 0 and standard deviation 1, its cells longer along x by `stretch`."""
    total = np.zeros((side, side))
    row, column = np.mgrid[0:side, 0:side] / side
    for octave in range(octaves):
        rows, columns = first * 2**octave, max(first * 2**octave // stretch, 1)
        grid = rng.standard_normal((rows, columns))
        total += map_coordinates(grid, [row * rows, column * columns], order=3, mode="grid-wrap") / 2**octave
    return np.asarray((total - total.mean()) / total.std())


def _wood(rng: np.random.Generator, side: int) -> Array:
    grain = _noise(rng, side, 4, 24, 16)
    warp = _noise(rng, side, 2, 3, 4)
    row = np.mgrid[0:side, 0:side][0] / side
    rings = np.sin(2 * np.pi * (9 * row + 0.35 * warp))
    return np.asarray(1 + 0.13 * rings + 0.09 * grain)


def _cardboard(rng: np.random.Generator, side: int) -> Array:
    fluting = np.sin(2 * np.pi * 60 * np.mgrid[0:side, 0:side][1] / side)
    return np.asarray(1 + 0.02 * fluting + 0.05 * _noise(rng, side, 5, 16))


def _plaster(rng: np.random.Generator, side: int) -> Array:
    return 1 + 0.025 * _noise(rng, side, 5, 6) + 0.02 * _noise(rng, side, 2, 100)


def _concrete(rng: np.random.Generator, side: int) -> Array:
    pores = gaussian_filter((rng.uniform(size=(side, side)) > 0.996).astype(float), 1.0, mode="wrap")
    return np.asarray(1 + 0.1 * _noise(rng, side, 5, 4) + 0.05 * _noise(rng, side, 2, 90) - 1.5 * pores)


def _fabric(rng: np.random.Generator, side: int) -> Array:
    row, column = np.mgrid[0:side, 0:side] / side
    weave = np.sin(2 * np.pi * 32 * row) * np.sin(2 * np.pi * 32 * column)
    return np.asarray(1 + 0.2 * weave + 0.06 * _noise(rng, side, 4, 16))


_GREY = {"wood": _wood, "cardboard": _cardboard, "plaster": _plaster, "concrete": _concrete, "fabric": _fabric}


def _brick(rng: np.random.Generator, side: int, colour: Array) -> Array:
    """Courses of 12.5 cm by 25 cm, every other one shifted by half, in grey mortar."""
    rows, columns = 12, 4
    row, column = np.mgrid[0:side, 0:side] / side
    course = np.floor(row * rows).astype(int)
    along = column * columns + 0.5 * (course % 2)
    brick = np.floor(along).astype(int) % columns
    edge = np.minimum((row * rows) % 1, 1 - (row * rows) % 1) / rows, np.minimum(along % 1, 1 - along % 1) / columns
    mortar = gaussian_filter((np.minimum(*edge) < 0.006).astype(float), 1.2, mode="wrap")[..., None]
    tone = rng.normal(1.0, 0.16, (rows, columns, 1)) * rng.normal(1.0, 0.04, (rows, columns, 3))
    surface = 1 + 0.12 * _noise(rng, side, 4, 32)[..., None]
    return np.asarray((1 - mortar) * colour * tone[course % rows, brick] * surface + mortar * 0.42 * surface)


@contextmanager
def coarse_textures(side_px: int) -> Iterator[None]:
    """Tiles of so many pixels a side instead of `SIDE_PX`: the same patterns, for pictures that are only looked at."""
    token = _side.set(side_px)
    try:
        yield
    finally:
        _side.reset(token)


def texture(kind: str, colour: tuple[float, float, float], seed: int) -> Array32:
    """A tile (512, 512, 3) of linear reflectance that repeats without a seam; smaller within `coarse_textures`.

    Parameters
    ----------
    kind : str
        One of `TILE_M`.
    colour : (r, g, b)
        Its mean, linear.
    seed : int
    """
    return _tile(kind, colour, seed, _side.get())


@lru_cache(maxsize=64)
def _tile(kind: str, colour: tuple[float, float, float], seed: int, side: int) -> Array32:
    rng = np.random.default_rng([seed, len(kind), ord(kind[0])])
    base = np.asarray(colour, dtype=np.float64)
    # What is darker is more saturated, as in wood and stone.
    hues = np.array([0.9, 1.0, 1.15])
    found = _brick(rng, side, base) if kind == "brick" else base * _GREY[kind](rng, side)[..., None] ** hues
    return np.asarray(np.clip(found, 0.01, 0.95), dtype=np.float32)
