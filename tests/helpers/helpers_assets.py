"""Small scenes of a user's own, made when a test needs them."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from helpers_studies import SMALL

LIGHT = "light: {environment: 0.7, lamps: [{position_m: [-0.3, -0.5, 0.0], size_m: 0.2, radiance: 6}]}"
TABLE_M = 0.75


def arrow(side: int = 64) -> np.ndarray:
    """sRGB picture (side, side, 3): its top quarter red, its right quarter blue below that, the rest grey."""
    picture = np.full((side, side, 3), 128, dtype=np.uint8)
    picture[:, 3 * side // 4 :] = (20, 20, 220)
    picture[: side // 4] = (220, 20, 20)
    return picture


def png_bytes(picture: np.ndarray, kind: str = "PNG") -> bytes:
    from PIL import Image

    out = io.BytesIO()
    Image.fromarray(picture).save(out, kind)
    return out.getvalue()


def table(texture: np.ndarray | None = None, extra: dict | None = None, side_m: float = 1.0):
    """A trimesh scene: a textured table top at y = 0.75 m, whose texture's top is toward -z, on a brown slab."""
    import trimesh
    from PIL import Image
    from trimesh.visual import TextureVisuals
    from trimesh.visual.material import PBRMaterial

    h = side_m / 2
    top = trimesh.Trimesh(
        vertices=[[-h, TABLE_M, h], [h, TABLE_M, h], [h, TABLE_M, -h], [-h, TABLE_M, -h]],
        faces=[[0, 1, 2], [0, 2, 3]],
        process=False,
    )
    picture = Image.fromarray(arrow() if texture is None else texture)
    paint = PBRMaterial(baseColorTexture=picture, metallicFactor=0.0, roughnessFactor=0.9)
    top.visual = TextureVisuals(uv=[[0, 0], [1, 0], [1, 1], [0, 1]], material=paint)
    slab = trimesh.creation.box([side_m, 0.03, side_m])
    slab.apply_translation([0, TABLE_M - 0.016, 0])
    slab.visual = TextureVisuals(
        material=PBRMaterial(baseColorFactor=[0.4, 0.2, 0.1, 1.0], metallicFactor=0.0, roughnessFactor=0.9)
    )
    return trimesh.Scene({"top": top, "slab": slab, **(extra or {})})


def write_table(folder: Path, name: str = "table.glb", **keys) -> None:
    (folder / name).write_bytes(table(**keys).export(file_type="glb"))


def own_study(folder: Path, world: str, light: str = "", *edits: tuple[str, str]):
    """SMALL in a world of the user's own; 4 frames from 0.56 to 0.72 m, tilted by up to 50 degrees."""
    from roundel.scenes.study.study import load_study

    path = folder / "study.yaml"
    text = SMALL.replace(LIGHT, f"world: {world}\n{light}").replace(
        "azimuth_deg: {uniform: [-180, 180]}", "azimuth_deg: -90"
    )
    for old, new in edits:
        assert old in text, old
        text = text.replace(old, new, 1)
    path.write_text(text)
    return load_study(path)


XML = """\
<scene version="3.0.0">
  <default name="spp" value="16"/>
  <integrator type="path"/>
  <sensor type="perspective"><sampler type="independent"><integer name="sample_count" value="$spp"/></sampler></sensor>
  <bsdf type="twosided" id="paint"><bsdf type="diffuse"><rgb name="reflectance" value="0.2, 0.3, 0.5"/></bsdf></bsdf>
  <shape type="rectangle">
    <transform name="to_world"><rotate x="1" angle="-90"/><translate y="0.75"/></transform><ref id="paint"/>
  </shape>
  <shape type="sphere" id="ball"><point name="center" x="0.3" y="0.85" z="0"/><float name="radius" value="0.1"/></shape>
  MORE
</scene>
"""


def write_xml(folder: Path, more: str = "", name: str = "scene.xml") -> None:
    (folder / name).write_text(XML.replace("MORE", more))
