"""What the truth says of each marker's edge: levels, noise, and what else limits the information of its pixels.

Levels are mean electrons without clipping, and the noise is that of the delivered file, referred to them. A colour
image counts as its mosaic, each pixel one sample through its own filter at the mean level of the three, and what
interpolation leaves at the edge counts as noise (`mosaic_noise`). Rows of a rolling shutter are those of the
undistorted image. Not included: an image signal processor, light that varies along the edge, and the shape of a soft
edge beyond its variance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from roundel.datasets.dataset import Dataset
from roundel.scenes.camera.model import Camera
from roundel.scenes.camera.motion import exp_twist
from roundel.scenes.camera.row_time import RowTime
from roundel.scenes.geometry.conic import circle_points_m
from roundel.scenes.geometry.edge_spread_function import PIXEL_VARIANCE
from roundel.scenes.geometry.information import shape_of_pose
from roundel.scenes.geometry.pixel_information import EdgeConditions
from roundel.validate.metrics.ground_truth import Targets, columns_of
from roundel.validate.metrics.jpeg_noise import luma_table
from roundel.validate.metrics.level_noise import level_variance, saturation_e

Array = NDArray[np.float64]

_LEVELS = ("edge_inside_e", "edge_outside_e", "edge_blur_px", "edge_softness_m")
_ROOT_12 = math.sqrt(12.0)  # a ramp of full width w has the standard deviation w / sqrt(12)
# Seconds of a twist whose central difference is its rate: for 1 m/s and 1 rad/s beyond 0.1 m, exact to 1e-8.
_TINY_S = 1e-5


@dataclass(frozen=True, eq=False)
class Edge:
    """One marker's edge: levels inside and outside, noise at both, blur without the pixel, and the conditions."""

    inside: float
    outside: float
    noise: tuple[float, float]
    blur_px: float
    conditions: EdgeConditions


def edges_of(dataset: Dataset, targets: Targets) -> list[Edge | None]:
    """The edge of every target; None if the truth has no electrons, as in points mode and in older datasets."""
    if not set(_LEVELS) <= set(targets.truth.column_names):
        return [None] * len(targets)
    values = columns_of(targets.truth, list(_LEVELS))
    position = {frame_id: i for i, frame_id in enumerate(dataset.images.frame_ids)}
    visible = _contours_seen(targets)
    edges: list[Edge | None] = []
    for i, row in enumerate(values):
        frame = position[int(targets.frame_id[i])]
        record = dataset.images.records[frame]
        sensor = record.get("sensor")
        # An image processor may do anything to noise and levels: its frames have the older, simpler bound.
        if sensor is None or "isp" in sensor or not np.isfinite([*row, *targets.ellipse[i]]).all():
            edges.append(None)
            continue
        inside, outside, blur, softness = row.tolist()
        ink = softness / _ROOT_12 / (targets.diameter_m[i] / 2)
        table = luma_table(dataset.images.image_bytes(frame)) if dataset.images.is_jpeg(frame) else None
        variance = level_variance(sensor, (inside, outside), math.hypot(blur, ink * targets.ellipse[i, 2]), table)
        noise = np.sqrt(variance(np.array([inside, outside]))).tolist()
        given = EdgeConditions(saturation_e(sensor), variance, ink, visible[i])
        camera, row_time = targets.cameras[targets.camera[i]], dataset.images.row_time(frame)
        if row_time is not None and row_time.moves:
            pose, radius = targets.camera_from_marker[i], targets.diameter_m[i] / 2
            given = with_shutter(given, row_time, pose, float(radius), camera)
        lens = math.sqrt(max(blur**2 - PIXEL_VARIANCE, 0.0))
        edges.append(Edge(inside, outside, (noise[0], noise[1]), lens, given))
    return edges


def with_shutter(
    conditions: EdgeConditions, row_time: RowTime, camera_from_marker: Array, radius_m: float, camera: Camera
) -> EdgeConditions:
    """Conditions of a moving camera: the smear by its exposure is unknown, and so is its motion during the readout.

    The contour at time t is that of the shape plus t times its rate, to first order in t; six components of the
    camera's twist have each their prior.
    """
    if row_time.readout_s == 0:
        return replace(conditions, smeared=True)
    rates = []
    for twist in np.diag(row_time.twist_sigma):
        ends = [
            shape_of_pose(exp_twist(twist, -sign * _TINY_S) @ camera_from_marker, radius_m, camera.K)
            for sign in (1.0, -1.0)
        ]
        rates.append((ends[0] - ends[1]) / (2 * _TINY_S))
    centre = camera.K @ camera_from_marker[:3, 3]
    return replace(
        conditions,
        smeared=True,
        drift=np.stack(rates, axis=-1) * row_time.row_s(camera.width_px, camera.height_px),
        readout=np.array([1.0, 0.0] if row_time.along_x else [0.0, 1.0]),
        reference_px=centre[:2] / centre[2],
    )


def _contours_seen(targets: Targets) -> list[tuple[Array, NDArray[np.bool_]] | None]:
    """Points of each undistorted contour and which of them are seen; None where all are, or nothing says so."""
    nothing: list[tuple[Array, NDArray[np.bool_]] | None] = [None] * len(targets)
    if "contour_visible" not in targets.truth.column_names:
        return nothing
    for i, seen in enumerate(targets.truth["contour_visible"].to_pylist()):
        if seen is None or all(seen):
            continue
        points = circle_points_m(targets.camera_from_marker[i], targets.diameter_m[i] / 2, len(seen))
        px = points @ targets.cameras[targets.camera[i]].K.T
        nothing[i] = px[:, :2] / px[:, 2:], np.array(seen, dtype=bool)
    return nothing
