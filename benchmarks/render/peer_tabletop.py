"""Tabletops in Cycles. Runs in an interpreter that has `bpy`, and imports nothing from Roundel.

    python peer_tabletop.py JOB.json

JOB has `renders`: a list of {scene, threshold, min_samples, samples, seed, window, out}, `threads`, and `result`: the
file for the wall and processor seconds of each. `scene` is a .npz of `tabletop_cycles.scene_file`.
"""

from __future__ import annotations

import json
import math
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from peer_cycles import material

# Corners of the disc's polygon: 1e-4 px from the circle at a radius of 60 px.
_SEGMENTS = 2048


def body_material(bpy: Any, name: str, kind: str, colour: float, roughness: float) -> Any:
    """Diffuse, coated, metal or thin glass; Blender's roughness is the root of the GGX alpha."""
    if kind == "diffuse":
        return material(bpy, name, colour)
    made = material(bpy, name, colour)
    tree = made.node_tree
    nodes, links = tree.nodes, tree.links
    output = next(node for node in nodes if node.type == "OUTPUT_MATERIAL")
    grey = (colour, colour, colour, 1.0)
    if kind == "metal":
        node = nodes.new("ShaderNodeBsdfAnisotropic")
        node.inputs["Color"].default_value, node.inputs["Roughness"].default_value = grey, math.sqrt(roughness)
    elif kind == "glass":
        # A thin pane: what is not reflected goes straight on.
        node, clear, mirror = (
            nodes.new(f"Shader{n}") for n in ("NodeMixShader", "NodeBsdfTransparent", "NodeBsdfAnisotropic")
        )
        mirror.inputs["Roughness"].default_value = 0.0
        node.inputs[0].default_value = 0.08
        links.new(clear.outputs[0], node.inputs[1])
        links.new(mirror.outputs[0], node.inputs[2])
    else:
        node = nodes.new("ShaderNodeBsdfPrincipled")
        node.inputs["Base Color"].default_value, node.inputs["Roughness"].default_value = grey, math.sqrt(roughness)
    links.new(node.outputs[0], output.inputs["Surface"])
    return made


def print_mesh(bpy: Any, low: Any, high: Any, radius: float, ink: float, paper: float) -> Any:
    """Disc and sheet as one flat mesh without overlap."""
    (x0, y0), (x1, y1) = low, high
    circle, border = [], []
    for i in range(_SEGMENTS):
        c, s = math.cos(2 * math.pi * i / _SEGMENTS), math.sin(2 * math.pi * i / _SEGMENTS)
        circle.append((radius * c, radius * s, 0.0))
        reach = min((x1 if c > 0 else -x0) / max(abs(c), 1e-12), (y1 if s > 0 else -y0) / max(abs(s), 1e-12))
        border.append((reach * c, reach * s, 0.0))
    faces, kinds = [], []
    for i in range(_SEGMENTS):
        j = (i + 1) % _SEGMENTS
        a, b = 1 + i, 1 + j
        faces += [(0, a, b), (a, a + _SEGMENTS, b + _SEGMENTS, b)]
        kinds += [0, 1]
    mesh = bpy.data.meshes.new("print")
    mesh.from_pydata([(0.0, 0.0, 0.0), *circle, *border], [], faces)
    mesh.materials.append(material(bpy, "ink", ink))
    mesh.materials.append(material(bpy, "paper", paper))
    mesh.polygons.foreach_set("material_index", kinds)
    mesh.update()
    return mesh


def build(bpy: Any, path: str) -> Any:
    from mathutils import Matrix

    data = np.load(path, allow_pickle=False)
    about = json.loads(str(data["about"]))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    stage = bpy.context.scene
    stage.render.engine = "CYCLES"
    # Blender's camera looks along -z with y up; the scene's world is the camera frame, y down and z forward.
    flip = Matrix.Diagonal((1.0, -1.0, -1.0, 1.0))
    camera = bpy.data.cameras.new("camera")
    width, height = about["width_px"], about["height_px"]
    camera.sensor_fit, camera.sensor_width = "HORIZONTAL", 36.0
    camera.lens = about["focal_px"] * 36.0 / width
    camera.shift_x = -(about["cx_px"] - (width - 1) / 2) / width
    camera.shift_y = (about["cy_px"] - (height - 1) / 2) / width
    camera.clip_start, camera.clip_end = 1e-3, 1e3
    eye = bpy.data.objects.new("camera", camera)
    stage.collection.objects.link(eye)
    stage.camera = eye

    def put(name: str, data: Any, pose: Any) -> None:
        thing = bpy.data.objects.new(name, data)
        thing.matrix_world = pose
        stage.collection.objects.link(thing)

    sheet = print_mesh(bpy, about["low_m"], about["high_m"], about["radius_m"], about["ink"], about["paper"])
    put("print", sheet, flip @ Matrix(about["camera_from_sheet"]))
    for i, body in enumerate(about["bodies"]):
        mesh = bpy.data.meshes.new(f"body {i}")
        mesh.from_pydata(data[f"vertices_{i}"].tolist(), [], data[f"faces_{i}"].tolist())
        mesh.materials.append(body_material(bpy, f"body {i}", body["kind"], body["colour"], body["roughness"]))
        mesh.update()
        mesh.normals_split_custom_set_from_vertices(data[f"normals_{i}"].tolist())
        put(f"body {i}", mesh, flip)
    for i, panel in enumerate(about["panels"]):
        light = bpy.data.lights.new(f"panel {i}", "AREA")
        light.shape, (light.size, light.size_y) = "RECTANGLE", (2 * h for h in panel["half_m"])
        # Watts: radiance times pi times area; a lamp shines along its -z, a panel along its z.
        light.energy = panel["radiance"] * math.pi * light.size * light.size_y
        put(f"panel {i}", light, flip @ Matrix(panel["camera_from_panel"]) @ Matrix.Rotation(math.pi, 4, "X"))
    world = bpy.data.worlds.new("world")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.0
    stage.world = world
    return stage, width, height


def main() -> None:
    import bpy

    job = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    seconds = []
    for one in job["renders"]:
        stage, width, height = build(bpy, one["scene"])
        cycles, render = stage.cycles, stage.render
        cycles.device, cycles.use_denoising = "CPU", False
        cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0
        # Four reflections, as in ours: Cycles does not count the first.
        cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = 3
        cycles.transparent_max_bounces = 8
        cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
        cycles.blur_glossy = 0.0
        cycles.use_adaptive_sampling = one["threshold"] > 0
        cycles.adaptive_threshold, cycles.adaptive_min_samples = one["threshold"], one["min_samples"]
        cycles.samples, cycles.seed, cycles.use_auto_tile = one["samples"], one["seed"], False
        render.threads_mode, render.threads = "FIXED", job["threads"]
        render.resolution_x, render.resolution_y, render.resolution_percentage = width, height, 100
        image = render.image_settings
        image.file_format, image.color_depth, image.color_mode, image.exr_codec = "OPEN_EXR", "32", "RGB", "ZIP"
        render.use_border, render.use_crop_to_border = one["window"] is not None, False
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
