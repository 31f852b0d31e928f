"""Photographs as files: every depth, colour and orientation gives the same light; damage gives one line."""

from __future__ import annotations

import contextlib
import io
import struct
import zlib

import cv2
import numpy as np
import pytest
from PIL import Image

from roundel.scenes.camera.response_curve import LINEAR
from roundel.scenes.errors import DataError
from roundel.solver.photos.photo_file import MAX_PIXELS, read_photo

RNG = np.random.default_rng(4)
# Smooth, so that JPEG and WebP keep it; no symmetry, so that every orientation differs.
Y, X = np.mgrid[:48, :64]
RAMP = (20 + 2.5 * X + 1.2 * Y).astype(np.uint8)
COLOUR = np.stack([RAMP, 255 - RAMP, RAMP // 2], axis=-1)


def srgb_to_light(level):
    return np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4)


def light_of(colour):
    """Luminance of 8-bit colours, 0 to 255."""
    return 255 * srgb_to_light(colour / 255.0) @ np.array([0.2126, 0.7152, 0.0722])


def saved(tmp_path, image, name, **options):
    image.save(tmp_path / name, **options)
    return tmp_path / name


def test_grey_is_linear_light(tmp_path):
    photo = read_photo(saved(tmp_path, Image.fromarray(RAMP), "a.png"))
    assert photo.grey.dtype == np.float32
    assert photo.saturation_dn == 255.0
    # A float32 has 24 bits: 255 to 1e-5.
    assert np.allclose(photo.grey, 255 * srgb_to_light(RAMP / 255.0), atol=2e-5)
    assert np.array_equal(photo.picture, np.repeat(RAMP[..., None], 3, axis=2))
    assert (photo.width_px, photo.height_px) == (64, 48)


def test_linear_files_stay_as_they_are(tmp_path):
    assert np.allclose(read_photo(saved(tmp_path, Image.fromarray(RAMP), "a.png"), LINEAR).grey, RAMP, atol=1e-4)


@pytest.mark.parametrize("name", ["a.png", "a.tif", "a.bmp", "a.webp", "a.ppm", "a.jp2"])
def test_colour_by_any_format(tmp_path, name):
    options = {"lossless": True} if name == "a.webp" else {}
    photo = read_photo(saved(tmp_path, Image.fromarray(COLOUR), name, **options))
    assert np.allclose(photo.grey, light_of(COLOUR), atol=1e-4)
    assert np.array_equal(photo.picture, COLOUR)


def test_jpeg_and_cmyk(tmp_path):
    for mode in ("RGB", "CMYK", "YCbCr", "L"):
        image = Image.fromarray(COLOUR).convert(mode)
        photo = read_photo(saved(tmp_path, image, "a.jpg", quality=100, subsampling=0))
        # JPEG at its best rounds each channel by a step or two.
        assert np.max(np.abs(photo.picture.astype(int) - np.asarray(image.convert("RGB")))) <= 4


def test_palette_transparency_and_one_bit(tmp_path):
    palette = Image.fromarray(RAMP // 32 * 32).convert("P")
    assert np.array_equal(read_photo(saved(tmp_path, palette, "p.png")).picture, np.asarray(palette.convert("RGB")))
    assert np.array_equal(read_photo(saved(tmp_path, palette, "p.gif")).picture, np.asarray(palette.convert("RGB")))
    alpha = np.zeros((48, 64), dtype=np.uint8)
    alpha[:, 32:] = 255
    seen = read_photo(saved(tmp_path, Image.fromarray(np.dstack([COLOUR, alpha])), "t.png")).picture
    assert np.all(seen[:, :32] == 255)  # white paper shows through
    assert np.array_equal(seen[:, 32:], COLOUR[:, 32:])
    grey = Image.fromarray(np.dstack([RAMP, alpha]), mode=None)
    assert np.all(read_photo(saved(tmp_path, grey, "la.png")).picture[:, :32] == 255)
    bits = Image.fromarray(RAMP > 100)
    assert bits.mode == "1"
    assert np.array_equal(read_photo(saved(tmp_path, bits, "b.png")).picture[..., 0], 255 * (RAMP > 100))


@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_sixteen_bits(tmp_path, suffix):
    deep = RNG.integers(0, 65536, (48, 64, 3), dtype=np.uint16)
    path = tmp_path / f"c.{suffix}"
    cv2.imwrite(str(path), deep[..., ::-1])
    photo = read_photo(path, LINEAR)
    assert photo.saturation_dn == 65535.0
    # All 16 bits: float32 keeps them to 0.01.
    assert np.allclose(photo.grey, deep @ np.array([0.2126, 0.7152, 0.0722]), atol=0.02)
    assert np.array_equal(photo.picture, deep >> 8)
    cv2.imwrite(str(path), deep[..., 0])
    assert np.allclose(read_photo(path, LINEAR).grey, deep[..., 0], atol=0.01)
    assert np.allclose(read_photo(path).grey, 65535 * srgb_to_light(deep[..., 0] / 65535.0), atol=0.02)


def test_sixteen_bits_upright(tmp_path):
    # A TIFF with an orientation tag is turned by Pillow and by OpenCV, each in its own way.
    deep = RNG.integers(0, 65536, (48, 64, 3), dtype=np.uint16)
    for code in range(1, 9):
        path = tmp_path / f"{code}.tif"
        cv2.imwrite(str(path), deep[..., ::-1], [cv2.IMWRITE_TIFF_COMPRESSION, 1])
        data = bytearray(path.read_bytes())
        assert data[:2] == b"II"
        (start,) = struct.unpack("<I", data[4:8])
        (count,) = struct.unpack("<H", data[start : start + 2])
        entries = [bytes(data[start + 2 + 12 * i : start + 14 + 12 * i]) for i in range(count)]
        entries = [e for e in entries if struct.unpack("<H", e[:2])[0] != 274]
        entries = sorted([*entries, struct.pack("<HHII", 274, 3, 1, code)], key=lambda e: struct.unpack("<H", e[:2])[0])
        place = len(data)
        data += struct.pack("<H", len(entries)) + b"".join(entries) + b"\0\0\0\0"
        data[4:8] = struct.pack("<I", place)
        path.write_bytes(data)
        photo = read_photo(path, LINEAR)
        assert photo.saturation_dn == 65535.0, code
        assert np.array_equal(photo.picture, turned(deep >> 8, code)), code


def turned(array, code):
    """What the eight orientations mean, by the words of the EXIF standard: where row 0 and column 0 are shown."""
    quarter = {5: np.rot90(array[:, ::-1], 1), 6: np.rot90(array, -1), 7: np.rot90(array[:, ::-1], -1)}
    whole = {1: array, 2: array[:, ::-1], 3: array[::-1, ::-1], 4: array[::-1], 8: np.rot90(array, 1)}
    return {**quarter, **whole}[code]


@pytest.mark.parametrize("code", range(1, 9))
def test_orientation_is_honoured(tmp_path, code):
    tags = Image.Exif()
    tags[0x0112] = code
    for name in ("a.png", "a.webp", "a.tif"):
        options = {"lossless": True} if name == "a.webp" else {}
        photo = read_photo(saved(tmp_path, Image.fromarray(COLOUR), name, exif=tags, **options))
        assert np.array_equal(photo.picture, turned(COLOUR, code)), name
    photo = read_photo(saved(tmp_path, Image.fromarray(COLOUR), "a.jpg", exif=tags, quality=100, subsampling=0))
    assert np.max(np.abs(photo.picture.astype(int) - turned(COLOUR, code))) <= 4


def test_real_numbers_are_light(tmp_path):
    light = (RAMP / 255.0).astype(np.float32)
    photo = read_photo(saved(tmp_path, Image.fromarray(light), "f.tif"))
    assert photo.saturation_dn == 1.0
    assert np.array_equal(photo.grey, light)
    light[3, 5] = np.nan
    with pytest.raises(DataError, match="not finite"):
        read_photo(saved(tmp_path, Image.fromarray(light), "f.tif"))


def test_pillows_guard_is_replaced_and_put_back(tmp_path, monkeypatch):
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 100)
    assert read_photo(saved(tmp_path, Image.fromarray(RAMP), "a.png")).width_px == 64
    assert Image.MAX_IMAGE_PIXELS == 100


@pytest.mark.slow
def test_a_hundred_megapixels(tmp_path):
    # Pillow warns at 89 megapixels and refuses at 179; warnings are errors here.
    path = saved(tmp_path, Image.new("1", (10_000, 10_000), 1), "big.png")
    photo = read_photo(path)
    assert photo.grey.shape == (10_000, 10_000)


def test_more_than_the_limit_is_refused_before_it_is_decoded(tmp_path):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", 60_000, 60_000, 8, 0, 0, 0, 0)
    file = tmp_path / "bomb.png"
    file.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", b"") + chunk(b"IEND", b""))
    with pytest.raises(DataError, match=f"bomb.png: 60000x60000 px .* the limit is {MAX_PIXELS // 10**6}"):
        read_photo(file)


def bytes_of(image, kind, **options):
    buffer = io.BytesIO()
    image.save(buffer, kind, **options)
    return buffer.getvalue()


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "TIFF", "WEBP", "BMP", "JPEG2000", "GIF"])
def test_cut_short(tmp_path, kind, capfd):
    whole = bytes_of(Image.fromarray(RNG.integers(0, 256, (48, 64, 3), dtype=np.uint8)), kind)
    for part in (8, 40, len(whole) // 2):
        file = tmp_path / "cut"
        file.write_bytes(whole[:part])
        with pytest.raises(DataError, match="cut: ") as caught:
            read_photo(file)
        assert "\n" not in str(caught.value)
    assert capfd.readouterr().err == ""  # nor from the libraries written in C


def test_cut_short_with_sixteen_bits(tmp_path, capfd):
    path = tmp_path / "deep.png"
    for suffix in ("png", "tiff"):
        data = cv2.imencode(f".{suffix}", RNG.integers(0, 65536, (48, 64, 3), dtype=np.uint16))[1].tobytes()
        path.write_bytes(data[: len(data) // 2])
        with pytest.raises(DataError, match="truncated"):
            read_photo(path)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    ("name", "data", "says"),
    [
        ("a.jpg", b"", "this file is empty"),
        ("a.jpg", b"hello, this is no image at all", "not an image"),
        ("a.jpg", b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n", "not an image"),
        ("a.heic", b"\0\0\0\x18ftypheic\0\0\0\0mif1heic", "a.heic: this image is truncated or corrupt"),
        ("a.CR2", b"II*\0rest", "a.CR2: this raw file is not supported, truncated or corrupt"),
        ("a.tif", b"II*\0\x08\0\0\0\xff\xff", "a.tif: "),
        ("a.png", b"\x89PNG\r\n\x1a\n" + b"\0" * 40, "a.png: "),
    ],
)
def test_what_is_no_photograph(tmp_path, name, data, says, capfd):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(DataError, match=says) as caught:
        read_photo(tmp_path / name)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr().err == ""


def test_missing_files_and_folders(tmp_path):
    with pytest.raises(DataError, match=r"none\.jpg: cannot read: No such file"):
        read_photo(tmp_path / "none.jpg")
    with pytest.raises(DataError, match="it is a folder"):
        read_photo(tmp_path)


def test_bits_flipped_anywhere(tmp_path):
    # Every damage is a DataError or an image; nothing else comes through.
    for kind in ("JPEG", "PNG", "TIFF", "WEBP"):
        whole = bytes_of(Image.fromarray(COLOUR), kind, exif=Image.Exif())
        for _ in range(60):
            data = bytearray(whole)
            for place in RNG.integers(0, len(data), 3):
                data[place] ^= 1 << RNG.integers(0, 8)
            (tmp_path / "x").write_bytes(data)
            with contextlib.suppress(DataError):
                assert read_photo(tmp_path / "x").grey.ndim == 2
