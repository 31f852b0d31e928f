"""The camera's processor: each step against what it is declared to do, and that off means off."""

from pathlib import Path

import numpy as np
import pytest
from helpers_studies import small_study
from hypothesis import given
from hypothesis import strategies as st

from roundel.render.sensor.curve import delivered_levels
from roundel.render.sensor.data_sheet import data_sheet
from roundel.render.sensor.demosaic import filters
from roundel.render.sensor.develop import Developed, develop
from roundel.render.sensor.isp import denoised, guided, processed, saturated, sharpened, toned
from roundel.scenes.errors import StudyError
from roundel.scenes.study.sensor_section import ISP_PRESETS, IspSection, SensorSection
from roundel.scenes.world.frame import frame_of

LUMA = np.array([0.299, 0.587, 0.114])


def developed_with(folder: Path, sensor: str, radiance: np.ndarray) -> Developed:
    frame = frame_of(small_study(folder, ("frames: 4", f"frames: 1\nsensor: {sensor}")), 0)
    return develop(frame, radiance.astype(np.float32))


def flat(level: float = 0.5) -> np.ndarray:
    return np.full((120, 160), level)


def step() -> np.ndarray:
    out = flat(0.2)
    out[:, 80:] = 0.6
    return out


def test_off_changes_nothing(tmp_path: Path) -> None:
    levels = np.random.default_rng(1).random((20, 30, 3))
    np.testing.assert_array_equal(processed(levels, IspSection()), levels)
    for sensor in ("{{{}}}", "{{mosaic: rggb, {}}}", "{{curve: srgb, bits: 12, {}}}"):
        bare = developed_with(tmp_path, sensor.format(""), step())
        for spelt in ("isp: none", "isp: {}", "isp: {sharpen_radius_px: 3, denoise_radius_px: 5}"):
            off = developed_with(tmp_path, sensor.format(spelt), step())
            np.testing.assert_array_equal(off.image, bare.image)
            assert off.record() == bare.record()
            assert "isp" not in off.record()


def test_the_same_bytes_again(tmp_path: Path) -> None:
    first, second = (developed_with(tmp_path, "{mosaic: rggb, curve: srgb, isp: phone}", step()) for _ in range(2))
    np.testing.assert_array_equal(first.image, second.image)
    assert first.record()["isp"] == {**IspSection(preset="phone").model_dump(exclude={"preset"})}
    assert first.record()["curve"] == "srgb"


@given(st.floats(-1, 1), st.floats(0, 0.4), st.floats(0.6, 1), st.floats(0, 1), st.floats(0, 1))
def test_the_tone_curve_never_falls(contrast: float, black: float, white: float, a: float, b: float) -> None:
    isp = IspSection(contrast=contrast, black_point=black, white_point=white)
    low, high = toned(np.sort([a, b]), isp)
    # One rounding error of the polynomial near its flat ends.
    assert -1e-15 <= low <= high + 1e-15
    assert high <= 1 + 1e-15
    np.testing.assert_allclose(toned(np.array([black, (black + white) / 2, white]), isp), [0, 0.5, 1], atol=1e-12)


def test_the_s_curve_has_the_slope_that_is_declared() -> None:
    isp = IspSection(contrast=0.4)
    around = toned(np.array([0.5 - 1e-4, 0.5 + 1e-4]), isp)
    assert np.diff(around) / 2e-4 == pytest.approx(1.2, rel=1e-6)


def test_denoising_lowers_the_noise_of_a_flat_field(tmp_path: Path) -> None:
    keys = "full_well_e: 500, read_noise_e: 5, bits: 12, curve: srgb"
    before = developed_with(tmp_path, f"{{{keys}}}", flat()).image.astype(float)
    after = developed_with(tmp_path, f"{{{keys}, isp: {{luma_denoise: 0.1}}}}", flat()).image.astype(float)
    assert after.std() < 0.3 * before.std()
    assert after.mean() == pytest.approx(before.mean(), rel=1e-3)


def test_detail_of_the_declared_strength_is_halved() -> None:
    # Of a window's variance v a guided filter keeps v / (v + strength^2), here a half; a checkerboard has no mean.
    y, x = np.mgrid[:64, :64]
    board = 0.5 + 0.05 * (1 - 2 * ((x + y) % 2))
    isp = IspSection(luma_denoise=0.05, denoise_radius_px=8)
    inside = denoised(board, isp)[16:-16, 16:-16]
    assert np.ptp(inside) / np.ptp(board) == pytest.approx(0.5, abs=0.01)


def test_denoising_keeps_a_strong_edge() -> None:
    edge = step()
    kept = denoised(edge, IspSection(luma_denoise=0.02))
    # A window of 5 columns, one of them beyond the edge, moves it most: strength^2 / (height 1/5).
    assert np.abs(kept - edge).max() < 0.02**2 / (0.4 / 5)


def test_colour_noise_goes_without_brightness(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    noisy = np.clip(0.5 + 0.05 * rng.standard_normal((80, 90, 3)), 0, 1)
    out = denoised(noisy, IspSection(chroma_denoise=0.1))
    np.testing.assert_allclose(out @ LUMA, noisy @ LUMA, atol=1e-12)
    chroma = [(image - (image @ LUMA)[..., None]).std() for image in (noisy, out)]
    assert chroma[1] < 0.35 * chroma[0]
    # And a grey image has no colours: chroma's strength does nothing, in mono and in colour.
    sensor = "{{full_well_e: 500, curve: srgb, isp: {{chroma_denoise: {}, saturation: {}}}}}"
    plain, asked = (developed_with(tmp_path, sensor.format(c, s), flat()).image for c, s in ((0, 1), (0.1, 1.5)))
    assert plain.ndim == 2
    np.testing.assert_array_equal(asked, plain)


def test_colours_do_not_run_over_an_edge_of_brightness() -> None:
    image = np.empty((40, 60, 3))
    image[:, :30], image[:, 30:] = [0.6, 0.2, 0.2], [0.5, 0.9, 0.9]
    out = denoised(image, IspSection(chroma_denoise=0.02))
    assert np.abs(out - image).max() < 0.01


def test_sharpening_overshoots_by_the_formula() -> None:
    # Right beside a step of height h, a Gaussian of sigma 2 px has moved h (1/2 - 1/(2 sigma sqrt(2 pi))) over to it.
    out = sharpened(step(), IspSection(sharpen_amount=0.8, sharpen_radius_px=2.0))[60]
    over = 0.8 * 0.4 * (0.5 - 0.5 / (2 * np.sqrt(2 * np.pi)))
    # The sampled Gaussian's weight at 0 differs from its density by the truncation at four sigma and its normalisation.
    assert out.max() - 0.6 == pytest.approx(over, rel=2e-3)
    assert 0.2 - out.min() == pytest.approx(over, rel=2e-3)
    np.testing.assert_allclose(out[[0, 40, 120, 159]], [0.2, 0.2, 0.6, 0.6], atol=1e-12)
    clipped = processed(step() / 0.6, IspSection(sharpen_amount=3))
    assert (clipped.min(), clipped.max()) == (0.0, 1.0)


def test_sharpening_makes_no_colours() -> None:
    image = np.repeat(step()[..., None], 3, axis=2) * [1.0, 0.8, 0.6]
    out = sharpened(image, IspSection(sharpen_amount=1.0))
    np.testing.assert_allclose(out[..., 0] - image[..., 0], out[..., 2] - image[..., 2], atol=1e-15)


def test_saturation_leaves_luma_and_grey() -> None:
    colour = np.array([[0.5, 0.4, 0.3], [0.4, 0.4, 0.4]])
    out = saturated(colour, IspSection(saturation=1.5))
    np.testing.assert_allclose(out @ LUMA, colour @ LUMA, atol=1e-12)
    np.testing.assert_allclose(out[0] - out[0] @ LUMA, 1.5 * (colour[0] - colour[0] @ LUMA), atol=1e-12)
    np.testing.assert_allclose(out[1], 0.4)


def test_a_guide_without_detail_gives_the_mean() -> None:
    image = np.random.default_rng(0).random((30, 30))
    smooth = guided(image, np.zeros((30, 30)), 0.1, 2)
    assert smooth[10:20, 10:20].std() < 0.25 * image.std()


def test_contrast_and_noise_go_through_the_tone_curve(tmp_path: Path) -> None:
    keys = "bits: 12, curve: srgb, full_well_e: 20000, exposure_e: 20000, read_noise_e: 20"
    radiance = step()
    coverage = np.clip(np.broadcast_to(81 - np.arange(160.0), (120, 160)), 0, 1).astype(np.float32)
    coverage[:, 80] = 0.5
    isp = "isp: {contrast: 0.5, black_point: 0.1, white_point: 0.9}"
    developed = developed_with(tmp_path, f"{{{keys}, {isp}}}", radiance)
    image, found = developed.image.astype(float), developed.edge(coverage)
    left, right = image[:, 5:75], image[:, 85:155]
    # 8,400 pixels a side: the mean to a hundredth of the noise, the standard deviation to 0.8 %; four of each.
    noise = found["edge_noise_dn"]
    assert noise is not None
    assert found["edge_contrast_dn"] == pytest.approx(right.mean() - left.mean(), abs=0.06 * noise)
    assert noise == pytest.approx(np.sqrt((left.var() + right.var()) / 2), rel=0.03)
    # The spatial steps change the image's noise; the stated one stays that of the pixel before them.
    smooth = developed_with(tmp_path, f"{{{keys}, isp: {{luma_denoise: 0.05, sharpen_amount: 0.5}}}}", radiance)
    bare = developed_with(tmp_path, f"{{{keys}}}", radiance)
    assert smooth.edge(coverage) == bare.edge(coverage)
    assert smooth.record()["isp"]["luma_denoise"] == 0.05


def test_white_of_a_coloured_image_is_that_of_the_photometry(tmp_path: Path) -> None:
    light = np.array([0.9, 0.7, 0.5])[filters("rggb", (120, 160))]
    coverage = np.clip(np.broadcast_to(81 - np.arange(160.0), (120, 160)), 0, 1).astype(np.float32)
    coverage[:, 80] = 0.5
    sensor = "{mosaic: rggb, curve: srgb, read_noise_e: 0, shot_noise: false, white_balance: none, isp: phone}"
    developed = developed_with(tmp_path, sensor, step() * light)
    image = developed.image.astype(float).mean(axis=2)
    # To the rounding of the converter and of three channels.
    assert developed.edge(coverage)["edge_contrast_dn"] == pytest.approx(image[60, 120] - image[60, 30], abs=1.0)


def test_saturation_is_recorded_behind_the_white_point() -> None:
    sheet = data_sheet(SensorSection(curve="srgb", isp={"white_point": 0.8}), 0.0)
    assert float(delivered_levels(0.7 * sheet.top_dn, sheet)) == 255.0


def test_preset_and_keys() -> None:
    assert IspSection(preset="phone").model_dump(exclude={"preset"}).items() >= ISP_PRESETS["phone"].items()
    own = SensorSection(mosaic="rggb", isp={"preset": "phone", "sharpen_amount": 0.0}).isp
    assert (own.sharpen_amount, own.contrast) == (0.0, ISP_PRESETS["phone"]["contrast"])
    assert SensorSection(isp="phone").isp == IspSection.model_validate(own.model_dump() | {"sharpen_amount": 0.7})
    assert not IspSection().active
    assert IspSection(contrast={"uniform": [0, 0.2]}).active


def test_a_drawn_strength(tmp_path: Path) -> None:
    text = "frames: 2\nsensor: {isp: {preset: phone, contrast: {uniform: [0.1, 0.4]}}}"
    study = small_study(tmp_path, ("frames: 4", text))
    drawn = [frame_of(study, i).settings.sensor.isp.contrast for i in range(2)]
    assert drawn[0] != drawn[1]
    assert frame_of(study, 0).drawn["sensor.isp.contrast"] == pytest.approx(drawn[0], rel=1e-8)
    swept = "frames: 1\nsensor: {isp: phone}\nsweep: {key: sensor.isp.sharpen_amount, levels: [0, 1.5]}"
    study = small_study(tmp_path, ("frames: 4", swept))
    assert [frame_of(study, i).settings.sensor.isp.sharpen_amount for i in range(2)] == [0, 1.5]


@pytest.mark.parametrize(
    ("sensor", "place", "words"),
    [
        ("{isp: fone}", "sensor.isp", "'none' or 'phone', not 'fone'"),
        ("{isp: {sharpen_amont: 1}}", "sensor.isp.sharpen_amont", "unknown key; did you mean sharpen_amount?"),
        ("{isp: {contrast: 2}}", "sensor.isp.contrast", "a contrast must be between -1 and 1"),
        ("{isp: {luma_denoise: -0.1}}", "sensor.isp.luma_denoise", "out of range"),
        ("{isp: {denoise_radius_px: 1.5}}", "sensor.isp.denoise_radius_px", "give a whole number"),
        ("{isp: {black_point: 0.5, white_point: {uniform: [0.4, 0.9]}}}", "sensor.isp", "white_point must be above"),
        ("{isp: 3}", "sensor.isp", "give a mapping of keys"),
        ("{mosaic: rggb, deliver: raw, isp: phone}", "sensor", "isp: a raw mosaic is delivered as it is"),
    ],
)
def test_bad_input_is_one_line_at_its_place(tmp_path: Path, sensor: str, place: str, words: str) -> None:
    with pytest.raises(StudyError) as caught:
        small_study(tmp_path, ("frames: 4", f"frames: 4\nsensor: {sensor}"))
    text = str(caught.value)
    assert f"{place}" in text
    assert words in text
    assert "\n" not in text
    assert caught.value.line == 14
