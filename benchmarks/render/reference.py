"""The benchmark's scene as plain numbers, and the error measures of an image of it.

The measures are independent of all renderers: the coverage of a pixel by the disc's conic is integrated here.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic
from roundel.scenes.study.study import load_study
from roundel.scenes.world.frame import Frame, frame_of

Array = NDArray[np.float64]

HERE = Path(__file__).resolve().parent
STUDY = HERE / "bench.yaml"

# Coverage range of an edge pixel, which the contour visibly cuts.
EDGE = (0.02, 0.98)
# Lines per pixel, each with an exact chord: coverage is accurate to about 1e-5.
_LINES = 64
# Half the side of the window rendered for tuning: the disc (radius 39 px) and the sheet around it.
_WINDOW_PX = 64


def bench_frame(index: int = 0) -> Frame:
    return frame_of(load_study(STUDY), index)


def scene_numbers(frame: Frame) -> dict[str, Any]:
    """Everything a renderer needs, for JSON: metres, pixels, radiance; the world is the camera frame."""
    sheet, light = frame.sheet, frame.settings.light
    (disc,) = sheet.shapes
    return {
        "width_px": frame.camera.width_px,
        "height_px": frame.camera.height_px,
        "focal_px": float(frame.camera.K[0, 0]),
        "cx_px": float(frame.camera.K[0, 2]),
        "cy_px": float(frame.camera.K[1, 2]),
        "camera_from_sheet": frame.camera_from_sheet.tolist(),
        "sheet_low_m": list(sheet.low_m),
        "sheet_high_m": list(sheet.high_m),
        "wall_half_m": 4 * float(np.linalg.norm(frame.camera_from_sheet[:3, 3])),
        "radius_m": disc.radius_m,
        "ink": disc.reflectance,
        "paper": sheet.paper,
        "wall": sheet.wall,
        "environment": light.environment,
        "lamp": {k: getattr(light.lamps[0], k) for k in ("position_m", "size_m", "radiance")},
        "window": list(window_of(frame)),
    }


def window_of(frame: Frame) -> tuple[int, int, int, int]:
    """Columns and rows (x0, y0, x1, y1) of a square around the disc."""
    x, y = np.rint(ellipse_of(frame)[:2]).astype(int)
    return int(x) - _WINDOW_PX, int(y) - _WINDOW_PX, int(x) + _WINDOW_PX, int(y) + _WINDOW_PX


def ellipse_of(frame: Frame) -> Array:
    """Image of the disc: x, y, semi-axes in pixels, angle."""
    return ellipse_of_conic(_conic(frame))


def _conic(frame: Frame) -> Array:
    (part,) = frame.sheet.parts
    assert part.radius_m is not None
    return conic_of_circle(frame.camera_from_part(part), part.radius_m, frame.camera.K)


def coverage_of(frame: Frame, window: tuple[int, int, int, int] | None = None) -> Array:
    """Fraction (H, W) of each pixel inside the disc's conic: exact chords along lines evenly across the pixel."""
    c = _conic(frame)
    height, width = frame.camera.height_px, frame.camera.width_px
    cover = np.zeros((height, width))
    x0, y0, x1, y1 = window or window_of(frame)
    left = np.arange(x0, x1) - 0.5
    for row in range(y0, y1):
        y = row - 0.5 + (np.arange(_LINES) + 0.5) / _LINES
        # c00 x^2 + 2 (c01 y + c02) x + (c11 y^2 + 2 c12 y + c22) = 0
        q1, q0 = c[0, 1] * y + c[0, 2], c[1, 1] * y * y + 2 * c[1, 2] * y + c[2, 2]
        root = np.sqrt(np.maximum(q1 * q1 - c[0, 0] * q0, 0)) / abs(c[0, 0])
        low, high = -q1 / c[0, 0] - root, -q1 / c[0, 0] + root
        chord = np.clip(high[:, None] - left, 0, 1) - np.clip(low[:, None] - left, 0, 1)
        cover[row, x0:x1] = chord.mean(axis=0)
    return cover


@dataclass(frozen=True)
class Measures:
    """Measures from the images of two seeds.

    `edge_theory`: RMS residual of edge pixels against theory; `edge_scatter`: standard deviation between the seeds over
    sqrt 2, on the same pixels; both fractions of the contrast. `noise`: standard deviation between the seeds over
    sqrt 2 of smooth pixels of sheet and wall, relative to the local radiance. `paper`, `wall`: mean radiance there.
    """

    edge_theory: float
    edge_scatter: float
    noise_sheet: float
    noise_wall: float
    paper: float
    wall: float
    edge_pixels: int

    @property
    def edge(self) -> float:
        return max(self.edge_theory, self.edge_scatter)

    @property
    def noise(self) -> float:
        return max(self.noise_sheet, self.noise_wall)


def measure(frame: Frame, one: Array, other: Array) -> Measures:
    """Compare two images (H, W) of different seeds with theory and with each other; NaN where nothing was rendered."""
    cover = coverage_of(frame)
    edge = (cover > EDGE[0]) & (cover < EDGE[1])
    ink, paper = scene_numbers(frame)["ink"], frame.sheet.paper
    # Smooth light is a quadratic over the disc's neighbourhood: only this is fitted.
    x0, y0, x1, y1 = window_of(frame)
    sheet = np.zeros_like(edge)
    sheet[y0:y1, x0:x1] = on_sheet(frame, x0, y0, x1, y1)
    rows, columns = np.nonzero(sheet)
    u, v = (columns - columns.mean()) / 50, (rows - rows.mean()) / 50
    light = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=1)
    theory = paper + (ink - paper) * cover[rows, columns]
    observed = np.mean([one[rows, columns], other[rows, columns]], axis=0)
    solution, *_ = np.linalg.lstsq(light * theory[:, None], observed, rcond=None)
    lit = light @ solution
    at_edge = edge[rows, columns]
    contrast = float(np.abs(lit[at_edge] * (ink - paper)).mean())
    left = [image[rows, columns][at_edge] - (lit * theory)[at_edge] for image in (one, other)]
    smooth = sheet & (cover == 0)
    wall = _wall(frame)
    return Measures(
        edge_theory=float(np.sqrt(np.mean(np.square(left)))) / contrast,
        edge_scatter=float(np.sqrt(np.mean(np.square(left[0] - left[1])) / 2)) / contrast,
        noise_sheet=_noise(one, other, smooth),
        noise_wall=_noise(one, other, wall),
        paper=float(np.nanmean(one[smooth])),
        wall=float(np.nanmean(one[wall])) if np.isfinite(one[wall]).any() else float("nan"),
        edge_pixels=int(edge.sum()),
    )


def _noise(one: Array, other: Array, where: NDArray[np.bool_]) -> float:
    a, b = one[where], other[where]
    good = np.isfinite(a) & np.isfinite(b)
    if not good.any():
        return float("nan")
    a, b = a[good], b[good]
    return float(np.sqrt(np.mean(np.square((a - b) / ((a + b) / 2))) / 2))


def _plane_xy(frame: Frame, x: Array, y: Array) -> tuple[Array, Array]:
    """Intersections of the pixels' lines of sight with the sheet's plane, in its own coordinates."""
    k, pose = frame.camera.K, frame.camera_from_sheet
    homography = np.linalg.inv(k @ pose[:3][:, [0, 1, 3]])
    h = np.stack([x, y, np.ones_like(x)], axis=-1) @ homography.T
    return h[..., 0] / h[..., 2], h[..., 1] / h[..., 2]


def _inside_sheet(frame: Frame, x: Array, y: Array, margin_m: float) -> NDArray[np.bool_]:
    px, py = _plane_xy(frame, x, y)
    (x0, y0), (x1, y1) = frame.sheet.low_m, frame.sheet.high_m
    m = margin_m
    return np.asarray((px > x0 + m) & (px < x1 - m) & (py > y0 + m) & (py < y1 - m), dtype=bool)


def on_sheet(frame: Frame, x0: int, y0: int, x1: int, y1: int) -> NDArray[np.bool_]:
    """Pixels of a window that are entirely on the sheet (3 mm is three pixels)."""
    x, y = np.meshgrid(np.arange(x0, x1, dtype=np.float64), np.arange(y0, y1, dtype=np.float64))
    return _inside_sheet(frame, x, y, 0.003)


def _wall(frame: Frame) -> NDArray[np.bool_]:
    """Pixels entirely on the wall."""
    x, y = np.meshgrid(np.arange(frame.camera.width_px, dtype=float), np.arange(frame.camera.height_px, dtype=float))
    return ~_inside_sheet(frame, x, y, -0.003)
