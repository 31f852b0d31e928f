"""Depth and what is seen of a marker, against rays cast anew: in float64, without the renderer's rays and scene."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from helpers_studies import small_study
from scipy.ndimage import grey_dilation, grey_erosion

from roundel.render.backend import start, variant_of
from roundel.render.radiance import render_radiance
from roundel.render.scene.meshes import mesh_of
from roundel.render.scene.sheets import WALL_DISTANCES
from roundel.render.scene.transport import is_plain
from roundel.scenes.camera.model import ray_direction
from roundel.scenes.camera.motion import pose_at
from roundel.scenes.geometry.pose import transform_points
from roundel.scenes.markers.surfaces import lifted, strips
from roundel.scenes.world.frame import Frame, frame_of
from roundel.scenes.world.occluders import plates_of
from roundel.scenes.world.placement import border_points

# Triangles at once: with 10,000 rays some 40 MB an array.
_TRIANGLES = 512


@dataclass(frozen=True)
class Cast:
    """What n rays meet: Z of the nearest point of each of s surfaces, metres, inf where a ray misses it.

    Surface 0 is the print; `ink` (n,) says where the first marker's outline holds its point.
    """

    depth_m: np.ndarray
    ink: np.ndarray

    @property
    def nearest_m(self) -> np.ndarray:
        """Z of the first surface (n,), 0 where there is none."""
        first = self.depth_m.min(axis=0)
        return np.where(np.isfinite(first), first, 0.0)

    @property
    def visible(self) -> np.ndarray:
        """Where (n,) the first marker is what is seen."""
        return self.ink & (self.depth_m.argmin(axis=0) == 0) & np.isfinite(self.depth_m[0])


def cast(frame: Frame, px: np.ndarray) -> Cast:
    """Rays of the camera of record through image positions (n, 2), at mid-exposure of their rows."""
    rays = ray_direction(frame.camera, px)
    moved = pose_at(frame.motion, frame.camera_from_sheet, frame.motion.row_time_s(px[:, 1]))
    radius, ink = frame.sheet.parts[0].radius_m, np.zeros(len(px), dtype=bool)
    if frame.sheet.curve is None:
        distance, x, y = _plane(rays, moved)
        low, high = np.array(frame.sheet.low_m), np.array(frame.sheet.high_m)
        if frame.on_wall:
            high = np.full(2, WALL_DISTANCES * np.linalg.norm(frame.camera_from_sheet[:3, 3]))
            low = -high
        inside = (x > low[0]) & (x < high[0]) & (y > low[1]) & (y < high[1])
        found = [np.where(inside, distance, np.inf)]
        ink = np.hypot(x, y) < radius
    else:
        paper, faces = strips(frame.sheet.curve, frame.sheet.low_m, frame.sheet.high_m)
        points = lifted(frame.sheet.curve, paper[:, 0], paper[:, 1])
        found = [_triangles(rays, transform_points(frame.camera_from_sheet, points)[faces])]
        wall = frame.camera_from_sheet.copy()
        wall[:3, 3] += (border_points(frame.sheet)[:, 2].min() - 0.002) * wall[:3, 2]
        found.append(_rectangle(rays, np.broadcast_to(wall, (len(px), 4, 4)), *2 * [np.inf]))
    for plate in plates_of(frame.settings, frame.camera_from_sheet) if frame.surroundings is None else ():
        pose = moved @ plate.sheet_from_plate
        found.append(_rectangle(rays, pose, plate.half_width_m, plate.half_height_m, plate.is_round))
    if frame.surroundings is not None:
        found += _world(frame, rays)
    return Cast(np.stack(found) * rays[:, 2], ink)


def _world(frame: Frame, rays: np.ndarray) -> list[np.ndarray]:
    around = frame.surroundings
    found = []
    for body in around.bodies:
        mesh = mesh_of(body)
        found.append(_triangles(rays, transform_points(body.camera_from_body, mesh.vertices)[mesh.faces]))
    for panel in around.panels:
        pose = np.broadcast_to(panel.camera_from_panel, (len(rays), 4, 4))
        found.append(_rectangle(rays, pose, *panel.half_m))
    # The edge of the paper under the print.
    (x0, y0), (x1, y1) = frame.sheet.low_m, frame.sheet.high_m
    corners = np.array([[x, y, z] for x in (x0, x1) for y in (y0, y1) for z in (0.0, -around.sheet_thickness_m)])
    points = transform_points(frame.camera_from_sheet, corners)
    sides = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6)]
    faces = [face for a, b, c, d in sides for face in ((a, b, c), (a, c, d))]
    return [*found, _triangles(rays, points[np.array(faces)])]


def _plane(rays: np.ndarray, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distance along rays (n, 3) from the camera's centre to planes z = 0 of poses (n, 4, 4), and x, y there."""
    normal, origin = pose[:, :3, 2], pose[:, :3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (origin * normal).sum(axis=1) / (rays * normal).sum(axis=1)
    distance = np.where(distance > 0, distance, np.inf)
    across = np.where(np.isfinite(distance), distance, 0.0)[:, None] * rays - origin
    return distance, (across * pose[:, :3, 0]).sum(axis=1), (across * pose[:, :3, 1]).sum(axis=1)


def _rectangle(rays: np.ndarray, pose: np.ndarray, half_x: float, half_y: float, is_round: bool = False) -> np.ndarray:
    distance, x, y = _plane(rays, pose)
    x, y = x / half_x, y / half_y
    inside = x * x + y * y < 1 if is_round else (abs(x) < 1) & (abs(y) < 1)
    return np.where(inside, distance, np.inf)


def _triangles(rays: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Distance along rays (n, 3) to the nearest of triangles (m, 3, 3), all in the camera frame."""
    nearest = np.full(len(rays), np.inf)
    for some in np.array_split(corners, -(-len(corners) // _TRIANGLES)):
        a, b, c = np.moveaxis(some, 1, 0)
        # A ray from the origin is inside if it is on one side of the planes through the origin and each edge.
        sides = [rays @ np.cross(p, q).T for p, q in ((a, b), (b, c), (c, a))]
        inside = np.all([s >= 0 for s in sides], axis=0) | np.all([s <= 0 for s in sides], axis=0)
        normal = np.cross(b - a, c - a)
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = (a * normal).sum(axis=1) / (rays @ normal.T)
        nearest = np.minimum(nearest, np.where(inside & (distance > 0), distance, np.inf).min(axis=1))
    return nearest


LIGHT = "light: {environment: 0.7, lamps: [{position_m: [-0.3, -0.5, 0.0], size_m: 0.2, radiance: 6}]}"
BAND = "band_samples: 256"
CARD = "{shape: rectangle, x_m: -0.05, y_m: 0.02, z_m: 0.06, width_m: 0.06, height_m: 0.12, turn_deg: 20}"
FINGER = "{shape: disc, x_m: 0.03, y_m: 0.01, z_m: 0.1, width_m: 0.05}"
OCCLUDED = ("light:", f"occluders: [{CARD}, {FINGER}]\nlight:")
FOCAL = "focal_px: 320"
OPENCV = (FOCAL, "focal_px: 320, distortion: [-0.3, 0.1, 0.004, -0.003, 0.02]")
FISHEYE = (FOCAL, "focal_px: 320, distortion_model: fisheye, distortion: [0.05, -0.02, 0.01, 0.0]")
ROLLING = (
    "light:",
    "motion: {exposure_s: 0.0001, readout_s: 0.05, camera: {velocity_m_s: [0.6, 0.2, -0.4], rate_deg_s: [20, 10, 50]},"
    " marker: {velocity_m_s: [0.0, 0.3, 0.1], rate_deg_s: [0, 30, 40]}}\nlight:",
)
LENS = (FOCAL, "focal_px: 320, aperture_mm: 20, focus_m: 0.4")
STEEP = ("tilt_deg: {uniform: [10, 50]}", "tilt_deg: 80")
BENT = ("diameter_m: 0.08}", "diameter_m: 0.08, surface: {shape: cylinder, radius_m: 0.06}}")
TABLE, WORKSHOP = ((LIGHT, f"world: {kind}") for kind in ("tabletop", "workshop"))
FEW = (BAND, "target_error: 0.1, background_error: 0.3")
SMALLER = ("width_px: 160, height_px: 120, focal_px: 320", "width_px: 96, height_px: 72, focal_px: 192")
BARREL = ("focal_px: 192", "focal_px: 192, distortion: [-0.3, 0.1, 0.004, -0.003, 0.02]")


def around(plane: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The least and the largest value of each pixel (H, W) and its eight neighbours."""
    return grey_erosion(plane, size=3, mode="nearest"), grey_dilation(plane, size=3, mode="nearest")


@pytest.mark.parametrize(
    ("edits", "plain"),
    [
        ((), True),
        ((OPENCV, STEEP), True),
        ((OCCLUDED,), False),
        ((OCCLUDED, OPENCV), False),
        ((OCCLUDED, FISHEYE), False),
        ((OCCLUDED, ROLLING), False),
        ((OCCLUDED, LENS), False),
        ((OCCLUDED, BENT), False),
        ((TABLE, FEW, SMALLER), False),
        ((TABLE, FEW, SMALLER, BARREL), False),
        ((WORKSHOP, FEW, SMALLER), False),
    ],
    ids=[
        *("plain", "steep", "occluded", "distorted", "fisheye", "rolling", "lens", "bent"),
        *("tabletop", "tabletop-distorted", "workshop"),
    ],
)
def test_each_pixel_has_the_depth_of_the_surface_at_its_centre(tmp_path: Path, edits, plain: bool) -> None:
    frame = frame_of(small_study(tmp_path, *edits), 1)
    assert is_plain(frame) is plain
    radiance = render_radiance(start(variant_of(frame)), frame)
    height, width = frame.camera.height_px, frame.camera.width_px
    px = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2).astype(float)
    anew = cast(frame, px)
    depth, wanted = radiance.depth_m.astype(float), anew.nearest_m.reshape(height, width)
    # Rounding in float32 along the way.
    off = np.abs(depth - wanted) > 1e-5 * wanted
    low, high = around(wanted)
    edge = high > 1.01 * low
    assert not (off & ~edge).any()
    # A ray within a thousandth of a pixel of an edge may pass it on the other side.
    assert off.sum() <= 2
    # None mixed: what is off is the depth of another surface at that pixel, or nothing where the last one ends.
    there = anew.depth_m[:, off.ravel()]
    others = np.abs(there - depth[off]) < 1e-4 * depth[off]
    assert np.all(others.any(axis=0) | (depth[off] == 0))
    if OCCLUDED in edits:
        hides = (anew.depth_m.argmin(axis=0) > 0).reshape(height, width) & (wanted > 0)
        assert hides.sum() > 300
        # An occluder has its own depth, nearer than the print that it hides.
        assert np.all(depth[hides & ~off] < anew.depth_m[0].reshape(height, width)[hides & ~off])
    if LENS in edits or BENT in edits:
        return
    # The marker's mask, half of the pixel or more, is what the ray at its centre sees, but for pixels of its outline.
    mask, visible = radiance.coverage[0] >= 0.5, anew.visible.reshape(height, width)
    low, high = around(visible.astype(int))
    assert visible.sum() > 100
    assert not ((mask != visible) & (low == high)).any()
    # The outline bends little within a pixel: its centre tells the half but where it passes close by.
    assert (mask != visible).sum() < 0.1 * (high > low).sum()


def test_nothing_is_kept_of_a_study_that_asks_for_none(mi, tmp_path: Path) -> None:
    study = small_study(tmp_path, (BAND, "band_samples: 64, radiance: false"))
    assert render_radiance(mi, frame_of(study, 0)).depth_m is None


def test_a_point_comes_back_from_its_pixel_and_depth(mi, tmp_path: Path) -> None:
    frame = frame_of(small_study(tmp_path, FISHEYE), 0)
    depth = render_radiance(mi, frame).depth_m.astype(float)
    rows, columns = np.nonzero(depth)
    rays = ray_direction(frame.camera, np.column_stack([columns, rows]).astype(float))
    points = rays * (depth[rows, columns] / rays[:, 2])[:, None]
    # In the plane of the print, to a micrometre or two.
    assert np.abs((points - frame.camera_from_sheet[:3, 3]) @ frame.camera_from_sheet[:3, 2]).max() < 5e-6
