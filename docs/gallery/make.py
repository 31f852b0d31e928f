"""Make the contact sheets of the gallery: `python docs/gallery/make.py`. Every picture is rendered by Roundel.

One tile an effect, with what was asked for beside its name; the presets with several frames each.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from roundel.render.run import render_study
from roundel.scenes.layers import laid_over, preset_names

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


# Title, what was asked for (shown), and the keys laid over BASE. A tile of zoom 2 or 3 is rendered smaller and enlarged.
TILES: dict[str, list[tuple[str, str, int]]] = {
    "Lens": [
        ("pinhole", "camera: {}", 1),
        ("barrel distortion", "camera: {distortion: [-0.6, 0.3, 0, 0]}", 1),
        ("rational, 8 coefficients", "camera: {distortion: [0.5, 0.1, 0.002, 0, 0, 0.2, 0, 0]}", 1),
        (
            "fisheye",
            "camera: {focal_px: 150, distortion_model: fisheye, distortion: [-0.02, 0, 0, 0]}\npose: {distance_m: 0.2}",
            1,
        ),
        ("defocus", "camera: {aperture_mm: 16, focus_m: 0.3}", 1),
        (
            "five blades, far out of focus",
            "camera: {aperture_mm: 40, focus_m: 0.25, blades: 5}\nmarker: {inverted: true}",
            1,
        ),
        ("diffraction", "camera: {focal_px: 160, aperture_mm: 0.12, focus_m: 0.5, diffraction: true}", 3),
        (
            "cos^4 and a barrel",
            "camera: {focal_px: 200, aperture_mm: 10, focus_m: 0.5, natural_vignetting: true, barrel_mm: 12, barrel_length_mm: 10}",
            1,
        ),
    ],
    "Time": [
        ("camera turns, 20 ms", "motion: {exposure_s: 0.02, camera: {rate_deg_s: [0, 60, 0]}}", 1),
        (
            "marker spins, 30 ms",
            "motion: {exposure_s: 0.03, marker: {rate_deg_s: [0, 0, 700]}}\nmarker: {kind: dot_ring, diameter_m: 0.02, ring_diameter_m: 0.1, dots: 7}",
            1,
        ),
        ("rolling shutter", "motion: {exposure_s: 0.001, readout_s: 0.04, camera: {velocity_m_s: [2, 0, 0]}}", 1),
        (
            "rolling shutter, rotation",
            "motion: {exposure_s: 0.004, readout_s: 0.04, camera: {rate_deg_s: [0, 0, 400]}}",
            1,
        ),
    ],
    "Light": [
        ("one area lamp", "light: {environment: 0.05}", 1),
        (
            "spot",
            "light: {environment: 0.1, lamps: [{kind: spot, position_m: [0.2, -0.4, 0], intensity: 1, cutoff_deg: 9, beam_deg: 5}]}",
            1,
        ),
        (
            "hard shadow",
            "light: {environment: 0.3, lamps: [{kind: point, position_m: [-0.3, -0.4, 0.1], intensity: 0.8}]}\noccluders: [{x_m: -0.06, y_m: 0.06, z_m: 0.1, width_m: 0.06, height_m: 0.03, turn_deg: 20}]",
            1,
        ),
        (
            "soft shadow",
            "occluders: [{x_m: -0.08, y_m: 0.10, z_m: 0.12, width_m: 0.08, height_m: 0.04, turn_deg: 20}]",
            1,
        ),
        (
            "sun and sky",
            "light: {sky: {sun_elevation_deg: 30, sun_azimuth_deg: 150}, lamps: []}\nsensor: {mosaic: rggb, curve: srgb}\noccluders: [{x_m: -0.06, y_m: 0.08, z_m: 0.1, width_m: 0.05, height_m: 0.02}]",
            1,
        ),
        (
            "environment map",
            "light: {map: {file: room.exr}, lamps: []}\nmarker: {surface: {kind: plastic, roughness: 0.05}}\nsensor: {mosaic: rggb, curve: srgb}",
            1,
        ),
        (
            "coloured lamps",
            "light: {environment: 0.2, environment_colour: [0.6, 0.8, 1.4], lamps: [{position_m: [-0.5, -0.7, -0.1], size_m: 0.25, radiance: 10, colour: [1.4, 1.0, 0.5]}]}\nsensor: {mosaic: rggb, curve: srgb, white_balance: none}",
            1,
        ),
        (
            "laminate under a lamp",
            "marker: {surface: {kind: laminate, roughness: 0.12}}\npose: {tilt_deg: 25, azimuth_deg: -125}\nlight: {environment: 0.2, lamps: [{position_m: [-0.35, -0.5, 0.1], size_m: 0.08, radiance: 60}]}",
            1,
        ),
    ],
    "Matter": [
        ("grain", "camera: {focal_px: 160}\nmarker: {grain: 0.08, grain_m: 0.002}\npose: {distance_m: 0.3}", 2),
        ("soft print edges", "camera: {focal_px: 160}\nmarker: {edge_softness_m: 0.006}", 2),
        ("inverted", "marker: {inverted: true}", 1),
        ("clutter", "marker: {clutter: {cell_m: 0.03, contrast: 0.4}}\npose: {distance_m: 0.9}", 1),
        ("occlusion", "occluders: [{x_m: 0.04, y_m: 0.0, z_m: 0.01, width_m: 0.03, height_m: 0.12, turn_deg: 10}]", 1),
        (
            "plastic",
            "marker: {surface: {kind: plastic, roughness: 0.2}}\npose: {tilt_deg: 25, azimuth_deg: -125}\nlight: {environment: 0.2, lamps: [{position_m: [-0.35, -0.5, 0.1], size_m: 0.08, radiance: 60}]}",
            1,
        ),
    ],
    "Sensor": [
        ("shot and read noise", "camera: {focal_px: 160}\nsensor: {full_well_e: 200, read_noise_e: 6}", 2),
        ("fixed pattern (PRNU, DSNU)", "camera: {focal_px: 160}\nsensor: {prnu: 0.08, dsnu_e: 300}", 2),
        ("saturation", "sensor: {white_level: 1.6}", 1),
        (
            "raw Bayer mosaic",
            "camera: {focal_px: 160}\nsensor: {mosaic: rggb, deliver: raw}\nlight: {environment_colour: [1.4, 1.0, 0.6]}",
            3,
        ),
        ("JPEG, quality 15", "camera: {focal_px: 160}\nsensor: {jpeg_quality: 15}", 2),
        ("sRGB curve", "sensor: {curve: srgb}", 1),
    ],
    "Markers": [
        ("ring", "marker: {kind: ring, inner_diameter_m: 0.05}", 1),
        ("disc with tick", "marker: {kind: disc_with_tick}", 1),
        ("concentric rings", "marker: {kind: rings, diameters_m: [0.1, 0.085, 0.06, 0.045, 0.02]}", 1),
        ("two discs", "marker: {kind: two_discs, diameter_m: 0.06, second_diameter_m: 0.04, spacing_m: 0.08}", 1),
        ("ring of dots", "marker: {kind: dot_ring, diameter_m: 0.02, ring_diameter_m: 0.1, dots: 9}", 1),
        ("chessboard", "marker: {kind: chessboard, columns: 6, rows: 5, square_m: 0.025}", 1),
        (
            "disc with chessboard",
            "marker: {kind: disc_with_chessboard, diameter_m: 0.07, gap_m: 0.02, chessboard: {columns: 4, rows: 3, square_m: 0.015}}",
            1,
        ),
        ("ChArUco", "marker: {kind: charuco, columns: 6, rows: 5, square_m: 0.025, tag_m: 0.019}", 1),
        ("ArUco", "marker: {kind: tags, columns: 3, rows: 2, tag_m: 0.04, gap_m: 0.01, family: aruco_6x6_250}", 1),
        ("AprilTag", "marker: {kind: tags, tag_m: 0.1, family: apriltag_36h11, first_id: 7}", 1),
    ],
}


def _study(keys: str, zoom: int) -> dict[str, Any]:
    study = yaml.safe_load(BASE)
    own = yaml.safe_load(keys)
    kind = own.get("marker", {}).get("kind")
    if kind in ("ring", "disc_with_tick"):
        own["marker"]["diameter_m"] = 0.08
    size = {"width_px": TILE[0] // zoom, "height_px": TILE[1] // zoom}
    merged: dict[str, Any] = laid_over(laid_over(study, {"camera": size}), own)
    return merged


def render(study: dict[str, Any], folder: Path, name: str) -> list[NDArray[Any]]:
    """The images of a study given as plain values."""
    path = folder / f"{name}.yaml"
    path.write_text(yaml.safe_dump(study), encoding="utf-8")
    dataset = render_study(path, folder / name)
    assert dataset is not None
    return [image for _, image in dataset.images]


def tile(image: NDArray[Any], size: tuple[int, int] = TILE) -> Image.Image:
    """An image as a tile: enlarged without smoothing, or reduced with."""
    grey = image if image.dtype == np.uint8 else (image >> 8).astype(np.uint8)
    picture = Image.fromarray(grey).convert("RGB")
    enlarged = picture.width < size[0]
    return picture.resize(size, Image.Resampling.NEAREST if enlarged else Image.Resampling.LANCZOS)


def font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Pillow's own face."""
    return ImageFont.load_default(size)


def sheet(rows: list[tuple[str, list[tuple[str, Image.Image]]]], columns: int, tile_px: tuple[int, int]) -> Image.Image:
    """Sections of captioned tiles on one page."""
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


def main() -> None:
    """Render and paste."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        indoor_map(folder / "room.exr")
        rows = []
        for section, tiles in TILES.items():
            done = []
            for i, (title, keys, zoom) in enumerate(tiles):
                (image,) = render(_study(keys, zoom), folder, f"{section}_{i}")
                done.append((title, tile(image)))
            rows.append((section, done))
        sheet(rows, 4, TILE).save(HERE / "effects.jpg", quality=88, optimize=True)
        rows = []
        for preset in preset_names():
            study = {"schema": 1, "name": preset, "seed": 5, "preset": preset, "frames": 4}
            study |= {"marker": {"kind": "disc", "diameter_m": 0.08}, "render": {"radiance": False}}
            images = render(study, folder, preset)
            wide = [(f"frame {i}", tile(image, (400, 300))) for i, image in enumerate(images)]
            rows.append((preset, wide))
        sheet(rows, 4, (400, 300)).save(HERE / "presets.jpg", quality=88, optimize=True)


if __name__ == "__main__":
    main()
