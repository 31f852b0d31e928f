"""Make the pictures and the table of docs/worlds.md: `python docs/worlds/worlds.py OUT`.

OUT contains the folder `worlds`, written by `roundel run worlds OUT/worlds`.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from scored import columns, ellipses, false_positives, group_table, in_a_row, patch, put

from roundel.datasets.dataset import open_dataset
from roundel.datasets.layout.images import open_images

HERE = Path(__file__).parent
PAGE = HERE.parent / "worlds.md"
TILE, GAP, NAME = (360, 270), 6, 26
FRAMES = 4


def contact_sheet(dataset: Path) -> Image.Image:
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
    return sheet


def worst(out: Path, scores: dict[str, Any]) -> Image.Image:
    """The marker with the largest error of the normal in each world, by the pixel fit."""
    dataset = open_dataset(out / "worlds" / "dataset")
    truth = {(row["frame_id"], row["marker_id"]): row for row in dataset.truth.to_pylist()}
    fitted = ellipses(out, "worlds", "pixels")
    tiles = []
    for world in dict.fromkeys(scores["group"]):
        rows = np.flatnonzero((scores["method"] == "pixels") & (scores["group"] == world))
        error = scores["oracle_normal_error_deg"][rows]
        i = rows[int(np.nanargmax(error))]
        key = int(scores["frame_id"][i]), int(scores["marker_id"][i])
        tile = patch(dataset, truth[key], fitted.get(key[0])).resize((256, 256), Image.Resampling.LANCZOS)
        tiles.append((f"{world}: {np.nanmax(error):.2g} deg", tile))
    return in_a_row(tiles)


def main(out: Path) -> None:
    """Write the pictures next to this script, and the table into the page."""
    scores = columns(out, "worlds")
    contact_sheet(out / "worlds" / "dataset").save(HERE / "worlds.jpg", quality=88, optimize=True)
    worst(out, scores).save(HERE / "worst.jpg", quality=88, optimize=True)
    put(PAGE, "worlds", group_table(scores, false_positives(out, "worlds", scores)))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
