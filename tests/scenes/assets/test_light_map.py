"""Environment maps: light, rotation, checksum of the file, and invalid files."""

import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers_light import light_from, radiance_at, write_map
from helpers_studies import small_study

from roundel.render.backend import start
from roundel.render.run import render_study
from roundel.render.scene.lights import emitters
from roundel.scenes.errors import DataError, StudyError
from roundel.scenes.study.study import load_study
from roundel.scenes.world.frame import frame_of

LIGHT = "light: {environment: 0.7, lamps: [{position_m: [-0.3, -0.5, 0.0], size_m: 0.2, radiance: 6}]}"
POINTS = np.array([[0.0, 0.0], [0.06, 0.0]])


def mapped(folder: Path, keys: str = ""):
    return small_study(folder, (LIGHT, f"light:\n  map:\n    {{file: map.exr{keys}}}"))


def constant(folder: Path, level: float = 1.3, width: int = 16) -> None:
    write_map(folder / "map.exr", np.full((width // 2, width, 3), level, dtype=np.float32))


def test_a_constant_map_is_a_constant_environment(mi, tmp_path: Path) -> None:
    constant(tmp_path)
    frame = frame_of(mapped(tmp_path, ", scale: 2, turn_deg: 33"), 0)
    # Two strategies, each with a weight below 1 that varies: 65,536 samples scatter by some 0.3 %.
    np.testing.assert_allclose(radiance_at(mi, frame, POINTS, 65536)[:, 0], [0.05 * 2.6, 0.80 * 2.6], rtol=0.015)


def spot(folder: Path, row: int, column: int, colour=(100.0, 50.0, 25.0)) -> None:
    pixels = np.full((32, 64, 3), 0.01, dtype=np.float32)
    pixels[row, column] = colour
    write_map(folder / "map.exr", pixels)


def directions():
    azimuth, elevation = (
        a.ravel() for a in np.radians(np.meshgrid(np.arange(-180, 180, 3.0), np.arange(-87, 88, 3.0)))
    )
    toward = np.stack(
        [np.sin(azimuth) * np.cos(elevation), -np.sin(elevation), np.cos(azimuth) * np.cos(elevation)], axis=-1
    )
    return np.degrees(azimuth), np.degrees(elevation), toward


@pytest.mark.parametrize("turn", [0.0, 30.0, -100.0])
@pytest.mark.parametrize(("column", "azimuth"), [(32, 2.8), (40, 47.8), (16, -87.2)])
def test_the_middle_of_a_map_is_before_the_camera_its_top_is_up_and_its_right_is_right(
    mi, tmp_path: Path, turn: float, column: int, azimuth: float
) -> None:
    # A pixel spans 5.6 degrees; the eighth row of 32 ends at 45 degrees above the horizon.
    spot(tmp_path, 8, column)
    frame = frame_of(mapped(tmp_path, f", turn_deg: {turn}"), 0)
    light = light_from(mi, emitters(mi, frame)["environment"], directions()[2])[:, 0]
    found_azimuth, found_elevation, _ = (a[np.argmax(light)] for a in directions())
    assert found_elevation == pytest.approx(42.2, abs=3)
    assert (found_azimuth - azimuth - turn + 180) % 360 - 180 == pytest.approx(0, abs=4)


def test_a_monochrome_camera_sees_the_luminance_of_a_map_and_a_colour_camera_its_colours(mi, tmp_path: Path) -> None:
    spot(tmp_path, 8, 40)
    frame = frame_of(mapped(tmp_path), 0)
    grey = light_from(mi, emitters(mi, frame)["environment"], directions()[2])
    start("llvm_ad_rgb")
    colour = light_from(mi, emitters(mi, frame)["environment"], directions()[2])
    start()
    np.testing.assert_allclose(colour @ [[0.212671], [0.715160], [0.072169]], grey, rtol=1e-5)
    brightest = colour[np.argmax(grey)] - 0.01
    np.testing.assert_allclose(brightest / brightest[0], [1, 0.5, 0.25], rtol=0.01)


def test_a_map_of_one_channel_is_grey(rgb, tmp_path: Path) -> None:
    write_map(tmp_path / "map.exr", np.full((8, 16, 1), 0.4, dtype=np.float32), "Y")
    frame = frame_of(mapped(tmp_path), 0)
    np.testing.assert_allclose(light_from(rgb, emitters(rgb, frame)["environment"], directions()[2]), 0.4, rtol=1e-6)


def test_the_digest_of_a_study_is_of_its_map_too(tmp_path: Path) -> None:
    constant(tmp_path, 1.0)
    one = mapped(tmp_path)
    assert one.digest() == mapped(tmp_path).digest()
    constant(tmp_path, 1.1)
    assert mapped(tmp_path).digest() != one.digest()


def test_a_resolved_study_is_read_without_its_map_and_is_the_same(tmp_path: Path) -> None:
    constant(tmp_path)
    study = mapped(tmp_path)
    digest = study.groups["main"].light.map.sha256
    assert len(digest) == 64
    beside = tmp_path / "dataset"
    beside.mkdir()
    recorded = small_study(beside, (LIGHT, f"light: {{map: {{file: map.exr, sha256: {digest}}}}}"))
    assert recorded.digest() == study.digest()
    # Frames can be placed, for the truth; only rendering needs the file.
    frame = frame_of(recorded, 0)
    with pytest.raises(DataError, match="this environment map is missing; put it beside the study"):
        emitters(start(), frame)


def write_hdr(mi, path: Path, pixels: np.ndarray) -> None:
    mi.Bitmap(pixels.astype(np.float32)).write(str(path))


def hdr(folder: Path):
    return small_study(folder, (LIGHT, "light:\n  map:\n    {file: map.hdr}"))


def test_a_radiance_map_is_the_same_light_as_its_exr(mi, tmp_path: Path) -> None:
    pixels = np.repeat(np.random.default_rng(4).uniform(0.1, 50.0, (32, 64, 1)), 3, axis=-1)
    write_map(tmp_path / "map.exr", pixels.astype(np.float32))
    write_hdr(mi, tmp_path / "map.hdr", pixels)
    found = [
        light_from(mi, emitters(mi, frame_of(study, 0))["environment"], directions()[2])
        for study in (mapped(tmp_path), hdr(tmp_path))
    ]
    # RGBE has eight bits of mantissa, the first of which is set: what is cut off is at most 1/128.
    np.testing.assert_allclose(found[1], found[0], rtol=0.01)


def test_a_corrupt_radiance_map_is_refused(mi, tmp_path: Path) -> None:
    write_hdr(mi, tmp_path / "map.hdr", np.ones((8, 16, 3)))
    data = (tmp_path / "map.hdr").read_bytes()
    for broken in (
        data[:8],
        data.replace(b"-Y 8", b"+X 8"),
        data.replace(b"rgbe", b"xyze"),
        data.replace(b"X 16", b"X a6"),
    ):
        (tmp_path / "map.hdr").write_bytes(broken)
        with pytest.raises(StudyError, match=r"light\.map\.file: map\.hdr: its header is not that of a Radiance"):
            hdr(tmp_path)
    for size, message in ((b"-Y 9000 +X 18000", "is too large"), (b"-Y 16 +X 16", "twice as wide as high")):
        (tmp_path / "map.hdr").write_bytes(data.replace(b"-Y 8 +X 16", size))
        with pytest.raises(StudyError, match=message):
            hdr(tmp_path)


@pytest.mark.parametrize("name", ["map.hdr", "map.exr"])
def test_a_map_whose_pixels_are_cut_off_is_refused_before_anything_is_rendered(mi, tmp_path: Path, name: str) -> None:
    pixels = np.random.default_rng(4).uniform(0.1, 50.0, (32, 64, 3)).astype(np.float32)
    write_hdr(mi, tmp_path / "map.hdr", pixels)
    write_map(tmp_path / "map.exr", pixels)
    data = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(data[: len(data) // 2])
    study = hdr(tmp_path) if name == "map.hdr" else mapped(tmp_path)
    with pytest.raises(StudyError, match=r"study.yaml:\d+:\d+: light.map.file: .*truncated or corrupt") as caught:
        render_study(study, tmp_path / "ds")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "ds").exists()


@pytest.mark.parametrize("name", ["../map.exr", "a/../../map.exr", "http://a.org/map.exr"])
def test_a_map_outside_the_folder_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / "study").mkdir()
    constant(tmp_path)
    with pytest.raises(StudyError, match=r"light.map.file: .*(leaves the study's folder|is not a relative path)"):
        small_study(tmp_path / "study", (LIGHT, f'light: {{map: {{file: "{name}"}}}}'))


def refused(folder: Path, message: str, keys: str = "") -> None:
    with pytest.raises(StudyError, match=message) as caught:
        mapped(folder, keys)
    # The key `file` itself, within its braces.
    assert (caught.value.line, caught.value.column) == (13, 6)
    assert "\n" not in str(caught.value)


def test_a_missing_map_is_refused(tmp_path: Path) -> None:
    refused(tmp_path, r"light\.map\.file: no such file: map\.exr; the path is relative to the study")


def test_an_absolute_path_is_refused(tmp_path: Path) -> None:
    constant(tmp_path)
    with pytest.raises(StudyError, match="give it relative to the study"):
        small_study(tmp_path, (LIGHT, f"light: {{map: {{file: {tmp_path}/map.exr}}}}"))


def test_another_map_than_the_recorded_one_is_refused(tmp_path: Path) -> None:
    constant(tmp_path)
    refused(tmp_path, "is not the recorded map", f", sha256: {'a' * 64}")
    with pytest.raises(StudyError, match="sha256"):
        mapped(tmp_path, ", sha256: abc")


def test_a_file_that_is_no_exr_is_refused(tmp_path: Path) -> None:
    for data in (b"", b"P6 2 1 255 ......", b"\x89PNG" + bytes(100)):
        (tmp_path / "map.exr").write_bytes(data)
        refused(tmp_path, r"map\.exr: is not an OpenEXR or Radiance HDR file")


@pytest.mark.parametrize("length", [4, 7, 8, 9, 20, 60, 200])
def test_a_header_that_is_cut_off_is_refused(tmp_path: Path, length: int) -> None:
    constant(tmp_path)
    data = (tmp_path / "map.exr").read_bytes()
    (tmp_path / "map.exr").write_bytes(data[:length])
    refused(tmp_path, r"map\.exr: its header is truncated or corrupt")


@pytest.mark.parametrize(
    ("size", "message"),
    [
        ((16_386, 8_193), "16386 x 8193 pixels with 3 channels is too large"),
        ((16_384, 8_192), "too large; scale it down .at most 16384 wide, 1 GB decoded"),
        ((2_000_000_000, 1_000_000_000), "too large"),
        ((16, 16), "16 x 16 pixels; an equirectangular map is twice as wide as high"),
        ((16, 0), "16 x 0 pixels; an equirectangular map"),
        ((-5, 8), "-5 x 8 pixels; an equirectangular map"),
        ((2, 1), "2 x 1 pixels; an equirectangular map"),
    ],
)
def test_a_map_of_a_size_that_cannot_be_is_refused_before_it_is_decoded(
    tmp_path: Path, size: tuple[int, int], message: str
) -> None:
    constant(tmp_path)
    data = bytearray((tmp_path / "map.exr").read_bytes())
    # Claim another size: the window stands behind its name, its type and its length.
    at = data.index(b"dataWindow\0box2i\0") + 21
    data[at : at + 16] = struct.pack("<4i", 0, 0, size[0] - 1, size[1] - 1)
    (tmp_path / "map.exr").write_bytes(data)
    refused(tmp_path, message)


def unreadable(mi, folder: Path, message: str) -> None:
    frame = frame_of(mapped(folder), 0)
    with pytest.raises(DataError, match=message) as caught:
        emitters(mi, frame)
    assert "\n" not in str(caught.value)
    assert "map.exr" in str(caught.value)


def test_a_truncated_map_is_one_clear_line(mi, tmp_path: Path, capfd) -> None:
    rng = np.random.default_rng(0)
    write_map(tmp_path / "map.exr", rng.random((32, 64, 3)))
    data = (tmp_path / "map.exr").read_bytes()
    for length in (len(data) // 2, len(data) - 10, 420):
        (tmp_path / "map.exr").write_bytes(data[:length])
        unreadable(mi, tmp_path, "truncated or corrupt; get the file again")
    # The library has not talked past us.
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("value", "message"),
    [(np.nan, "holds NaN or infinity"), (np.inf, "holds NaN or infinity"), (-0.1, "holds negative light")],
)
def test_a_map_of_what_is_no_light_is_one_clear_line(mi, tmp_path: Path, value: float, message: str) -> None:
    pixels = np.ones((8, 16, 3), dtype=np.float32)
    pixels[3, 4, 1] = value
    write_map(tmp_path / "map.exr", pixels)
    unreadable(mi, tmp_path, message)


def test_a_black_map_and_one_without_colours_are_one_clear_line(mi, tmp_path: Path) -> None:
    constant(tmp_path, 0.0)
    unreadable(mi, tmp_path, "is black; use another")
    write_map(tmp_path / "map.exr", np.ones((8, 16, 2), dtype=np.float32), "ZA")
    unreadable(mi, tmp_path, "needs the channels R, G, B, or Y; it has")


def test_a_map_that_changes_under_a_study_is_one_clear_line(mi, tmp_path: Path) -> None:
    constant(tmp_path)
    frame = frame_of(mapped(tmp_path), 0)
    constant(tmp_path, 7.0)
    with pytest.raises(DataError, match="is not the map recorded by the study"):
        emitters(mi, frame)
    assert load_study(tmp_path / "study.yaml").groups["main"].light.map is not None


def test_the_kept_emitter_takes_each_frames_own_turn_and_scale(mi, tmp_path: Path) -> None:
    spot(tmp_path, 8, 40)
    frame = frame_of(mapped(tmp_path), 0)
    light = frame.settings.light
    other = light.model_copy(update={"map": light.map.model_copy(update={"turn_deg": 90.0, "scale": 3.0})})
    turned = replace(frame, settings=frame.settings.model_copy(update={"light": other}))
    first = light_from(mi, emitters(mi, frame)["environment"], directions()[2])
    second = light_from(mi, emitters(mi, turned)["environment"], directions()[2])
    third = light_from(mi, emitters(mi, frame)["environment"], directions()[2])
    assert second.max() == pytest.approx(3 * first.max(), rel=1e-3)
    assert np.argmax(second) != np.argmax(first)
    np.testing.assert_array_equal(first, third)
