"""The benchmark's scene with plain `mi.render`: stock shapes, sensor, sampler and film, nothing of Roundel's.

    python peer_mitsuba.py JOB.json

JOB has `scene` (reference.scene_numbers), `renders`: a list of {sampler, spp, seed, window, out}, and `result`.
Roundel is imported only to find the libLLVM for Dr.Jit.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from roundel.render.backend import start

# Offset of the sheet from the wall and of the disc from the sheet: 0.003 px of parallax, above float32 resolution.
_STEP_M = 3e-6


def shapes(mi: Any, scene: dict[str, Any]) -> dict[str, Any]:
    pose = mi.ScalarTransform4f(np.array(scene["camera_from_sheet"]))
    t = mi.ScalarTransform4f

    def matte(reflectance: float) -> dict[str, Any]:
        return {"type": "diffuse", "reflectance": {"type": "spectrum", "value": reflectance}}

    low, high = (np.array(scene[k]) for k in ("sheet_low_m", "sheet_high_m"))
    (x, y), (w, h) = (low + high) / 2, (high - low) / 2
    half, radius = scene["wall_half_m"], scene["radius_m"]
    lamp = scene["lamp"]
    aim = [row[3] for row in scene["camera_from_sheet"][:3]]
    toward_lamp = t().look_at(origin=lamp["position_m"], target=aim, up=[0, -1, 0])
    return {
        "wall": {"type": "rectangle", "to_world": pose @ t().scale([half, half, 1]), "print": matte(scene["wall"])},
        "sheet": {
            "type": "rectangle",
            "to_world": pose @ t().translate([x, y, _STEP_M]) @ t().scale([w, h, 1]),
            "print": matte(scene["paper"]),
        },
        "disc": {
            "type": "disk",
            "to_world": pose @ t().translate([0, 0, 2 * _STEP_M]) @ t().scale([radius, radius, 1]),
            "print": matte(scene["ink"]),
        },
        "lamp": {
            "type": "rectangle",
            "to_world": toward_lamp @ t().scale(lamp["size_m"] / 2),
            "emitter": {"type": "area", "radiance": lamp["radiance"]},
        },
        # Hit by reflected rays alone, without noise: half the noise of also sampling it.
        "sky": {"type": "constant", "radiance": scene["environment"], "sampling_weight": 0.0},
    }


def sensor(mi: Any, scene: dict[str, Any], one: dict[str, Any]) -> Any:
    width, height = scene["width_px"], scene["height_px"]
    film: dict[str, Any] = {
        "type": "hdrfilm",
        "width": width,
        "height": height,
        "pixel_format": "luminance",
        "component_format": "float32",
        "rfilter": {"type": "box"},
    }
    if one["window"] is not None:
        x0, y0, x1, y1 = one["window"]
        film |= {"crop_offset_x": x0, "crop_offset_y": y0, "crop_width": x1 - x0, "crop_height": y1 - y0}
    return mi.load_dict(
        {
            "type": "perspective",
            "fov": float(np.degrees(2 * np.arctan(width / 2 / scene["focal_px"]))),
            "fov_axis": "x",
            # Mitsuba's camera has x to the left; half a turn about z gives OpenCV's.
            "to_world": mi.ScalarTransform4f().rotate([0, 0, 1], 180),
            # Mitsuba counts from the pixel's corner, hence the half; its offset moves the film, hence the sign.
            "principal_point_offset_x": 0.5 - (scene["cx_px"] + 0.5) / width,
            "principal_point_offset_y": 0.5 - (scene["cy_px"] + 0.5) / height,
            "near_clip": 1e-3,
            "film": film,
            "sampler": {"type": one["sampler"], "sample_count": one["spp"]},
        }
    )


def main() -> None:
    job = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    mi = start("llvm_ad_mono", job["threads"])
    integrator = mi.load_dict({"type": "direct", "emitter_samples": 1, "bsdf_samples": 1})
    scene = mi.load_dict({"type": "scene", **shapes(mi, job["scene"])})
    seconds = []
    for one in job["renders"]:
        camera = sensor(mi, job["scene"], one)
        began = time.perf_counter(), time.process_time()
        image = np.array(mi.render(scene, sensor=camera, integrator=integrator, spp=one["spp"], seed=one["seed"]))
        seconds.append([time.perf_counter() - began[0], time.process_time() - began[1]])
        np.save(one["out"], image[..., 0])
    Path(job["result"]).write_text(json.dumps({"seconds": seconds, "version": mi.__version__}))


if __name__ == "__main__":
    main()
