"""EXIF focal lengths: which are used, with which uncertainty, and that no file content raises."""

from __future__ import annotations

import contextlib
import io
import math
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from roundel.solver.intrinsics.exif import ExifFocal, ExifTags, NoFocal, focal_of_exif, read_exif

PHONE = ExifTags(focal_35mm_mm=26.0, focal_mm=4.25, width_px=4032, height_px=3024, make="Apple")


def written(tags=None, inner=None, size=(64, 48), kind="JPEG"):
    """A file with EXIF, opened again."""
    exif = Image.Exif()
    for tag, value in (tags or {}).items():
        exif[tag] = value
    if inner:
        exif.get_ifd(0x8769).update(inner)
    buffer = io.BytesIO()
    Image.new("RGB", size).save(buffer, kind, exif=exif)
    return Image.open(io.BytesIO(buffer.getvalue()))


def test_a_phones_tags():
    image = written({0x010F: "Apple", 0x0112: 6}, {0xA405: 26, 0x920A: 4.25, 0xA002: 4032, 0xA003: 3024, 0xA404: 1.0})
    assert read_exif(image) == ExifTags(26.0, 4.25, None, 1.0, 4032, 3024, "Apple", 6)


def test_the_35mm_equivalent_is_by_diagonal():
    focal = focal_of_exif(PHONE, 4032, 3024)
    assert isinstance(focal, ExifFocal)
    # 5040 px and 43.267 mm of diagonal.
    assert focal.focal_px == pytest.approx(26.0 * 5040 / math.hypot(36, 24))
    # Rounded to whole millimetres, 1.11 %, and 2 % of modelling.
    assert focal.sigma == pytest.approx(math.hypot(1 / math.sqrt(12) / 26, 0.02))
    assert focal.basis == "EXIF: 26 mm (35-mm equivalent, by diagonal), +- 2.3 %"


def test_turned_and_resized_images_keep_their_angle_of_view():
    whole = focal_of_exif(PHONE, 4032, 3024)
    assert focal_of_exif(PHONE, 3024, 4032) == whole
    half = focal_of_exif(PHONE, 2016, 1512)
    assert half.focal_px == pytest.approx(whole.focal_px / 2)
    assert focal_of_exif(PHONE, 1008, 757)  # rounded on the way


def test_an_image_that_was_cut_has_lost_its_focal_length():
    lost = focal_of_exif(PHONE, 3000, 3000)
    assert not lost
    assert lost.reason == "the image was cut after its EXIF was written (4032x3024 px then)"


def test_wide_images_may_be_cut_from_another_shape():
    wide = focal_of_exif(ExifTags(focal_35mm_mm=26.0), 1920, 1080)
    # Half the way from 16:9's diagonal to that of the 4:3 sensor (1600 / 1468.6), as a logarithm: 4.3 %.
    assert wide.sigma == pytest.approx(math.sqrt((1 / math.sqrt(12) / 26) ** 2 + 0.02**2 + 0.0428**2), rel=1e-3)
    assert "another shape" in wide.basis


def test_sensor_size_gives_finer_digits():
    # 4.25 mm on a sensor 5.6 mm wide: 4032 px / 5.6 mm.
    tags = ExifTags(26.0, 4.25, 4032 / 5.6, 1.0, 4032, 3024)
    focal = focal_of_exif(tags, 2016, 1512)
    assert focal.focal_px == pytest.approx(4.25 / 5.6 * 2016)
    assert focal.sigma == 0.02
    assert "4.25 mm with the sensor's resolution" in focal.basis
    # Alone it serves as well; where it contradicts the equivalent, the equivalent stands.
    assert focal_of_exif(ExifTags(None, 4.25, 4032 / 5.6), 4032, 3024).focal_px == pytest.approx(4.25 / 5.6 * 4032)
    assert "35-mm" in focal_of_exif(ExifTags(26.0, 4.25, 4032 / 8.0), 4032, 3024).basis
    # A sensor of 0.2 mm: the camera mistook the unit.
    assert not focal_of_exif(ExifTags(None, 4.25, 4032 / 0.2), 4032, 3024)


@pytest.mark.parametrize(("unit", "millimetres"), [(2, 25.4), (3, 10.0), (4, 1.0), (5, 0.001), (None, 25.4)])
def test_units_of_the_focal_plane(unit, millimetres):
    inner = {0x920A: 5.0, 0xA20E: 700.0 * millimetres}
    if unit is not None:
        inner[0xA210] = unit
    assert read_exif(written({}, inner)).plane_px_per_mm == pytest.approx(700.0, rel=1e-6)


def test_digital_zoom():
    # An iPhone's 55 mm include its zoom (4:3, 3.99 mm).
    apple = ExifTags(55.0, 3.99, digital_zoom=1.951, make="Apple")
    assert focal_of_exif(apple, 4032, 3024).focal_px == pytest.approx(55 * 5040 / 43.2666, rel=1e-5)
    # Another make: 28 mm at 4.2 mm and a zoom of 2 are 28 or 56 mm; the middle, with a spread that covers both.
    other = focal_of_exif(ExifTags(28.0, 4.2, digital_zoom=2.0, make="Samsung"), 4032, 3024)
    assert other.focal_px == pytest.approx(28 * math.sqrt(2) * 5040 / 43.2666, rel=1e-5)
    assert 0.34 < other.sigma < 0.36
    assert "may or may not include" in other.basis
    # Where one reading would mean a sensor of 2 mm, the other is right.
    sure = focal_of_exif(ExifTags(130.0, 4.2, digital_zoom=5.0, make="Samsung"), 4032, 3024)
    assert sure.focal_px == pytest.approx(130 * 5040 / 43.2666, rel=1e-5)
    assert sure.sigma < 0.03
    # With the sensor's resolution it multiplies.
    plane = focal_of_exif(ExifTags(None, 4.2, 720.0, digital_zoom=2.0), 4032, 3024)
    assert plane.focal_px == pytest.approx(2 * 4.2 * 720)


def test_known_nonsense_is_refused():
    # A capture session of 640x480 on a phone with 3.99 mm once wrote an equivalent of 177 mm.
    bad = focal_of_exif(ExifTags(177.0, 3.99), 480, 640)
    assert bad == NoFocal(
        "its EXIF contradicts itself: 3.99 mm and a 35-mm equivalent of 177 mm would mean a sensor of 0.98 mm"
    )
    for stated in (1.0, 65_535.0):
        assert "absurd" in focal_of_exif(ExifTags(stated), 640, 480).reason
    assert "no 35-mm equivalent" in focal_of_exif(ExifTags(focal_mm=4.2), 640, 480).reason
    assert focal_of_exif(ExifTags(problem="the file has no EXIF"), 640, 480).reason == "the file has no EXIF"


@pytest.mark.parametrize(
    "value",
    [
        0,
        -3,
        "26",
        b"26",
        (),
        (26.0, 27.0),
        IFDRational(26, 0),
        IFDRational(0, 0),
        IFDRational(-1, 3),
        math.nan,
        1e30,
        {},
    ],
)
def test_values_that_are_no_positive_number_are_none(value):
    image = Image.new("RGB", (4, 4))
    image.getexif().get_ifd(0x8769).update({0xA405: value, 0x920A: value, 0xA404: value, 0xA002: value, 0xA20E: value})
    image.getexif().update({0x0112: value, 0x010F: value})
    tags = read_exif(image)
    assert tags.focal_35mm_mm is None
    assert tags.focal_mm is None
    assert tags.plane_px_per_mm is None
    assert tags.width_px is None
    assert (tags.digital_zoom, tags.orientation) == (1.0, 1)
    assert not focal_of_exif(tags, 640, 480)


def test_no_exif_at_all():
    assert read_exif(Image.new("L", (4, 4))).problem == "the file has no EXIF"


def test_a_directory_that_is_not_there():
    # The first directory points behind the end of the block.
    block = b"Exif\0\0II*\0\x08\0\0\0" + struct.pack("<HHHII", 1, 0x8769, 4, 1, 9999) + b"\0\0\0\0"
    buffer = io.BytesIO()
    Image.new("RGB", (8, 8)).save(buffer, "JPEG", exif=block)
    assert not focal_of_exif(read_exif(Image.open(io.BytesIO(buffer.getvalue()))), 8, 8)


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=120))
def test_any_bytes_for_a_block(block):
    image = Image.new("RGB", (8, 8))
    image.info["exif"] = b"Exif\0\0" + block
    tags = read_exif(image)
    assert isinstance(focal_of_exif(tags, 640, 480), (ExifFocal, NoFocal))


def test_damaged_blocks():
    whole = written({0x010F: "Maker", 0x0112: 6}, {0xA405: 26, 0x920A: 4.25, 0xA002: 64, 0xA003: 48}).info["exif"]
    rng = np.random.default_rng(11)
    for i in range(400):
        data = bytearray(whole[: rng.integers(6, len(whole) + 1)] if i % 2 else whole)
        for place in rng.integers(6, max(len(data), 7), 3):
            with contextlib.suppress(IndexError):
                data[place] = rng.integers(0, 256)
        image = Image.new("RGB", (64, 48))
        image.info["exif"] = bytes(data)
        focal = focal_of_exif(read_exif(image), 64, 48)
        assert focal or focal.reason


@settings(max_examples=300, deadline=None)
@given(
    st.floats(1e-9, 1e9) | st.none(),
    st.floats(1e-9, 1e9) | st.none(),
    st.floats(1e-9, 1e9) | st.none(),
    st.floats(1.02, 200.0),
    st.integers(1, 10**9) | st.none(),
    st.integers(1, 10**9) | st.none(),
    st.sampled_from(["", "Apple", "Canon"]),
    st.integers(1, 20_000),
    st.integers(1, 20_000),
)
def test_whatever_the_tags_say(stated, focal_mm, plane, zoom, w, h, make, width, height):
    focal = focal_of_exif(ExifTags(stated, focal_mm, plane, zoom, w, h, make), width, height)
    if focal:
        assert math.isfinite(focal.focal_px)
        assert focal.focal_px > 0
        assert 0.02 <= focal.sigma < 0.6
