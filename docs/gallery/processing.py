"""Make the picture of a camera's processing, glare and aberration: `python docs/gallery/processing.py`.

One frame of a table top, developed in several ways: its radiance is traced once, and once more for the aberration.
"""

from __future__ import annotations

import io
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from PIL import Image, ImageDraw, ImageFont

from roundel.render.backend import DEFAULT_VARIANT, start, variant_of
from roundel.render.sensor.develop import develop
from roundel.render.sensor.encode import jpeg_bytes
from roundel.scenes.study.layers import deep_merge
from roundel.scenes.study.study import load_study
from roundel.scenes.truth.truth import truth_of
from roundel.scenes.world.frame import Frame, frame_of

HERE = Path(__file__).parent
ZOOM, GAP, NAME = 8, 6, 24

BASE: dict[str, Any] = {
    "schema": 1,
    "name": "processing",
    "seed": 5,
    "frames": 1,
    "world": "tabletop",
    "camera": {"width_px": 640, "height_px": 480, "focal_px": 560},
    "marker": {"kind": "disc", "diameter_m": 0.08},
    "pose": {"distance_m": 0.75, "tilt_deg": 40, "azimuth_deg": -90, "offset_x_px": 150, "offset_y_px": 90},
    "sensor": {"mosaic": "rggb", "full_well_e": 1500, "read_noise_e": 4, "curve": "srgb"},
    "render": {"background_error": 0.02},
}

# Whole frames above, the disc's edge below.
WHOLE = {
    "curve: linear": {"sensor": {"curve": "linear"}},
    "curve: srgb": {},
    "isp: phone": {"sensor": {"isp": "phone"}},
    "veiling_glare: 0.1, halo: 0.1": {"camera": {"veiling_glare": 0.1, "halo": 0.1}},
}
EDGES = {
    "curve: srgb": {},
    "isp: phone": {"sensor": {"isp": "phone"}},
    "isp: phone, jpeg_quality: 30": {"sensor": {"isp": "phone", "jpeg_quality": 30}},
    "lateral_ca: [1.006, 0.994]": {"camera": {"lateral_ca": [1.006, 0.994]}},
}


def frame_with(folder: Path, keys: dict[str, Any]) -> Frame:
    """The one frame, with other keys over its own: the same draws and seeds."""
    path = folder / "study.yaml"
    path.write_text(yaml.safe_dump(deep_merge(BASE, keys)), encoding="utf-8")
    return frame_of(load_study(path), 0)


def main() -> None:
    """Render, develop and lay out."""
    traced: dict[tuple[float, ...], Any] = {}

    def picture(keys: dict[str, Any]) -> Image.Image:
        with tempfile.TemporaryDirectory() as folder:
            frame = frame_with(Path(folder), keys)
        lens = frame.camera.magnification
        if lens not in traced:
            mi = start(variant_of(frame, DEFAULT_VARIANT))
            from roundel.render.radiance import render_radiance

            traced[lens] = render_radiance(mi, frame).mean
        image = develop(frame, traced[lens]).image
        quality = frame.settings.sensor.jpeg_quality
        return Image.fromarray(image) if quality is None else Image.open(io.BytesIO(jpeg_bytes(image, quality)))

    with tempfile.TemporaryDirectory() as folder:
        row = truth_of(frame_with(Path(folder), {}))[0]
    side = BASE["camera"]["width_px"] // 2, BASE["camera"]["height_px"] // 2
    width, height = len(WHOLE) * (side[0] + GAP) + GAP, 2 * (side[1] + GAP + NAME) + GAP
    sheet = Image.new("RGB", (width, height), (255, 255, 255))
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(15)
    crop = np.array(side) // ZOOM
    x, y = np.round([row["ellipse_x_px"] + row["ellipse_a_px"], row["ellipse_y_px"]] - crop / 2).astype(int).tolist()
    for line, (tiles, zooms) in enumerate(((WHOLE, False), (EDGES, True))):
        top = GAP + line * (side[1] + GAP + NAME)
        for column, (title, keys) in enumerate(tiles.items()):
            left, tile = GAP + column * (side[0] + GAP), picture(keys)
            if zooms:
                tile = tile.crop((x, y, x + int(crop[0]), y + int(crop[1]))).resize(side, Image.Resampling.NEAREST)
            else:
                tile = tile.resize(side, Image.Resampling.LANCZOS)
            draw.text((left, top - 3), title, font=font, fill=(20, 20, 20))
            sheet.paste(tile, (left, top + NAME - GAP))
    sheet.save(HERE / "processing.jpg", quality=92, subsampling=0, optimize=True)


if __name__ == "__main__":
    main()
