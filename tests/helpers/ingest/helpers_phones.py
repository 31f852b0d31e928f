"""Photographs of the kinds and with the metadata that phones write, all of the same view."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

ORIENTATION, MAKE = 0x0112, 0x010F
EXIF_IFD, FOCAL_35MM, FOCAL_MM, ZOOM, WIDTH, HEIGHT = 0x8769, 0xA405, 0x920A, 0xA404, 0xA002, 0xA003


@dataclass(frozen=True)
class Shot:
    """One file: what it is called and which focal length it should yield (35-mm mm; None: EXIF is not believed)."""

    path: Path
    focal_35mm_mm: float | None
    why_not: str = ""


def tags(width: int, height: int, orientation: int = 1, **exif: Any) -> bytes:
    """A block of EXIF for an image of this size: bytes, because some of Pillow's writers change an `Exif`."""
    block = Image.Exif()
    block[ORIENTATION] = orientation
    block[MAKE] = exif.pop("make", "Apple")
    block.get_ifd(EXIF_IFD).update({WIDTH: width, HEIGHT: height, **{globals()[k]: v for k, v in exif.items()}})
    return block.tobytes()


def stored(upright: NDArray[np.uint8], orientation: int) -> NDArray[np.uint8]:
    """Upright pixels as a file with this orientation tag stores them."""
    from roundel.solver.photos.photo_file import as_stored

    return as_stored(upright, orientation)


def write_shots(folder: Path, upright: NDArray[np.uint8]) -> list[Shot]:
    """All kinds of files: every orientation, every container, every trouble with metadata."""
    import pillow_heif

    shots: list[Shot] = []
    full = {"FOCAL_35MM": 28, "FOCAL_MM": 4.2}
    height, width = upright.shape[:2]

    def save(name: str, pixels: NDArray[np.uint8], exif: bytes | None, expected: Any, **options: Any) -> None:
        focal, why = expected if isinstance(expected, tuple) else (expected, "")
        image, path = Image.fromarray(pixels), folder / name
        keep = {} if exif is None else {"exif": exif}
        if path.suffix.lower() in (".heic", ".heif", ".hif"):
            pillow_heif.from_pillow(image).save(path, quality=95, **keep, **options)
        else:
            image.save(path, **keep, **options)
        shots.append(Shot(path, focal, why))

    for code in range(1, 9):
        turned = stored(upright, code)
        block = tags(turned.shape[1], turned.shape[0], code, **full)
        save(f"jpeg_{code}.jpg", turned, block, 28, quality=95)
        save(f"png_{code}.png", turned, block, 28)
        save(f"webp_{code}.webp", turned, block, 28, lossless=True)
        save(f"avif_{code}.avif", turned, block, 28, quality=95)
        save(f"heic_{code}.HEIC", turned, block, 28)
        save(f"tiff_{code}.tif", turned, block, 28)
    grey = np.asarray(Image.fromarray(upright).convert("L"))
    save("grey.jpg", grey, tags(width, height, **full), 28, quality=95)
    save("grey.heif", grey, None, (None, "has no EXIF"))
    save("hif.hif", upright, tags(width, height, **full), 28)
    save("progressive.jpeg", upright, tags(width, height, **full), 28, quality=95, progressive=True)
    save("stripped.jpg", upright, None, (None, "has no EXIF"), quality=95)
    save("messenger.heic", upright, None, (None, "has no EXIF"))
    save("no_focal.jpg", upright, tags(width, height), (None, "no 35-mm equivalent"), quality=95)
    save("cut.jpg", upright, tags(2 * width, height, **full), (None, "was cut"), quality=95)
    save("cut.heic", upright, tags(2 * width, height, **full), (None, "was cut"))
    save("absurd.jpg", upright, tags(width, height, FOCAL_35MM=60000), (None, "absurd"), quality=95)
    save("contrary.jpg", upright, tags(width, height, FOCAL_35MM=2800, FOCAL_MM=4.2), (None, "contradicts"), quality=95)
    save("zoomed.jpg", upright, tags(width, height, ZOOM=2.0, FOCAL_35MM=28, FOCAL_MM=2.1), 28, quality=95)
    return shots


def write_dng(path: Path, mosaic: NDArray[np.uint16], orientation: int = 1, focal_35mm_mm: int = 28) -> None:
    """A minimal DNG (RGGB, 16 bits, identity colour matrix): a TIFF of two directories, its EXIF in the second."""
    height, width = mosaic.shape
    matrix = b"".join(
        struct.pack("<ii", int(v * 10_000), 10_000) for v in (3.24, -1.54, -0.5, -0.97, 1.88, 0.04, 0.06, -0.2, 1.06)
    )
    entries: list[tuple[int, int, int, bytes]] = [
        (254, 4, 1, struct.pack("<I", 0)),
        (256, 4, 1, struct.pack("<I", width)),
        (257, 4, 1, struct.pack("<I", height)),
        (258, 3, 1, struct.pack("<H", 16)),
        (259, 3, 1, struct.pack("<H", 1)),
        (262, 3, 1, struct.pack("<H", 32803)),
        (271, 2, 6, b"Phone\0"),
        (272, 2, 6, b"Phone\0"),
        (273, 4, 1, b"DATA"),
        (274, 3, 1, struct.pack("<H", orientation)),
        (277, 3, 1, struct.pack("<H", 1)),
        (278, 4, 1, struct.pack("<I", height)),
        (279, 4, 1, struct.pack("<I", 2 * width * height)),
        (33421, 3, 2, struct.pack("<HH", 2, 2)),
        (33422, 1, 4, bytes([0, 1, 1, 2])),
        (34665, 4, 1, b"EXIF"),
        (50706, 1, 4, bytes([1, 4, 0, 0])),
        (50708, 2, 6, b"Phone\0"),
        (50714, 4, 1, struct.pack("<I", 0)),
        (50717, 4, 1, struct.pack("<I", 65535)),
        (50721, 10, 9, matrix),
        (50728, 5, 3, struct.pack("<6I", 1, 1, 1, 1, 1, 1)),
        (50778, 3, 1, struct.pack("<H", 21)),
    ]
    start = 8 + 2 + 12 * len(entries) + 4
    exif = (
        struct.pack("<H", 1)
        + struct.pack("<HHI", FOCAL_35MM, 3, 1)
        + struct.pack("<H2x", focal_35mm_mm)
        + struct.pack("<I", 0)
    )
    extra, where = b"", start + len(exif)
    body = struct.pack("<H", len(entries))
    long_values = sum(len(value) + len(value) % 2 for *_, value in entries if len(value) > 4)
    for tag, kind, count, value in entries:
        if value == b"DATA":
            value = struct.pack("<I", where + long_values)
        elif value == b"EXIF":
            value = struct.pack("<I", start)
        if len(value) > 4:
            place = struct.pack("<I", where + len(extra))
            extra += value + b"\0" * (len(value) % 2)
            value = place
        body += struct.pack("<HHI", tag, kind, count) + value.ljust(4, b"\0")
    path.write_bytes(
        b"II*\0" + struct.pack("<I", 8) + body + struct.pack("<I", 0) + exif + extra + mosaic.astype("<u2").tobytes()
    )
