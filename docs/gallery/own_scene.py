"""Make a small scene of one's own and its picture: `python docs/gallery/own_scene.py FOLDER`.

Writes FOLDER/table.glb (a textured table with a box and a ball, made by trimesh), FOLDER/walls (two pictures), two
studies and their datasets, and puts their images into docs/gallery/own_scene.jpg.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from PIL import Image, ImageFilter
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from roundel import open_images, render_study

HERE = Path(__file__).parent
TOP_M = 0.72
STUDY = """\
schema: 1
name: own scene
seed: 2
camera: {width_px: 480, height_px: 360, focal_px: 560}
marker: {kind: disc, diameter_m: 0.09}
pose:
  distance_m: {uniform: [0.7, 1.2]}
  tilt_deg: {uniform: [40, 62]}
  azimuth_deg: {uniform: [-115, -65]}
  roll_deg: {uniform: [-30, 30]}
  offset_x_px: {uniform: [-80, 80]}
  offset_y_px: {uniform: [-10, 50]}
sensor: {mosaic: rggb, curve: srgb}
render: {background_error: 0.02}
light:
  environment: 0.35
  lamps: [{position_m: [-0.7, -0.9, 0.3], size_m: 0.2, radiance: 25}]
world: WORLD
frames: FRAMES
"""
WORLDS = {
    "scene": ("{scene: table.glb, sheet_thickness_m: 0.002}", 4),
    "pictures": ("{pictures: walls, picture_m: 1.2}", 2),
}


def wood(seed: int, side: int = 512) -> Image.Image:
    """Boards of wood: streaks along x, a dark joint every quarter."""
    rng = np.random.default_rng(seed)
    grain = Image.fromarray(rng.integers(0, 255, (side, 8)).astype(np.uint8)).resize(
        (side, side), Image.Resampling.BICUBIC
    )
    streaks = np.asarray(grain.filter(ImageFilter.GaussianBlur(1)), dtype=float)[..., None] / 255 - 0.5
    boards = np.repeat(rng.uniform(0.85, 1.1, 4), side // 4)[:, None, None]
    picture = np.array([176, 122, 74]) * boards * (1 + 0.35 * streaks)
    picture[:: side // 4] *= 0.4
    return Image.fromarray(np.clip(picture, 0, 255).astype(np.uint8))


def painted(mesh: trimesh.Trimesh, colour: tuple[float, float, float], **look: float) -> trimesh.Trimesh:
    """A mesh with one colour, linear."""
    keys: dict[str, Any] = {"metallicFactor": 0.0, "roughnessFactor": 0.7, **look}
    mesh.visual = TextureVisuals(material=PBRMaterial(baseColorFactor=[*colour, 1.0], **keys))
    return mesh


def box(size: tuple[float, float, float], foot: tuple[float, float, float]) -> trimesh.Trimesh:
    """A box that stands on a point."""
    made = trimesh.creation.box(size)
    made.apply_translation([foot[0], foot[1] + size[1] / 2, foot[2]])
    return made


def table() -> trimesh.Scene:
    """The scene: y is up, in metres."""
    x, z = 0.6, 0.4
    corners = [[-x, TOP_M, z], [x, TOP_M, z], [x, TOP_M, -z], [-x, TOP_M, -z]]
    top = trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)
    board = PBRMaterial(baseColorTexture=wood(1), metallicFactor=0.0, roughnessFactor=0.45)
    top.visual = TextureVisuals(uv=[[0, 0], [1, 0], [1, 1], [0, 1]], material=board)
    ball = trimesh.creation.icosphere(4, 0.06)
    ball.apply_translation([-0.26, TOP_M + 0.06, -0.12])
    can = trimesh.creation.cylinder(0.04, 0.14, sections=48)
    can.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0]))
    can.apply_translation([0.05, TOP_M + 0.07, -0.25])
    things = {
        "top": top,
        "edge": painted(box((2 * x, 0.03, 2 * z), (0, TOP_M - 0.031, 0)), (0.3, 0.17, 0.08)),
        "box": painted(box((0.12, 0.16, 0.1), (0.28, TOP_M, -0.18)), (0.75, 0.12, 0.05)),
        "ball": painted(ball, (0.9, 0.75, 0.4), metallicFactor=1.0, roughnessFactor=0.25),
        "can": painted(can, (0.1, 0.3, 0.55), roughnessFactor=0.3),
        "floor": painted(box((6, 0.1, 6), (0, -0.1, 0)), (0.25, 0.24, 0.22)),
        "wall": painted(box((6, 3, 0.1), (0, 0, -1.2)), (0.5, 0.52, 0.48)),
    }
    return trimesh.Scene(things)


def main(folder: Path) -> None:
    """Write the scene, render both studies, and join their images."""
    (folder / "walls").mkdir(parents=True, exist_ok=True)
    (folder / "table.glb").write_bytes(table().export(file_type="glb"))
    for i in range(2):
        wood(10 + i).save(folder / "walls" / f"{i}.png")
    tiles = []
    for name, (world, frames) in WORLDS.items():
        text = STUDY.replace("WORLD", world).replace("FRAMES", str(frames))
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
        render_study(folder / f"{name}.yaml", folder / name)
        images = open_images(folder / name)
        tiles += [images.image(i) for i in range(frames)]
    rows = [np.concatenate(tiles[i : i + 3], axis=1) for i in (0, 3)]
    page = Image.fromarray(np.concatenate(rows))
    page.resize((page.width * 3 // 4, page.height * 3 // 4)).save(HERE / "own_scene.jpg", quality=85, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
