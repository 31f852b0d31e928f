"""Light and materials against closed forms: lamps, maps, sky, gloss, shadows."""

from pathlib import Path

import numpy as np
import pytest
from helpers_light import light_from, radiance_along, radiance_at
from helpers_studies import small_study

from roundel.render.backend import start
from roundel.render.radiance import render_radiance
from roundel.render.scene.lights import emitters, needs_colour, sun_direction
from roundel.scenes.errors import StudyError, UsageError
from roundel.scenes.geometry.pose import transform_points
from roundel.scenes.study.light_section import SkySection
from roundel.scenes.world.frame import frame_of
from roundel.scenes.world.lamps import camera_from_lamp, facing, irradiance_of

LIGHT = "light: {environment: 0.7, lamps: [{position_m: [-0.3, -0.5, 0.0], size_m: 0.2, radiance: 6}]}"
MARKER = "marker: {kind: disc, diameter_m: 0.08}"
INK, PAPER = 0.05, 0.80

# On the ink, on the paper beside it, and near the sheet's corner.
POINTS = np.array([[0.0, 0.0], [0.01, -0.02], [0.06, 0.0], [-0.05, 0.055]])
REFLECTANCE = np.array([INK, INK, PAPER, PAPER])


def lit(folder: Path, light: str, *edits: tuple[str, str]):
    return frame_of(small_study(folder, (LIGHT, f"light: {light}"), *edits), 0)


def geometry(frame, position):
    """Cosine at the print and distance of a lamp, at POINTS."""
    flat = np.column_stack([POINTS, np.zeros(len(POINTS))])
    toward = np.asarray(position) - transform_points(frame.camera_from_sheet, flat)
    distance = np.linalg.norm(toward, axis=1)
    return toward @ frame.camera_from_sheet[:3, 2] / distance, distance


def test_point_light_obeys_the_inverse_square_and_the_cosine(mi, tmp_path: Path) -> None:
    position = [-0.3, -0.2, 0.1]
    frame = lit(tmp_path, f"{{environment: 0, lamps: [{{kind: point, position_m: {position}, intensity: 2.5}}]}}")
    cosine, distance = geometry(frame, position)
    expected = REFLECTANCE / np.pi * 2.5 * cosine / distance**2
    # Nothing is random here; float32 has seven digits.
    np.testing.assert_allclose(radiance_at(mi, frame, POINTS)[:, 0], expected, rtol=1e-5)
    np.testing.assert_allclose(
        irradiance_of(frame.settings.light.lamps[0], frame.camera_from_sheet, np.column_stack([POINTS, np.zeros(4)])),
        2.5 * cosine / distance**2,
    )


def test_spot_is_a_point_light_within_its_beam_and_nothing_beyond_its_cutoff(mi, tmp_path: Path) -> None:
    spot = "{kind: spot, position_m: [-0.3, -0.2, 0.1], intensity: 2.5, cutoff_deg: %g, beam_deg: %g, aim_x_m: 0.06}"
    wide = lit(tmp_path, f"{{environment: 0, lamps: [{spot % (60, 50)}]}}")
    cosine, distance = geometry(wide, [-0.3, -0.2, 0.1])
    as_point = REFLECTANCE / np.pi * 2.5 * cosine / distance**2
    np.testing.assert_allclose(radiance_at(mi, wide, POINTS)[:, 0], as_point, rtol=1e-5)
    narrow = lit(tmp_path, f"{{environment: 0, lamps: [{spot % (3, 1.5)}]}}")
    got = radiance_at(mi, narrow, POINTS)[:, 0]
    # It aims at the third point, 6 cm along X; the others are more than 3 degrees away as seen from some 0.8 m.
    assert got[2] == pytest.approx(as_point[2], rel=1e-5)
    assert got[0] == 0
    assert got[3] == 0
    # Halfway between beam and cutoff, at 2.25 degrees off the axis, half of it is left.
    lamp = narrow.settings.light.lamps[0]
    pose = camera_from_lamp(lamp, narrow.camera_from_sheet)
    off = pose[:3, 3] + pose[:3, :3] @ [np.tan(np.radians(2.25)), 0, 1]
    ray = off - pose[:3, 3]
    normal, origin = narrow.camera_from_sheet[:3, 2], narrow.camera_from_sheet[:3, 3]
    at = pose[:3, 3] + ray * ((origin - pose[:3, 3]) @ normal) / (ray @ normal)
    flat = transform_points(np.linalg.inv(narrow.camera_from_sheet), at)[None, :2]
    half, whole = radiance_at(mi, narrow, flat), radiance_at(mi, wide, flat)
    assert half[0, 0] / whole[0, 0] == pytest.approx(0.5, rel=1e-3)


def test_area_lamp_gives_the_integral_over_its_square(mi, tmp_path: Path) -> None:
    frame = lit(tmp_path, "{environment: 0, lamps: [{position_m: [-0.1, -0.2, 0.2], size_m: 0.2, radiance: 6}]}")
    pose = camera_from_lamp(frame.settings.light.lamps[0], frame.camera_from_sheet)
    steps = (np.arange(200) + 0.5) / 200 * 0.2 - 0.1
    u, v = (a.ravel() for a in np.meshgrid(steps, steps))
    lamp = transform_points(pose, np.column_stack([u, v, np.zeros_like(u)]))
    expected = []
    for point, reflectance in zip(POINTS, REFLECTANCE, strict=True):
        toward = lamp - transform_points(frame.camera_from_sheet, [*point, 0.0])
        r2 = (toward**2).sum(axis=1)
        cosines = (toward @ frame.camera_from_sheet[:3, 2]) * -(toward @ pose[:3, 2]) / r2
        expected.append(reflectance / np.pi * 6 * (cosines / r2).sum() * (0.2 / 200) ** 2)
    # The square subtends half a radian: a sample scatters by some 20 %, 16,384 of them by 0.2 %.
    np.testing.assert_allclose(radiance_at(mi, frame, POINTS, 16384)[:, 0], expected, rtol=0.01)


def test_lamps_keep_their_own_light_however_often_each_is_sampled(mi, tmp_path: Path) -> None:
    a, b = (
        "{kind: point, position_m: [-0.3, -0.2, 0.1], intensity: 2.5}",
        "{kind: point, position_m: [0.4, 0, 0], intensity: 0.1}",
    )
    one, other, both = (lit(tmp_path, f"{{environment: 0.2, lamps: [{x}]}}") for x in (a, b, f"{a}, {b}"))
    apart = radiance_at(mi, one, POINTS) + radiance_at(mi, other, POINTS) - 0.2 * REFLECTANCE[:, None]
    # The weak lamp gets a tenth of the rays: an estimate scatters by about its share of the light, over 16,384^0.5.
    np.testing.assert_allclose(radiance_at(mi, both, POINTS, 16384), apart, rtol=0.02)


def test_a_colour_is_its_luminance_to_a_monochrome_camera(mi, tmp_path: Path) -> None:
    lamp = "{kind: point, position_m: [-0.3, -0.2, 0.1], intensity: 2.5%s}"
    white = radiance_at(mi, lit(tmp_path, f"{{environment: 0, lamps: [{lamp % ''}]}}"), POINTS)
    green = radiance_at(mi, lit(tmp_path, f"{{environment: 0, lamps: [{lamp % ', colour: [0, 1, 0]'}]}}"), POINTS)
    np.testing.assert_allclose(green / white, 0.71516, rtol=1e-5)
    warm = lit(tmp_path, "{environment: 1.5, environment_colour: [1.0, 0.5, 0.25]}")
    expected = 1.5 * (0.212671 + 0.5 * 0.715160 + 0.25 * 0.072169)
    np.testing.assert_allclose(radiance_at(mi, warm, POINTS)[:, 0], REFLECTANCE * expected, rtol=1e-5)


def test_a_colour_camera_sees_red_green_and_blue_and_white_as_all_three_alike(rgb, tmp_path: Path) -> None:
    light = "{environment: 1.5, environment_colour: [1.0, 0.5, 0.25]}"
    got = radiance_at(rgb, lit(tmp_path, light), POINTS)
    np.testing.assert_allclose(got, REFLECTANCE[:, None] * [1.5, 0.75, 0.375], rtol=1e-5)
    np.testing.assert_allclose(
        radiance_at(rgb, lit(tmp_path, "{environment: 2}"), POINTS), 2 * REFLECTANCE[:, None] * [1, 1, 1], rtol=1e-5
    )


def test_sky_and_mosaic_need_colours_and_a_sky_without_them_is_refused(mi, tmp_path: Path) -> None:
    sky = lit(tmp_path, "{sky: {}}")
    assert needs_colour(sky)
    assert needs_colour(lit(tmp_path, "{environment: 1}\nsensor: {mosaic: rggb}"))
    assert not needs_colour(lit(tmp_path, "{environment: 1}"))
    with pytest.raises(UsageError, match="llvm_ad_mono does not support colour"):
        emitters(mi, sky)


def test_the_sun_stands_where_its_angles_say(rgb, tmp_path: Path) -> None:
    # Before the camera, up and to the right: it is seen past the wall's edge only in thought, so the sky stands alone.
    frame = lit(tmp_path, "{sky: {sun_elevation_deg: 20, sun_azimuth_deg: 15}}")
    expected = sun_direction(frame.settings.light.sky)
    np.testing.assert_allclose(
        expected,
        [
            np.sin(np.radians(15)) * np.cos(np.radians(20)),
            -np.sin(np.radians(20)),
            np.cos(np.radians(15)) * np.cos(np.radians(20)),
        ],
    )
    y, x = np.mgrid[-240:241, -240:241] / 480.0
    directions = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3)
    sky = light_from(rgb, emitters(rgb, frame)["environment"], directions)[:, 1].reshape(x.shape)
    row, column = np.unravel_index(sky.argmax(), sky.shape)
    # The sun is 0.53 degrees wide, 4 px here: its brightest pixel is within 3 px of its centre.
    assert [column - 240, row - 240] == pytest.approx(480 * expected[:2] / expected[2], abs=3)
    assert sky[row, column] > 1000 * np.median(sky[:200])
    # Below the horizon, which the camera's height is, there is nothing.
    assert sky[250:].max() == 0


def test_the_sky_is_brighter_and_whiter_toward_the_sun(rgb, tmp_path: Path) -> None:
    frame = lit(tmp_path, "{sky: {sun_elevation_deg: 30, sun_azimuth_deg: 90, sun: 0}}")
    toward = sun_direction(frame.settings.light.sky)
    near, away = light_from(
        rgb, emitters(rgb, frame)["environment"], [toward + np.array([0, 0, 0.1]), toward * [-1, 1, 1]]
    )
    assert (near > 2 * away).all()
    assert away[2] / away[0] > 1.5 * near[2] / near[0]


def test_a_sheet_in_the_sun_is_lit_by_cosine_and_scale(rgb, tmp_path: Path) -> None:
    edits = (("tilt_deg: {uniform: [10, 50]}", "tilt_deg: 0"),)
    one, other = (lit(tmp_path, f"{{sky: {{scale: {scale}, sun_azimuth_deg: 180}}}}", *edits) for scale in (1, 3))
    a, b = (radiance_at(rgb, frame, POINTS[2:], 8192) for frame in (one, other))
    np.testing.assert_allclose(b, 3 * a, rtol=1e-4)  # the same rays
    # The default scale, 2, is to be like an environment of 1, which gives 0.8 on the paper. Here the sun stands at 45
    # degrees to it; a sheet that is turned to the sun is brighter.
    assert 0.5 < 2 * a[0, 1] < 1.0
    # Face to face with the camera, the sheet stands upright: the sun falls on it by the cosine of its elevation.
    low, high = (lit(tmp_path, f"{{sky: {{sun_elevation_deg: {e}, sun_azimuth_deg: 180}}}}", *edits) for e in (40, 80))
    dark = [
        lit(tmp_path, f"{{sky: {{sun_elevation_deg: {e}, sun_azimuth_deg: 180, sun: 0}}}}", *edits) for e in (40, 80)
    ]
    sun = [
        (radiance_at(rgb, with_sun, POINTS[2:3], 8192) - radiance_at(rgb, without, POINTS[2:3], 8192))[0, 1]
        for with_sun, without in zip((low, high), dark, strict=True)
    ]
    # A higher sun shines through less air, by some 15 % between these two (Mitsuba's own model).
    assert sun[0] / sun[1] == pytest.approx(np.cos(np.radians(40)) / np.cos(np.radians(80)), rel=0.2)


@pytest.mark.parametrize("surface", ["matte", "plastic"])
def test_sun_and_sky_are_the_same_to_both_integrators(rgb, tmp_path: Path, surface: str) -> None:
    light = "{sky: {sun_elevation_deg: 60, sun_azimuth_deg: 210}}"
    marker = (MARKER, MARKER[:-1] + f", surface: {{kind: {surface}}}}}")
    direct = radiance_at(rgb, lit(tmp_path, light, marker), POINTS[2:3], 16384)
    # A plane sees nothing of itself: a second bounce adds nothing, but takes the other way to the light.
    path = radiance_at(rgb, lit(tmp_path, light, marker, ("render: {", "render: {bounces: 2, ")), POINTS[2:3], 16384)
    # A sample of a path scatters by some 70 %, 16,384 of them by 0.5 %.
    np.testing.assert_allclose(direct, path, rtol=0.02)


def test_the_shadow_of_an_occluder_falls_where_geometry_says(mi, tmp_path: Path) -> None:
    position = [-0.3, -0.2, 0.1]
    light = f"{{environment: 0.1, lamps: [{{kind: point, position_m: {position}, intensity: 2}}]}}"
    # A long rectangle beside the sheet; its side throws a straight edge on the paper.
    edits = (
        ("frames: 4", "occluders: [{x_m: -0.18, y_m: 0, z_m: 0.08, width_m: 0.2, height_m: 0.6}]\nframes: 4"),
        ("band_samples: 256", "band_samples: 256, samples: 64"),
    )
    frame = lit(tmp_path, light, *edits)
    sheet_from_camera = np.linalg.inv(frame.camera_from_sheet)
    lamp = transform_points(sheet_from_camera, position)
    # From the lamp through the side at x = -0.08 to the print, at the height of the sheet's y = -0.05.
    t = lamp[2] / (lamp[2] - 0.08)
    edge_x = lamp[0] + t * (-0.08 - lamp[0])
    assert -0.03 < edge_x < 0.03
    # A pixel is some 2 mm wide: a scan of points on the print finds the edge to 0.1 mm.
    scan = np.arange(-0.04, 0.04, 1e-4)
    row = radiance_at(mi, frame, np.column_stack([scan, np.full_like(scan, -0.05)]), 16)[:, 0]
    lit_here = row > 0.5 * row.max()
    assert scan[np.argmax(lit_here)] == pytest.approx(edge_x, abs=2e-4)
    # In the shade there is the sky alone, and the occluder hides some of it.
    assert row[~lit_here].max() < 0.1 * PAPER * 1.001
    # And in the picture: the pixels to both sides of the edge's image, a pixel away.
    picture = render_radiance(mi, frame).mean
    ends = transform_points(frame.camera_from_sheet, [[edge_x, -0.05, 0.0], [edge_x + 1e-3, -0.05, 0.0]])
    image = ends @ frame.camera.K.T
    image = image[:, :2] / image[:, 2:]
    along = (image[1] - image[0]) / np.linalg.norm(image[1] - image[0])
    into_light, into_shade = (np.rint(image[0] + s * 1.5 * along).astype(int) for s in (1, -1))
    assert picture[into_light[1], into_light[0]] > 0.9 * row.max()
    assert picture[into_shade[1], into_shade[0]] < 0.5 * row.max()


@pytest.mark.parametrize("kind", ["plastic", "laminate"])
def test_a_gloss_has_its_highlight_where_a_mirror_would(mi, tmp_path: Path, kind: str) -> None:
    # Straight above the camera's own line: the mirror image of the lamp stands within the sheet.
    light = "{environment: 0.2, lamps: [{position_m: [0.0, -0.15, 0.0], size_m: 0.06, radiance: 30}]}"
    frontal = (
        ("tilt_deg: {uniform: [10, 50]}", "tilt_deg: 0"),
        ("offset_x_px: {uniform: [-20, 20]}", "offset_x_px: 0"),
    )
    glossy = lit(
        tmp_path,
        light,
        *frontal,
        (MARKER, MARKER[:-1] + f", margin_m: 0.2, surface: {{kind: {kind}, roughness: 0.05}}}}"),
    )
    matte = lit(tmp_path, light, *frontal, (MARKER, MARKER[:-1] + ", margin_m: 0.2}"))
    # Face to face at a distance d, a lamp 0.15 m above the camera is mirrored 0.075 m above the centre: Y is up.
    scan = np.column_stack([np.zeros(61), np.linspace(-0.15, 0.15, 61)])
    paper = np.abs(scan[:, 1]) > 0.041
    bright, plain = (radiance_at(mi, frame, scan[paper], 2048)[:, 0] for frame in (glossy, matte))
    place = scan[paper][np.argmax(bright), 1]
    assert place == pytest.approx(0.075, abs=0.01)
    assert bright.max() > 1.3 * plain.max()
    # Away from it the gloss takes light rather than giving it.
    assert bright[0] < 1.1 * plain[0]


@pytest.mark.parametrize("kind", ["matte", "plastic", "laminate"])
def test_no_surface_gives_back_more_light_than_falls_on_it(mi, tmp_path: Path, kind: str) -> None:
    marker = MARKER[:-1] + f", paper: 1.0, surface: {{kind: {kind}}}}}"
    got = radiance_at(mi, lit(tmp_path, "{environment: 1}", (MARKER, marker)), POINTS[2:], 16384)[:, 0]
    # A furnace: white paper under a white sky is white at most; single scattering at the gloss loses a little. The
    # principled model is not exact here, and its coat is added on top.
    assert (got < (1.1 if kind == "laminate" else 1.005)).all()
    assert (got > 0.85).all()


def test_a_second_bounce_lights_the_shade(mi, tmp_path: Path) -> None:
    light = "{environment: 0, lamps: [{kind: point, position_m: [-0.3, -0.2, 0.1], intensity: 2}]}"
    occluder = (
        "frames: 4",
        "occluders: [{x_m: -0.12, y_m: 0, z_m: 0.08, width_m: 0.08, height_m: 0.2, reflectance: 0.9}]\nframes: 4",
    )
    shade = np.array([[-0.05, -0.05]])
    once = radiance_at(mi, lit(tmp_path, light, occluder), shade, 1024)
    more = lit(tmp_path, light, occluder, ("render: {", "render: {bounces: 3, "))
    assert once[0, 0] == 0
    assert radiance_at(mi, more, shade, 4096)[0, 0] > 1e-4
    # A plane alone sees nothing of itself.
    plane = lit(tmp_path, light, ("render: {", "render: {bounces: 3, "))
    np.testing.assert_allclose(radiance_at(mi, plane, POINTS), radiance_at(mi, lit(tmp_path, light), POINTS), rtol=1e-5)


def test_beside_the_wall_the_environment_is_seen(mi, tmp_path: Path) -> None:
    frame = lit(tmp_path, "{environment: 0.7}")
    np.testing.assert_allclose(radiance_along(mi, frame, [[0.0, 0.0, -1.0]]), 0.7, rtol=1e-6)


@pytest.mark.parametrize(
    ("light", "message"),
    [
        ("{environment: 0}", "light.lamps: no light reaches the print"),
        ("{environment: 0, lamps: [{position_m: [0, 0, 2], size_m: 0.1, radiance: 5}]}", "no light reaches the print"),
        ("{environment: 0, lamps: [{kind: point, position_m: [-0.3, 0, 0], intensity: 0}]}", "no light reaches"),
        (
            "{environment: 0, lamps: [{kind: spot, position_m: [0, 0, 0], intensity: 1, aim_x_m: 5}]}",
            "no light reaches the print",
        ),
        ("{lamps: [{kind: spot, position_m: [0, 0, 0], intensity: 1, beam_deg: 20}]}", "beam_deg must be smaller"),
        ("{lamps: [{kind: spot, position_m: [0, 0, 0], intensity: 1, cutoff_deg: 120}]}", "at most 90"),
        ("{lamps: [{kind: bulb, position_m: [0, 0, 0]}]}", "unknown kind 'bulb'"),
        ("{sky: {sun_elevation_deg: 0}}", "an elevation must be between 5 and 90"),
        ("{sky: {turbidity: 20}}", "a turbidity must be between 1"),
        ("{sky: {scale: 0}}", "no light reaches the print"),
    ],
)
def test_light_that_cannot_be_is_one_clear_line(tmp_path: Path, light: str, message: str) -> None:
    with pytest.raises(StudyError, match=message) as caught:
        lit(tmp_path, light)
    assert caught.value.line == 11
    assert "\n" not in str(caught.value)


def test_a_lamp_where_it_aims_is_refused(tmp_path: Path) -> None:
    edits = (
        ("offset_x_px: {uniform: [-20, 20]}", "offset_x_px: 0"),
        ("distance_D: {uniform: [7, 9]}", "distance_m: 0.5"),
    )
    with pytest.raises(StudyError, match=r"light\.lamps\.0: is at the point it faces"):
        lit(tmp_path, "{lamps: [{position_m: [0, 0, 0.5], size_m: 0.1, radiance: 1}]}", *edits)


def test_a_lamp_faces_its_aim_with_the_axes_of_a_right_hand() -> None:
    for aim in ([0.3, 0.1, 1.0], [0.0, 2.0, 0.0], [0.0, -1.0, 0.1]):
        pose = facing([0.1, 0.2, 0.3], aim)
        np.testing.assert_allclose(pose[:3, :3].T @ pose[:3, :3], np.eye(3), atol=1e-15)
        assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
        toward = np.array(aim) - [0.1, 0.2, 0.3]
        np.testing.assert_allclose(pose[:3, 2], toward / np.linalg.norm(toward), atol=1e-15)


def test_the_sun_behind_the_camera_has_negative_z() -> None:
    behind = sun_direction(SkySection(sun_elevation_deg=45.0, sun_azimuth_deg=180.0))
    np.testing.assert_allclose(behind, [0, -np.sqrt(0.5), -np.sqrt(0.5)], atol=1e-15)


RANDOM_LAMP = (
    "{position_m: [{uniform: [-0.4, 0.4]}, {uniform: [-0.6, -0.2]}, 0.1], size_m: {uniform: [0.05, 0.2]}, "
    "radiance: {uniform: [1, 10]}}"
)
OCCLUDER = "{z_m: {uniform: [0.05, 0.1]}, width_m: 0.04, turn_deg: {uniform: [0, 90]}, reflectance: {uniform: [0, 1]}}"
GLOSS = "surface: {kind: %s, roughness: {uniform: [0.05, 0.3]}, ior: {uniform: [1.3, 1.6]}}"


@pytest.mark.parametrize(
    ("variant", "light", "marker"),
    [
        ("mono", f"{{environment: {{uniform: [0.1, 1]}}, lamps: [{RANDOM_LAMP}]}}", GLOSS % "plastic"),
        ("mono", f"{{environment: {{uniform: [0.1, 1]}}, lamps: [{RANDOM_LAMP}]}}", GLOSS % "laminate"),
        (
            "rgb",
            "{sky: {sun_elevation_deg: {uniform: [10, 80]}, turbidity: {uniform: [2, 8]}, scale: {uniform: [1, 3]}}}",
            "",
        ),
    ],
    ids=["plastic", "laminate", "sky"],
)
def test_frames_that_differ_in_numbers_share_their_kernels(
    tmp_path: Path, variant: str, light: str, marker: str
) -> None:
    mi = start(f"llvm_ad_{variant}")
    import drjit as dr

    edits = (("frames: 4", f"occluders: [{OCCLUDER}]\nframes: 4"), (MARKER, MARKER[:-1] + f", {marker}}}"))
    study = small_study(tmp_path, (LIGHT, f"light: {light}"), *edits)
    compiled = []
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        for i in range(3):
            dr.kernel_history()
            radiance_at(mi, frame_of(study, i), POINTS, 16)
            kernels = [k for k in dr.kernel_history() if k["type"] == dr.KernelType.JIT]
            assert kernels
            compiled.append(sum(not k["cache_hit"] for k in kernels))
    start()
    # The first frame may find its kernels on disk; the others must find them.
    assert compiled[1:] == [0, 0]
