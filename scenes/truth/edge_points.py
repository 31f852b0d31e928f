"""Points mode: noisy points on the true contour, the paper's experiment without images (its section V)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import distort_px, project
from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic, ellipse_perimeter_px, ellipse_points
from roundel.scenes.geometry.pose import transform_points
from roundel.scenes.markers.marker import Part
from roundel.scenes.world.frame import Frame
from roundel.scenes.world.placement import part_outline

# Number of chords of the arc-length table: its error is below 1e-5 of the perimeter.
_TABLE = 4096


def _evenly_on_polygon(vertices: NDArray[np.float64], count: int | None, random: float) -> NDArray[np.float64]:
    """Points evenly spaced along a closed polygon (n, 2), one a pixel unless counted; `random` in [0, 1) of a step."""
    closed = np.concatenate([vertices, vertices[:1]])
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    count = max(round(float(length[-1])) if count is None else count, 6)
    at = (np.arange(count) + random) / count * length[-1]
    return np.stack([np.interp(at, length, closed[:, i]) for i in (0, 1)], axis=-1)


def _evenly_spaced(ellipse: NDArray[np.float64], count: int, phase: float) -> NDArray[np.float64]:
    """`count` points evenly spaced along the ellipse, like the pixels of a contour; `phase` in [0, 1) of a step."""
    table = ellipse_points(ellipse, _TABLE)
    closed = np.concatenate([table, table[:1]])
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at = (np.arange(count) + phase) / count * length[-1]
    t = np.interp(at, length, np.arange(_TABLE + 1)) * (2 * np.pi / _TABLE)
    angle = np.radians(ellipse[4])
    along, across = ellipse[2] * np.cos(t), ellipse[3] * np.sin(t)
    x = ellipse[0] + along * np.cos(angle) - across * np.sin(angle)
    y = ellipse[1] + along * np.sin(angle) + across * np.cos(angle)
    return np.stack([x, y], axis=-1)


def edge_points_of(frame: Frame, part: Part) -> NDArray[np.float64]:
    """Noisy edge points (N, 2) of one circle, in image pixels.

    N is the perimeter in pixels or the study's count; the noise is isotropic, Gaussian, `sigma_px` per coordinate.
    """
    assert part.radius_m is not None
    settings = frame.settings.points
    generator = np.random.Generator(np.random.PCG64([frame.noise_seed, part.marker_id]))
    if frame.sheet.curve is not None:
        outline = transform_points(frame.camera_from_sheet, part_outline(frame.sheet, part, _TABLE))
        counted = None if settings.count == "perimeter" else int(settings.count)
        straight = project(replace(frame.camera, distortion=(), distortion_model="opencv"), outline)
        points = distort_px(frame.camera, _evenly_on_polygon(straight, counted, float(generator.random())))
        return points + generator.normal(0.0, settings.sigma_px, points.shape)
    ellipse = ellipse_of_conic(conic_of_circle(frame.camera_from_part(part), part.radius_m, frame.camera.K))
    count = round(float(ellipse_perimeter_px(ellipse))) if settings.count == "perimeter" else int(settings.count)
    points = distort_px(frame.camera, _evenly_spaced(ellipse, max(count, 6), float(generator.random())))
    return points + generator.normal(0.0, settings.sigma_px, points.shape)
