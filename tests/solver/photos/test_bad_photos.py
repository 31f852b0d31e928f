"""Defects that fuzzing found in the reading of photographs (fuzz/README.md), one test each."""

from __future__ import annotations

import io
import struct

import numpy as np
import pytest
from PIL import Image

from roundel.scenes.errors import DataError
from roundel.solver.intrinsics.exif import ExifTags, focal_of_exif, read_exif
from roundel.solver.methods.roundel_fits import detect_circles
from roundel.solver.photos.photo_file import read_photo


def test_real_numbers_beyond_all_light(tmp_path):
    levels = np.tile(np.linspace(0.0, 1.0, 40, dtype=np.float32), (30, 1))
    levels[10, 10], levels[20, 20] = -2.8e38, 3.3e38
    path = tmp_path / "photo.tif"
    Image.fromarray(levels).save(path)
    photo = read_photo(path)
    assert photo.grey.min() >= 0.0
    assert photo.grey.max() <= photo.saturation_dn
    assert detect_circles(photo.grey, photo.saturation_dn).detections == []


@pytest.mark.parametrize("size", [(1, 4), (0, 0), (0, 7), (7, 0), (2**31, 1)])
def test_widths_that_are_less_than_a_pixel(size):
    # A rational where a whole number belongs: Pillow would not write it. Three rows end at byte 50.
    rows = [
        struct.pack("<HHII", 0xA002, 5, 1, 50),
        struct.pack("<HHII", 0xA003, 5, 1, 50),
        struct.pack("<HHII", 0xA405, 3, 1, 26),
    ]
    block = struct.pack("<2sHIH", b"II", 42, 8, len(rows)) + b"".join(rows) + struct.pack("<III", 0, *size)
    out = io.BytesIO()
    Image.new("L", (12, 9)).save(out, "JPEG", exif=b"Exif\0\0" + block)
    with Image.open(io.BytesIO(out.getvalue())) as image:
        tags = read_exif(image)
    assert isinstance(tags, ExifTags)
    assert tags.width_px is None or tags.width_px >= 1
    focal = focal_of_exif(tags, 12, 9)
    assert focal or focal.reason


@pytest.mark.parametrize(
    "data",
    [b"", b"\0", b"\xff\xd8\xff", b"II*\0", b"MM\0*\0\0\0\x08", b"\x89PNG\r\n\x1a\n", b"RIFF\0\0\0\0WEBP", b"GIF89a"],
    ids=repr,
)
def test_stumps_of_files(data, tmp_path):
    path = tmp_path / "photo.jpg"
    path.write_bytes(data)
    with pytest.raises(DataError, match=r"^\S[^\n]*photo\.jpg: [^\n]+$"):
        read_photo(path)
