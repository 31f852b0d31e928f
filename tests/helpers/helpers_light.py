"""Light at single points of a print, without pixels, for comparing theory with Mitsuba's scene."""

from pathlib import Path
from typing import Any

import numpy as np

from roundel.render.scene.scene import build_scene, trace_built
from roundel.scenes.geometry.pose import transform_points
from roundel.scenes.world.frame import Frame


def radiance_at(mi: Any, frame: Frame, points_sheet: Any, samples: int = 64, seed: int = 0) -> np.ndarray:
    """Radiance (n, channels) that leaves points (n, 2) of the sheet toward the camera, by Mitsuba's integrator."""
    flat = np.column_stack([np.asarray(points_sheet, dtype=float), np.zeros(len(points_sheet))])
    return radiance_along(mi, frame, transform_points(frame.camera_from_sheet, flat), samples, seed)


def radiance_along(mi: Any, frame: Frame, points: Any, samples: int = 64, seed: int = 0) -> np.ndarray:
    """Radiance (n, channels) along rays from the camera's centre through points (n, 3) of the camera frame."""
    import drjit as dr

    built, count = build_scene(mi, frame), len(points)
    sampler = mi.load_dict({"type": "independent", "sample_count": samples})
    sampler.seed(dr.opaque(mi.UInt32, seed), count * samples)
    toward = np.asarray(points, dtype=float)
    toward = np.repeat(toward / np.linalg.norm(toward, axis=1, keepdims=True), samples, axis=0).astype(np.float32)
    ray = mi.Ray3f(dr.zeros(mi.Point3f, count * samples), mi.Vector3f(*toward.T), mi.Float(0.0), mi.Color0f())
    value = trace_built(built, sampler, mi.RayDifferential3f(ray))[0]
    means = [dr.block_sum(channel, samples) / samples for channel in value]
    dr.eval(means)
    return np.stack([np.array(mean, dtype=float) for mean in means], axis=-1)


def light_from(mi: Any, emitter: Any, directions: Any) -> np.ndarray:
    """Radiance (n, channels) that an environment emitter sends from directions (n, 3) of the camera frame."""
    import drjit as dr

    made = mi.load_dict(emitter) if isinstance(emitter, dict) else emitter
    d = np.asarray(directions, dtype=np.float32)
    si = dr.zeros(mi.SurfaceInteraction3f, len(d))
    si.wi = mi.Vector3f(*(-(d / np.linalg.norm(d, axis=1, keepdims=True)).T))
    return np.array(made.eval(si), dtype=float).T


def write_map(path: Path, pixels: np.ndarray, names: str = "RGB") -> None:
    """A tiny EXR file; `pixels` (H, W, channels) float32."""
    import OpenEXR

    channels = {name: np.ascontiguousarray(pixels[..., i], dtype=np.float32) for i, name in enumerate(names)}
    OpenEXR.File({"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}, channels).write(str(path))
