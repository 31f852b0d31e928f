"""The page of a preview, and its contact sheet as one picture."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.render.preview.frame_facts import FrameFacts
from roundel.render.preview.group_facts import GroupFacts
from roundel.scenes.display_text import NAME_LIMIT, TEXT_LIMIT, clean

# A marker smaller than this in its tile is framed, so that it is found.
_SMALL_PX = 24
_FRAME = (255, 140, 0)
_COLUMNS, _GAP_PX, _CAPTION_PX, _FONT_PX = 4, 8, 36, 13
_PAPER, _INK, _SOFT = (246, 247, 249), (27, 33, 41), (86, 97, 109)


@dataclass(frozen=True, eq=False)
class Tile:
    """One frame of the sheet: its picture (h, w, 3) in 8 bits, and its facts."""

    picture: NDArray[np.uint8]
    facts: FrameFacts

    @property
    def title(self) -> str:
        """Group and frame."""
        return f"{self.facts.frame.group}, frame {self.facts.frame.frame_id}"

    def marked(self) -> NDArray[np.uint8]:
        """The picture, with a frame around each marker that is hard to see."""
        from PIL import Image, ImageDraw

        image = Image.fromarray(self.picture)
        draw = ImageDraw.Draw(image)
        scale = image.width / self.facts.frame.camera.width_px
        for marker in self.facts.markers:
            if 0 < marker.size_px * scale < _SMALL_PX:
                outline = (marker.outline_px + 0.5) * scale
                low, high = outline.min(axis=0) - 6, outline.max(axis=0) + 6
                draw.rectangle([*low, *high], outline=_FRAME)
        return np.asarray(image)


def points_picture(facts: FrameFacts, side_px: int) -> NDArray[np.uint8]:
    """For a group without images: the outlines of its markers, dark on white."""
    from PIL import Image, ImageDraw

    camera = facts.frame.camera
    scale = min(1.0, side_px / max(camera.width_px, camera.height_px))
    image = Image.new("RGB", (max(8, round(scale * camera.width_px)), max(8, round(scale * camera.height_px))), "white")
    draw = ImageDraw.Draw(image)
    for marker in facts.markers:
        outline = [(float(x), float(y)) for x, y in (marker.outline_px + 0.5) * scale]
        if len(outline) > 1:
            draw.line([*outline, outline[0]], fill=_INK, width=1)
    return np.asarray(image)


def contact_sheet(tiles: Sequence[Tile]) -> bytes:
    """All tiles in one PNG: group and frame above, size, distance and tilt of the marker below the picture."""
    from PIL import Image, ImageDraw, ImageFont

    columns = min(_COLUMNS, len(tiles))
    width = max(tile.picture.shape[1] for tile in tiles)
    height = max(tile.picture.shape[0] for tile in tiles) + _CAPTION_PX
    rows = math.ceil(len(tiles) / columns)
    size = columns * (width + _GAP_PX) + _GAP_PX, rows * (height + _GAP_PX) + _GAP_PX
    image, font = Image.new("RGB", size, _PAPER), ImageFont.load_default(_FONT_PX)
    draw = ImageDraw.Draw(image)
    for i, tile in enumerate(tiles):
        row, column = divmod(i, columns)
        x, y = _GAP_PX + column * (width + _GAP_PX), _GAP_PX + row * (height + _GAP_PX)
        image.paste(Image.fromarray(tile.marked()), (x, y))
        below = y + tile.picture.shape[0] + 2
        draw.text((x, below), clean(tile.title, NAME_LIMIT), font=font, fill=_INK)
        draw.text((x, below + 16), tile.facts.caption, font=font, fill=_SOFT)
    sink = io.BytesIO()
    image.save(sink, "PNG")
    return sink.getvalue()


def preview_page(name: str, groups: Sequence[GroupFacts], tiles: Sequence[Tile], warnings: Sequence[str]) -> bytes:
    """The page: no script, nothing from a network."""
    from jinja2 import Environment, StrictUndefined
    from markupsafe import Markup

    room = resources.files("roundel.render.preview")
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters["name"] = lambda text: clean(str(text), NAME_LIMIT)
    environment.filters["text"] = lambda text: clean(str(text), TEXT_LIMIT)
    page = environment.from_string((room / "preview.html.j2").read_text(encoding="utf-8")).render(
        css=Markup((room / "preview.css").read_text(encoding="utf-8")),
        name=name,
        frames=sum(group.frames for group in groups),
        groups=[_shown(group, tiles) for group in groups],
        warnings=warnings,
    )
    return (page.strip() + "\n").encode()


def _shown(group: GroupFacts, tiles: Sequence[Tile]) -> dict[str, Any]:
    own = [tile for tile in tiles if tile.facts.frame.group == group.name]
    pictures = [
        {"id": tile.facts.frame.frame_id, "caption": tile.facts.caption, "picture": _data_url(tile)} for tile in own
    ]
    return {"facts": group, "pictures": pictures}


def _data_url(tile: Tile) -> str:
    from PIL import Image

    sink = io.BytesIO()
    Image.fromarray(tile.marked()).save(sink, "JPEG", quality=88)
    return f"data:image/jpeg;base64,{base64.b64encode(sink.getvalue()).decode()}"
