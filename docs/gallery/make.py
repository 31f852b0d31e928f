"""Make the contact sheets of the gallery: `python docs/gallery/make.py [effects] [presets]`.

Roundel renders every picture from an ordinary study. The sheet of effects has one captioned tile per effect; the
sheet of presets has several frames of each.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from roundel.render.run import render_study
from roundel.scenes.study.layers import deep_merge, preset_names

HERE = Path(__file__).parent
TILE, CAPTION, GAP = (320, 240), 40, 8
PAPER, INK, GREY = (255, 255, 255), (20, 20, 20), (110, 110, 110)

BASE = """
schema: 1
name: gallery
seed: 11
camera: {width_px: 320, height_px: 240, focal_px: 480}
marker: {kind: disc, diameter_m: 0.08}
pose: {distance_m: 0.5, tilt_deg: 35, azimuth_deg: 120, roll_deg: 10}
light: {environment: 0.5, lamps: [{position_m: [-0.5, -0.7, -0.1], size_m: 0.25, radiance: 10}]}
render: {radiance: false}
frames: 1
"""


def indoor_map(path: Path) -> None:
    """A small environment map: a dim room with a window and two lamps on the ceiling."""
    import OpenEXR

    height, width = 64, 128
    v, u = np.mgrid[:height, :width].astype(np.float32)
    room = np.where(v < height / 2, 0.35, 0.15)[..., None] * np.array([1.0, 0.95, 0.85])
    window = (np.abs(u - 40) < 8) & (np.abs(v - 26) < 7)
    lamps = (np.hypot(u - 90, (v - 12) * 1.5) < 4) | (np.hypot(u - 110, (v - 14) * 1.5) < 3)
    room = np.where(window[..., None], np.array([9.0, 10.0, 12.0]), room)
    room = np.where(lamps[..., None], np.array([30.0, 24.0, 15.0]), room)
    OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION}, {"RGB": room.astype(np.float32)}).write(str(path))


def _study(own: dict[str, Any], zoom: int) -> dict[str, Any]:
    study = yaml.safe_load(BASE)
    size = {"width_px": TILE[0] // zoom, "height_px": TILE[1] // zoom}
    merged: dict[str, Any] = deep_merge(deep_merge(study, {"camera": size}), own)
    return merged


def tile(image: NDArray[Any], size: tuple[int, int] = TILE) -> Image.Image:
    """Resize an image to a tile; enlarge without smoothing, reduce with smoothing."""
    grey = image if image.dtype == np.uint8 else (image >> 8).astype(np.uint8)
    picture = Image.fromarray(grey).convert("RGB")
    enlarged = picture.width < size[0]
    return picture.resize(size, Image.Resampling.NEAREST if enlarged else Image.Resampling.LANCZOS)


def font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Load Pillow's default font."""
    return ImageFont.load_default(size)


def sheet(rows: list[tuple[str, list[tuple[str, Image.Image]]]], columns: int, tile_px: tuple[int, int]) -> Image.Image:
    """Arrange sections of captioned tiles on one page."""
    head = 36
    heights = [head + -(-len(tiles) // columns) * (tile_px[1] + CAPTION) for _, tiles in rows]
    page = Image.new("RGB", (GAP + columns * (tile_px[0] + GAP), sum(heights) + GAP), PAPER)
    draw, top = ImageDraw.Draw(page), 0
    for (title, tiles), height in zip(rows, heights, strict=True):
        draw.text((GAP, top + 8), title, fill=INK, font=font(20))
        for i, (caption, picture) in enumerate(tiles):
            x, y = GAP + (i % columns) * (tile_px[0] + GAP), top + head + (i // columns) * (tile_px[1] + CAPTION)
            page.paste(picture, (x, y))
            draw.text((x, y + tile_px[1] + 4), caption, fill=GREY, font=font(15))
        top += height
    return page


def effects(folder: Path) -> None:
    """Make one tile per effect."""
    indoor_map(folder / "room.exr")
    rows = []
    for section, tiles in yaml.safe_load((HERE / "tiles.yaml").read_text(encoding="utf-8")).items():
        done = []
        for i, asked in enumerate(tiles):
            (image,) = render(_study(asked["keys"], asked.get("zoom", 1)), folder, f"{section}_{i}")
            done.append((asked["title"], tile(image)))
        rows.append((section, done))
    sheet(rows, 4, TILE).save(HERE / "effects.jpg", quality=88, optimize=True)


def presets(folder: Path) -> None:
    """Render four frames of each preset."""
    rows = []
    for preset in preset_names():
        study = {"schema": 1, "name": preset, "seed": 5, "preset": preset, "frames": 4}
        study |= {"marker": {"kind": "disc", "diameter_m": 0.08}, "render": {"radiance": False}}
        images = render(study, folder, preset)
        rows.append((preset, [(f"frame {i}", tile(image, (400, 300))) for i, image in enumerate(images)]))
    sheet(rows, 4, (400, 300)).save(HERE / "presets.jpg", quality=88, optimize=True)


def render(study: dict[str, Any], folder: Path, name: str) -> list[NDArray[Any]]:
    """Render a study given as a dictionary and return its images."""
    path, began = folder / f"{name}.yaml", time.perf_counter()
    path.write_text(yaml.safe_dump(study), encoding="utf-8")
    dataset = render_study(path, folder / name)
    assert dataset is not None
    sys.stderr.write(f"{name}: {time.perf_counter() - began:.1f} s\n")
    return [image for _, image in dataset.images]


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        for sheet_name in sys.argv[1:] or ["effects", "presets"]:
            {"effects": effects, "presets": presets}[sheet_name](Path(name))
