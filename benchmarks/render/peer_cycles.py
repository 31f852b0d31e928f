"""The benchmark's scene in Cycles. Runs in an interpreter that has `bpy`, and imports nothing from Roundel.

    python peer_cycles.py JOB.json

JOB has `scene` (reference.scene_numbers), `renders`: a list of {threshold, min_samples, samples, seed, window, out},
and `result`: the file for the wall and processor seconds of each. `min_samples` 0 is Cycles' own choice.
"""

from __future__ import annotations

import json
import math
import sys
import time
from pathlib import Path
from typing import Any

# Corners of the disc's polygon: 0.0007 px from the circle at the benchmark's size; ten times as many cost time.
_SEGMENTS = 512


def material(bpy: Any, name: str, reflectance: float) -> Any:
    made = bpy.data.materials.new(name)
    made.use_nodes = True  # bpy 5 does so by itself
    nodes = made.node_tree.nodes
    nodes.clear()
    diffuse = nodes.new("ShaderNodeBsdfDiffuse")
    diffuse.inputs["Color"].default_value = (reflectance, reflectance, reflectance, 1.0)
    diffuse.inputs["Roughness"].default_value = 0.0
    output = nodes.new("ShaderNodeOutputMaterial")
    made.node_tree.links.new(diffuse.outputs["BSDF"], output.inputs["Surface"])
    return made


def print_mesh(bpy: Any, scene: dict[str, Any]) -> Any:
    """Disc, sheet and wall as one flat mesh without overlap: no offsets, no z-fighting, materials face by face."""
    (x0, y0), (x1, y1) = scene["sheet_low_m"], scene["sheet_high_m"]
    circle, border = [], []
    for i in range(_SEGMENTS):
        c, s = math.cos(2 * math.pi * i / _SEGMENTS), math.sin(2 * math.pi * i / _SEGMENTS)
        circle.append((scene["radius_m"] * c, scene["radius_m"] * s, 0.0))
        # The same direction, out to the sheet's border: multiples of 45 degrees hit its corners.
        reach = min((x1 if c > 0 else -x0) / max(abs(c), 1e-12), (y1 if s > 0 else -y0) / max(abs(s), 1e-12))
        border.append((reach * c, reach * s, 0.0))
    half = scene["wall_half_m"]
    outer = [(half, half, 0.0), (-half, half, 0.0), (-half, -half, 0.0), (half, -half, 0.0)]
    inner = [(x1, y1, 0.0), (x0, y1, 0.0), (x0, y0, 0.0), (x1, y0, 0.0)]
    vertices = [(0.0, 0.0, 0.0), *circle, *border, *outer, *inner]
    first, second, third = 1, 1 + _SEGMENTS, 1 + 2 * _SEGMENTS
    faces, kinds = [], []
    for i in range(_SEGMENTS):
        j = (i + 1) % _SEGMENTS
        faces += [(0, first + i, first + j), (first + i, second + i, second + j, first + j)]
        kinds += [0, 1]
    for i in range(4):
        j = (i + 1) % 4
        faces.append((third + 4 + i, third + i, third + j, third + 4 + j))
        kinds.append(2)
    mesh = bpy.data.meshes.new("print")
    mesh.from_pydata(vertices, [], faces)
    for name in ("ink", "paper", "wall"):
        mesh.materials.append(material(bpy, name, scene[name]))
    mesh.polygons.foreach_set("material_index", kinds)
    mesh.update()
    return mesh


def build(bpy: Any, scene: dict[str, Any]) -> Any:
    from mathutils import Matrix, Vector

    bpy.ops.wm.read_factory_settings(use_empty=True)
    stage = bpy.context.scene
    stage.render.engine = "CYCLES"
    # Blender's camera looks along -z with y up; the scene's world is the camera frame, y down and z forward.
    flip = Matrix.Diagonal((1.0, -1.0, -1.0, 1.0))

    camera = bpy.data.cameras.new("camera")
    width, height = scene["width_px"], scene["height_px"]
    camera.sensor_fit = "HORIZONTAL"
    camera.sensor_width = 36.0
    camera.lens = scene["focal_px"] * 36.0 / width
    camera.shift_x = -(scene["cx_px"] - (width - 1) / 2) / width
    camera.shift_y = (scene["cy_px"] - (height - 1) / 2) / width
    camera.clip_start, camera.clip_end = 1e-3, 1e3
    eye = bpy.data.objects.new("camera", camera)
    stage.collection.objects.link(eye)
    stage.camera = eye

    plane = bpy.data.objects.new("print", print_mesh(bpy, scene))
    plane.matrix_world = flip @ Matrix(scene["camera_from_sheet"])
    stage.collection.objects.link(plane)

    lamp = scene["lamp"]
    light = bpy.data.lights.new("lamp", "AREA")
    light.shape, light.size = "SQUARE", lamp["size_m"]
    # Blender's watts: radiance times pi times area, as for a one-sided Lambertian emitter. Its lamps do not hide the
    # sky behind them, ours do: with the sky's radiance subtracted, both illuminate the sheet equally.
    light.energy = (lamp["radiance"] - scene["environment"]) * math.pi * lamp["size_m"] ** 2
    placed = bpy.data.objects.new("lamp", light)
    position = flip @ Vector((*lamp["position_m"], 1.0))
    aim = flip @ Vector((*(row[3] for row in scene["camera_from_sheet"][:3]), 1.0))
    toward = (aim - position).to_3d()
    placed.matrix_world = Matrix.Translation(position.to_3d()) @ toward.to_track_quat("-Z", "Y").to_matrix().to_4x4()
    stage.collection.objects.link(placed)

    world = bpy.data.worlds.new("world")
    world.use_nodes = True
    background = world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    background.inputs["Strength"].default_value = scene["environment"]
    stage.world = world
    return stage


def settle(stage: Any, scene: dict[str, Any], threads: int) -> None:
    """Settings of all renders: CPU, no denoiser, adaptive sampling, box filter of one pixel, linear float EXR."""
    cycles, render = stage.cycles, stage.render
    cycles.device = "CPU"
    cycles.use_denoising = False
    cycles.use_adaptive_sampling = True
    cycles.pixel_filter_type = "BOX"
    cycles.filter_width = 1.0
    cycles.max_bounces = cycles.diffuse_bounces = 0  # direct light; the sky counts as such
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.use_light_tree = False  # one lamp: there is nothing to select
    cycles.use_auto_tile = False
    render.threads_mode, render.threads = "FIXED", threads
    # Persistent data would keep the sample count of the first render (seen with bpy 5.0.1).
    render.use_persistent_data = False
    render.resolution_x, render.resolution_y = scene["width_px"], scene["height_px"]
    render.resolution_percentage = 100
    render.film_transparent = False
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_depth = "32"
    render.image_settings.color_mode = "RGB"
    render.image_settings.exr_codec = "ZIP"


def main() -> None:
    import bpy

    job = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    scene = job["scene"]
    stage = build(bpy, scene)
    settle(stage, scene, job["threads"])
    width, height = scene["width_px"], scene["height_px"]
    seconds = []
    for one in job["renders"]:
        cycles, render = stage.cycles, stage.render
        cycles.adaptive_threshold = one["threshold"]
        cycles.adaptive_min_samples = one["min_samples"]
        cycles.samples = one["samples"]
        cycles.seed = one["seed"]
        render.use_border = one["window"] is not None
        render.use_crop_to_border = False
        if one["window"] is not None:
            x0, y0, x1, y1 = one["window"]
            render.border_min_x, render.border_max_x = x0 / width, x1 / width
            render.border_min_y, render.border_max_y = 1 - y1 / height, 1 - y0 / height
        render.filepath = one["out"]
        began = time.perf_counter(), time.process_time()
        bpy.ops.render.render(write_still=True)
        seconds.append([time.perf_counter() - began[0], time.process_time() - began[1]])
    Path(job["result"]).write_text(json.dumps({"seconds": seconds, "version": bpy.app.version_string}))


if __name__ == "__main__":
    main()
