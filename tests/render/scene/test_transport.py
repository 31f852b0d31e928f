"""The plain world's closed form against Mitsuba's path integrator: the same light, ray by ray."""

from pathlib import Path

import numpy as np
import pytest
from helpers_light import write_map
from helpers_studies import small_study

from roundel.render.backend import start
from roundel.render.scene.scene import build_scene
from roundel.render.scene.transport import is_plain, plain_scene, trace
from roundel.scenes.camera.model import ray_direction
from roundel.scenes.world.frame import Frame, frame_of

LIGHT = "light: {environment: 0.7, lamps: [{position_m: [-0.3, -0.5, 0.0], size_m: 0.2, radiance: 6}]}"
POINT = "{kind: point, position_m: [%g, -0.5, 0.0], intensity: 1.5}"

# Rays through the picture; samples of the light along each; independent runs, whose scatter is the standard error.
RAYS, SAMPLES, RUNS = 48, 1024, 4


def directions_of(frame: Frame) -> np.ndarray:
    """Unit directions (n, 3) through the whole picture, none at a pixel's centre."""
    columns = np.linspace(0.3, frame.camera.width_px - 1.3, RAYS)
    rows = np.linspace(0.2, frame.camera.height_px - 1.4, RAYS)
    rays = ray_direction(frame.camera, np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2))
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def on_ink(frame: Frame) -> np.ndarray:
    """Which of these rays (n,) meet the disc."""
    pose, rays = frame.camera_from_sheet, directions_of(frame)
    points = rays * ((pose[:3, 3] @ pose[:3, 2]) / (rays @ pose[:3, 2]))[:, None]
    return np.linalg.norm(points - pose[:3, 3], axis=1) < frame.sheet.parts[0].radius_m


@pytest.mark.parametrize(
    ("variant", "light"),
    [
        ("mono", "{environment: 1.5}"),
        ("mono", "{environment: 0.7, lamps: [{position_m: [-0.3, -0.5, 0.0], size_m: 0.2, radiance: 6}]}"),
        ("mono", f"{{environment: 0.2, lamps: [{POINT % -0.3}, {POINT % 0.3}]}}"),
        ("mono", "{map: {file: map.exr, turn_deg: 50}}"),
        ("rgb", "{sky: {sun_elevation_deg: 40, sun_azimuth_deg: 160}}"),
    ],
    ids=["constant", "area lamp", "point lamps", "map", "sky"],
)
def test_the_path_integrator_finds_the_light_of_the_closed_form(tmp_path: Path, variant: str, light: str) -> None:
    mi = start(f"llvm_ad_{variant}")
    import drjit as dr

    across, down = np.meshgrid(np.linspace(0, 2 * np.pi, 64), np.linspace(0, 1, 32))
    write_map(tmp_path / "map.exr", np.repeat((1 + np.cos(across) * down)[..., None], 3, axis=-1))
    frame = frame_of(small_study(tmp_path, (LIGHT, f"light: {light}")), 0)
    assert is_plain(frame)
    toward = np.repeat(directions_of(frame), SAMPLES, axis=0).astype(np.float32)

    def mean_of(tracer, seed: int) -> np.ndarray:
        """Mean of each ray's samples and of the channels."""
        sampler = mi.load_dict({"type": "multijitter", "sample_count": SAMPLES})
        sampler.set_samples_per_wavefront(SAMPLES)
        sampler.seed(dr.opaque(mi.UInt32, seed), len(toward))
        ray = mi.Ray3f(dr.zeros(mi.Point3f, len(toward)), mi.Vector3f(*toward.T), mi.Float(0.0), mi.Color0f())
        means = [dr.block_sum(channel, SAMPLES) / SAMPLES for channel in tracer(sampler, mi.RayDifferential3f(ray))]
        dr.eval(means)
        return np.mean([np.array(mean, dtype=float) for mean in means], axis=0)

    plain, built = plain_scene(dr, mi, frame), build_scene(mi, frame)
    # From the camera to the sheet and on to the light: two segments, as the closed form has them.
    path = mi.load_dict({"type": "path", "max_depth": 2, "rr_depth": 3})
    closed = np.mean([mean_of(lambda s, r: trace(dr, mi, plain, s, r)[0], i) for i in range(RUNS)], axis=0)
    runs = [
        mean_of(lambda s, r: path.sample(built.scene, s, r)[0] * built.unit, RUNS + i) - closed for i in range(RUNS)
    ]
    start()

    marker = frame.settings.marker
    white = closed.max() / max(marker.paper, marker.wall)
    off = [run.mean() / white for run in runs]
    # The Monte-Carlo standard error is far below what is to be shown.
    assert np.std(off, ddof=1) / np.sqrt(RUNS) < 2e-5
    assert abs(np.mean(off)) < 1e-4
    # On the ink alone, and on paper and wall: a reflectance that is off would show there.
    error, ink = np.mean(runs, axis=0) / white, on_ink(frame)
    assert 50 < ink.sum() < 500
    assert abs(error[ink].mean()) < 1e-4
    assert abs(error[~ink].mean()) < 1e-4
