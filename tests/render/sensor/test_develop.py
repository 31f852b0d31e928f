"""From radiance to the delivered image: exposure, colours, curves, files, flags."""

import io
from pathlib import Path

import numpy as np
import pytest
from helpers_studies import small_study
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from roundel.datasets.flags import count_flags, frame_flags, marker_flags, warning_of
from roundel.datasets.layout.files import image_name
from roundel.datasets.layout.images import read_image
from roundel.render.run import render_study
from roundel.render.sensor.curve import delivered, delivered_levels, encoded
from roundel.render.sensor.data_sheet import data_sheet
from roundel.render.sensor.demosaic import demosaic, filters
from roundel.render.sensor.develop import develop
from roundel.render.sensor.encode import jpeg_bytes, png_bytes
from roundel.render.sensor.exposure import balance_of, exposure_of, sheet_pixels, whites
from roundel.render.sensor.photometry import edge_photometry, noise_dn
from roundel.scenes.study.sensor_section import SensorSection
from roundel.scenes.world.frame import Frame, frame_of

MOSAICS = ("rggb", "bggr", "grbg", "gbrg")


def frame_with(folder: Path, sensor: str = "{}") -> Frame:
    return frame_of(small_study(folder, ("frames: 4", f"frames: 4\nsensor: {sensor}")), 0)


def half(frame: Frame, level: float = 1.0) -> np.ndarray:
    """Radiance: `level` on the left, half of it on the right."""
    out = np.full((frame.camera.height_px, frame.camera.width_px), level, dtype=np.float32)
    out[:, frame.camera.width_px // 2 :] /= 2
    return out


def test_auto_exposure_puts_the_brightest_white_where_it_is_asked() -> None:
    sensor = SensorSection(white_level=0.6, full_well_e=10_000)
    assert exposure_of(np.array([2.0]), sensor) == pytest.approx(3000)
    assert exposure_of(np.array([0.5, 2.0, 1.0]), sensor) == pytest.approx(3000)
    assert exposure_of(np.array([0.0]), sensor) == 0.0
    assert exposure_of(np.array([2.0]), SensorSection(exposure_e=123.0)) == 123.0
    assert exposure_of(np.array([2.0]), SensorSection(exposure_ph=200.0, quantum_efficiency=0.25)) == 50.0


def test_exposure_is_metered_on_the_sheet(tmp_path: Path) -> None:
    frame = frame_with(tmp_path)
    rows, columns = sheet_pixels(frame)
    radiance = np.full((120, 160), 7.0, dtype=np.float32)
    radiance[rows, columns] = np.linspace(0, 1, len(rows))
    assert whites(radiance, (rows, columns), "none") == pytest.approx(0.99, abs=0.02)
    # A mosaic has a white for each of its filters.
    radiance = np.array([0.2, 0.5, 0.9], dtype=np.float32)[filters("grbg", radiance.shape)]
    np.testing.assert_allclose(whites(radiance, (rows, columns), "grbg"), [0.2, 0.5, 0.9])


def test_white_balance_makes_white_grey() -> None:
    white = np.array([0.2, 0.5, 0.25])
    factors = balance_of(white, SensorSection())
    assert factors.min() == 1.0
    np.testing.assert_allclose(factors * white, 0.5)
    np.testing.assert_array_equal(balance_of(white, SensorSection(white_balance="none")), np.ones(3))
    np.testing.assert_array_equal(balance_of(white, SensorSection(white_balance=[2, 1, 1.5])), [2, 1, 1.5])
    # A channel without any light has no white to balance.
    assert np.isfinite(balance_of(np.array([0.0, 0.5, 0.2]), SensorSection())).all()


def test_channels_clip_for_themselves() -> None:
    sheet = data_sheet(SensorSection(mosaic="rggb", read_noise_e=0, shot_noise=False), 0.0)
    numbers = np.full((16, 16), 3000, dtype=np.uint16)
    image = delivered(numbers, sheet, np.array([2.0, 1.0, 0.5]))
    np.testing.assert_array_equal(image[8, 8], [255, round(3000 / 4095 * 255), round(1500 / 4095 * 255)])


@pytest.mark.parametrize("mosaic", MOSAICS)
def test_a_constant_colour_stays_constant_to_the_border(mosaic: str) -> None:
    colour = np.array([100.0, 200.0, 50.0])
    for shape in ((16, 18), (17, 16), (17, 19)):
        image = demosaic(colour[filters(mosaic, shape)], mosaic)
        np.testing.assert_allclose(image, np.broadcast_to(colour, (*shape, 3)), rtol=1e-14)


@pytest.mark.parametrize("mosaic", MOSAICS)
def test_a_ramp_of_colours_is_kept_in_the_interior(mosaic: str) -> None:
    y, x = np.mgrid[:20, :22]
    colours = np.stack([10 + 2 * x - y, 3 * y + x, 40 - x + 0.5 * y], axis=-1)
    levels = np.take_along_axis(colours, filters(mosaic, (20, 22))[..., None], axis=2)[..., 0]
    np.testing.assert_allclose(demosaic(levels, mosaic)[1:-1, 1:-1], colours[1:-1, 1:-1], rtol=1e-12)


def test_a_mosaic_begins_as_its_name_says() -> None:
    np.testing.assert_array_equal(filters("rggb", (2, 4)), [[0, 1, 0, 1], [1, 2, 1, 2]])
    np.testing.assert_array_equal(filters("gbrg", (2, 2)), [[1, 2], [0, 1]])


@given(st.floats(0, 1), st.floats(0, 1), st.sampled_from(["linear", "srgb", "gamma"]))
def test_curves_rise_from_black_to_white(a: float, b: float, curve: str) -> None:
    low, high = encoded(np.sort([a, b]), curve)
    assert 0 <= low <= high <= 1 + 1e-12
    np.testing.assert_allclose(encoded(np.array([0.0, 1.0]), curve), [0, 1], atol=1e-12)


def test_curves_have_their_published_values() -> None:
    # IEC 61966-2-1: 18 % grey is 118 of 255; the pieces meet within 1e-7 where the linear one ends.
    assert float(encoded(0.18, "srgb")) * 255 == pytest.approx(117.6, abs=0.1)
    assert float(encoded(0.0031308, "srgb")) == pytest.approx(float(encoded(0.0031309, "srgb")), abs=2e-6)
    assert float(encoded(0.25, "gamma", 2.0)) == pytest.approx(0.5)


def test_a_curve_has_shades_that_eight_bits_would_not(tmp_path: Path) -> None:
    frame = frame_with(tmp_path, "{curve: srgb, exposure_e: 10000, read_noise_e: 0, shot_noise: false}")
    ramp = np.tile(np.linspace(0, 0.02, 160, dtype=np.float32), (120, 1))
    # 2 % of the range are five numbers of 8 bits; 12 bits of the converter fill the curve's first 38.
    assert len(np.unique(develop(frame, ramp).image)) > 30


@pytest.mark.parametrize(("bits", "shift"), [(8, 0), (10, 6), (12, 4), (16, 0)])
def test_fewer_bits_stand_in_the_upper_ones(tmp_path: Path, bits: int, shift: int) -> None:
    frame = frame_with(tmp_path, f"{{bits: {bits}, black_level_dn: 5, read_noise_e: 0, shot_noise: false}}")
    developed = develop(frame, half(frame))
    image = developed.image
    assert image.dtype == (np.uint8 if bits == 8 else np.uint16)
    assert developed.record()["saturation_dn"] == (2**bits - 1) << shift
    assert not (image & ((1 << shift) - 1)).any()
    # 0.8 of the well is 0.8 of what lies above black.
    assert image.max() >> shift == round(5 + 0.8 * (2**bits - 6))
    data = png_bytes(image, bits)
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(data))), image)
    assert (b"sBIT" in data) == (shift > 0)
    if shift:
        assert data[data.index(b"sBIT") + 4] == bits


def test_a_raw_mosaic_is_delivered_as_it_is(tmp_path: Path) -> None:
    raw = frame_with(tmp_path, "{mosaic: bggr, deliver: raw, bits: 12}")
    developed = develop(raw, half(raw))
    assert developed.image.shape == (120, 160)
    assert developed.balance is None
    assert "white_balance" not in developed.record()
    colour = frame_with(tmp_path, "{mosaic: bggr, white_balance: [1.5, 1, 2]}")
    developed = develop(colour, half(colour))
    assert developed.image.shape == (120, 160, 3)
    assert developed.record()["white_balance"] == [1.5, 1.0, 2.0]


def test_a_coloured_sheet_comes_out_grey(tmp_path: Path) -> None:
    frame = frame_with(tmp_path, "{mosaic: gbrg, read_noise_e: 0, shot_noise: false}")
    light = np.array([0.9, 0.6, 0.3])
    radiance = light[filters("gbrg", (120, 160))].astype(np.float32)
    # White at 0.8 of the range in the brightest channel, and balanced to it in the others; 12 bits round by 1/32.
    assert np.abs(develop(frame, radiance).image.astype(int) - 204).max() <= 1


def test_edge_photometry_reads_both_sides_of_the_edge() -> None:
    y, x = np.mgrid[:80, :80]
    coverage = np.clip(20.5 - np.hypot(x - 40, y - 40), 0, 1).astype(np.float32)
    radiance = (0.8 - 0.7 * coverage).astype(np.float32)
    radiance[:5] = 3.0  # bright things far away do not matter
    sheet = data_sheet(SensorSection(full_well_e=10_000, read_noise_e=0), 0.0)
    found = edge_photometry(radiance, coverage, 10_000.0, sheet)
    assert found["edge_contrast_dn"] == pytest.approx(0.7 * 255, rel=1e-5)
    rms = np.sqrt((noise_dn(0.1, 1e4, sheet) ** 2 + noise_dn(0.8, 1e4, sheet) ** 2) / 2)
    assert found["edge_noise_dn"] == pytest.approx(float(rms), rel=1e-5)
    # The radiance is float32: 6e-8 of each.
    assert (found["edge_inside_e"], found["edge_outside_e"]) == pytest.approx((1000.0, 8000.0), rel=1e-6)
    bright = edge_photometry(radiance, coverage, 20_000.0, sheet)  # twice what the well holds is not clipped
    assert (bright["edge_inside_e"], bright["edge_outside_e"]) == pytest.approx((2000.0, 16_000.0), rel=1e-6)
    nothing = edge_photometry(radiance, coverage * 0, 10_000.0, sheet)
    assert nothing == dict.fromkeys(found)


def test_edge_photometry_is_in_the_numbers_of_the_file() -> None:
    y, x = np.mgrid[:80, :80]
    coverage = np.clip(20.5 - np.hypot(x - 41, y - 40), 0, 1).astype(np.float32)
    light = np.array([0.9, 0.6, 0.3])
    filtered = light[filters("rggb", coverage.shape)]
    radiance = (filtered * (0.8 - 0.7 * coverage)).astype(np.float32)
    sheet = data_sheet(SensorSection(mosaic="rggb", read_noise_e=0), 0.0)
    found = edge_photometry(radiance, coverage, 10_000.0, sheet, 0.9 / light)
    # Balanced, each channel is what the brightest is; the image itself says the same within its rounding.
    assert found["edge_contrast_dn"] == pytest.approx(0.7 * 0.9 * 255, rel=1e-4)
    numbers = np.rint(radiance * 4095).astype(np.uint16)
    grey = delivered(numbers, sheet, 0.9 / light).mean(axis=2)
    assert grey[0, 0] - grey[40, 41] == pytest.approx(found["edge_contrast_dn"], abs=1.0)
    twelve = data_sheet(SensorSection(bits=12, read_noise_e=0), 0.0)
    assert edge_photometry(radiance * 0 + 1 - coverage, coverage, 5e3, twelve)["edge_contrast_dn"] == pytest.approx(
        0.5 * 4095 * 16, rel=1e-3
    )


def test_a_jpeg_is_smaller_and_says_nothing_of_itself(tmp_path: Path) -> None:
    frame = frame_with(tmp_path, "{mosaic: rggb}")
    image = develop(frame, half(frame)).image
    fine, coarse = jpeg_bytes(image, 95), jpeg_bytes(image, 20)
    assert len(coarse) < len(fine) < len(png_bytes(image, 8))
    assert fine == jpeg_bytes(image, 95)
    read = read_image(fine, "x.jpg", (image.shape[1], image.shape[0]))
    assert read.shape == image.shape
    # Quality 95 keeps a flat grey to a number or two; noise in the colours is averaged away.
    assert np.abs(read.astype(float) - image).mean() < 3


def test_what_shows_nothing_is_flagged(tmp_path: Path) -> None:
    plain = frame_with(tmp_path)
    radiance = half(plain)
    assert develop(plain, radiance).flags == ()
    burnt = develop(frame_with(tmp_path, "{exposure_e: 1e6}"), radiance)
    assert burnt.flags == ("saturated",)
    assert burnt.saturated_fraction == 1.0
    assert develop(frame_with(tmp_path, "{exposure_e: 0.01, black_level_dn: 20}"), radiance).flags == ("dark",)
    # Without light no exposure is long enough; read noise above black must not pass for a picture.
    night = develop(frame_with(tmp_path, "{read_noise_e: 500, black_level_dn: 20}"), radiance * 0)
    assert night.flags == ("dark",)
    assert night.exposure_e == 0.0
    # A sheet that is half burnt out still shows something.
    assert develop(frame_with(tmp_path, "{exposure_e: 19000}"), radiance).flags == ()


def test_flags_are_counted_by_frame() -> None:
    assert marker_flags(["dark"], 0.0) == ["dark", "occluded"]
    assert marker_flags(["dark", "occluded"], 0.5) == ["dark"]
    assert frame_flags((), [1.0, 0.0]) == ["occluded"]
    rows = [(3, ["saturated"]), (3, ["saturated", "occluded"]), (5, ["occluded"]), (6, [])]
    assert count_flags(rows) == {"saturated": 1, "dark": 0, "occluded": 2}
    assert warning_of([(1, []), (2, [])], 2) is None
    line = warning_of(rows, 7)
    assert line is not None
    assert "2 of 7 frames" in line
    assert "1 saturated, 2 occluded" in line
    assert line.endswith("frame 3, saturated, occluded")


def test_the_recorded_noise_follows_from_the_data_sheet(tmp_path: Path) -> None:
    frame = frame_with(tmp_path, "{bits: 12, exposure_e: 6000, prnu: 0.01, dsnu_e: 3, black_level_dn: 100}")
    developed, radiance = develop(frame, half(frame)), half(frame)
    record = developed.record()
    electrons = radiance * 6000.0
    variance_dn2 = (
        record["gain_dn_per_e"] ** 2
        * (
            electrons
            + record["dark_e"]
            + record["read_noise_e"] ** 2
            + record["dsnu_e"] ** 2
            + (record["prnu"] * electrons) ** 2
        )
        + 1 / 12
    )
    noise = developed.noise_dn()
    assert noise.dtype == np.float32
    np.testing.assert_allclose(noise, np.sqrt(variance_dn2) * 2.0 ** record["stored_shift"], rtol=1e-5)
    # Half of the frame at one level: 9,600 pixels, the standard deviation to 0.7 %; four of them.
    left = developed.image[:, :80].astype(float)
    assert left.std() == pytest.approx(noise[0, 0], rel=0.03)


def test_paired_frames_differ_in_the_swept_number_alone(tmp_path: Path) -> None:
    study = small_study(
        tmp_path,
        ("frames: 4", "frames: 2\nsweep: {key: sensor.jpeg_quality, levels: [30, 90]}\nsensor: {read_noise_e: 9}"),
    )
    low, high = frame_of(study, 0), frame_of(study, 2)
    assert (low.settings.sensor.jpeg_quality, high.settings.sensor.jpeg_quality) == (30, 90)
    np.testing.assert_array_equal(develop(low, half(low)).image, develop(high, half(high)).image)
    assert low.settings.sensor.image_suffix == ".jpg"


def test_levels_of_what_is_developed_begin_at_black() -> None:
    sheet = data_sheet(SensorSection(curve="srgb", black_level_dn=20), 0.0)
    levels = delivered_levels([0, sheet.black_level_dn, sheet.top_dn], sheet)
    np.testing.assert_allclose(levels, [0, 0, 255])


def test_a_far_sheet_is_not_burnt_out(tmp_path: Path) -> None:
    far = small_study(tmp_path, ("{uniform: [7, 9]}", "40"))
    render_study(far, tmp_path / "ds", frames=range(1))
    image = read_image((tmp_path / "ds" / image_name(0)).read_bytes(), "", (160, 120))
    assert 190 < image.max() < 230
