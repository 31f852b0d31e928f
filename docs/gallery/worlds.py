"""Make the contact sheet of the worlds: `python docs/gallery/worlds.py DATASET`, a dataset of configs/worlds.yaml."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from roundel.datasets.layout.images import open_images

HERE = Path(__file__).parent
TILE, GAP, NAME = (360, 270), 6, 26
FRAMES = 4


def main(dataset: str) -> None:
    """A row a world, four frames each."""
    images = open_images(dataset)
    worlds = [name for name in dict.fromkeys(images.groups) if name != "plain"]
    width = FRAMES * (TILE[0] + GAP) + GAP
    sheet = Image.new("RGB", (width, len(worlds) * (TILE[1] + GAP + NAME) + GAP), (255, 255, 255))
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(17)
    for row, world in enumerate(worlds):
        top = GAP + row * (TILE[1] + GAP + NAME)
        draw.text((GAP, top), world, font=font, fill=(20, 20, 20))
        for column, i in enumerate(np.flatnonzero(np.array(images.groups) == world)[:FRAMES]):
            tile = Image.fromarray(images.image(int(i))).convert("RGB").resize(TILE, Image.Resampling.LANCZOS)
            sheet.paste(tile, (GAP + column * (TILE[0] + GAP), top + NAME))
    sheet.save(HERE / "worlds.jpg", quality=88, optimize=True)


if __name__ == "__main__":
    main(sys.argv[1])
