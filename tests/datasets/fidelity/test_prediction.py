"""The float64 prediction, against brute force in the opposite direction, and against closed forms."""

from pathlib import Path

import numpy as np
import pytest
from helpers_effects import CAMERA, DISTORTION, EFFECTS, TWIST, motion
from helpers_images import coverage as ellipse_coverage
from helpers_images import coverage_through_lens
from helpers_studies import small_study
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import j1

from roundel.datasets.fidelity.pixel_coverage import Areas
from roundel.datasets.fidelity.prediction import nodes_for, predict
from roundel.datasets.fidelity.quadrature import AIRY_LIMIT, area_radius_m
from roundel.scenes.camera.model import normalise, undistort_px
from roundel.scenes.camera.motion import pose_at
from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic
from roundel.scenes.markers.ink_pattern import reflectance_at
from roundel.scenes.world.frame import Frame, frame_of

FACING = (("{uniform: [10, 50]}", "0"), ("{uniform: [-20, 20]}", "0"))
WINDOW = (0, 0, 120, 160)


def predict_coverage(frame, part, window=None, nodes=None):
    """The window's first pixel, and the coverage in it."""
    seen = predict(frame, part, window, nodes_for(frame, nodes))
    return seen.row0, seen.col0, seen.coverage


def ellipse_of(frame: Frame) -> np.ndarray:
    part = frame.sheet.parts[0]
    return ellipse_of_conic(conic_of_circle(frame.camera_from_part(part), part.radius_m, frame.camera.K))


def moments(row0: int, col0: int, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centre of mass and variance along x and y of an image."""
    y, x = np.mgrid[: weight.shape[0], : weight.shape[1]].astype(float)
    w, at = weight / weight.sum(), np.stack([x + col0, y + row0])
    centre = (w * at).sum(axis=(1, 2))
    return centre, (w * (at - centre[:, None, None]) ** 2).sum(axis=(1, 2))


def test_a_sharp_disc_is_its_ellipse(tmp_path: Path) -> None:
    frame = frame_of(small_study(tmp_path), 0)
    e = ellipse_of(frame)
    _, _, found = predict_coverage(frame, frame.sheet.parts[0], WINDOW)
    # 64 x 64 subpixels leave half a row of them where the edge runs along it.
    np.testing.assert_allclose(found, ellipse_coverage(e, 160, 120, subpixels=64), atol=0.5 / 64)
    # The chords' sagitta of 1e-6 px, round a perimeter of 100 px, if the polygon were not of equal area.
    assert found.sum() == pytest.approx(np.pi * e[2] * e[3], abs=1e-4)


def test_a_distorted_disc_is_its_ellipse_through_the_lens(tmp_path: Path) -> None:
    frame = frame_of(small_study(tmp_path, *EFFECTS["distortion"]), 0)
    _, _, found = predict_coverage(frame, frame.sheet.parts[0], WINDOW)
    # 32 x 32 subpixels, as above.
    np.testing.assert_allclose(found, coverage_through_lens(ellipse_of(frame), frame.camera, 32), atol=0.5 / 32)


@given(
    st.integers(3, 40),
    st.floats(0.2, 1.0),
    st.floats(2.0, 20.0),
    st.floats(-0.5, 0.5),
    st.floats(-0.5, 0.5),
    st.integers(0, 2**31),
)
def test_areas_of_any_star_add_up(corners, side, size, x, y, seed) -> None:
    radius = size * np.random.default_rng(seed).uniform(0.2, 1.0, corners)
    turn = 2 * np.pi * np.arange(corners) / corners
    px, py = 25 + x + radius * np.cos(turn), 25 + y + radius * np.sin(turn)
    qx, qy = np.roll(px, -1), np.roll(py, -1)
    whole, part = Areas(0, 0, 50, 50), Areas(0, 0, 50, 50, side)
    for sums in (whole, part):
        sums.add(px, py, qx, qy, np.ones((1, corners)))
        inside = sums.inside()[0]
        assert inside.min() > -1e-9
        assert inside.max() < 1 + 1e-9
    # Pixels without gaps miss nothing: the shoelace formula; and a closed curve's projections cancel.
    assert whole.inside().sum() == pytest.approx(np.sum(px * qy - qx * py) / 2, rel=1e-9)
    np.testing.assert_allclose(whole.derivatives()[:2].sum(axis=(1, 2)), 0.0, atol=1e-9)
    assert whole.derivatives()[2].sum() == pytest.approx(np.hypot(qx - px, qy - py).sum(), rel=1e-9)


def test_squares_with_gaps_see_what_lies_in_them() -> None:
    # A half plane, as a large box, whose edge crosses the squares at x = 10.1; they reach 0.3 to both sides of 10.
    x, y = np.array([-5.0, 10.1, 10.1, -5.0]), np.array([-5.0, -5.0, 25.0, 25.0])
    sums = Areas(0, 0, 20, 20, side=0.6)
    sums.add(x, y, np.roll(x, -1), np.roll(y, -1), np.ones((1, 4)))
    row = sums.inside()[0, 7]
    np.testing.assert_allclose(row[:10], 1.0, atol=1e-12)
    assert row[10] == pytest.approx(0.4 / 0.6)
    np.testing.assert_allclose(row[11:], 0.0, atol=1e-12)
    # A shift by d uncovers d of the square's width; in the gap beyond it would uncover nothing.
    assert sums.derivatives()[0, 7, 10] == pytest.approx(1 / 0.6)


def brute_force(frame: Frame, rows: np.ndarray, columns: np.ndarray, count: int) -> np.ndarray:
    """Coverage (n,) of pixels by rays from the pixel to the scene, drawn at random; one wavelength, round aperture."""
    camera, motion, part = frame.camera, frame.motion, frame.sheet.parts[0]
    rng = np.random.default_rng(5)
    out = []
    # The Airy pattern by rejection: a table of the intensity itself, r dr (2 J1(x) / x)^2.
    x = np.linspace(0, AIRY_LIMIT, 200_001)[1:]
    cumulative = np.cumsum((2 * j1(x) / x) ** 2 * x)
    for row, column in zip(rows, columns, strict=True):
        px = np.array([column, row]) + camera.pixel_side * (rng.random((count, 2)) - 0.5)
        if camera.wavelengths_m:
            scale = rng.choice(camera.wavelengths_m, count) / (2 * np.pi * area_radius_m(camera))
            alpha = np.interp(rng.random(count), cumulative / cumulative[-1], x) * scale
            turn = rng.uniform(0, 2 * np.pi, count)
            px += (camera.K[:2, :2] @ (alpha * np.stack([np.cos(turn), np.sin(turn)]))).T
        xy = normalise(camera, undistort_px(camera, px))
        lens = np.zeros((count, 2))
        if camera.aperture_radius_m > 0:
            radius, turn = np.sqrt(rng.random(count)), rng.uniform(0, 2 * np.pi, count)
            lens = camera.aperture_radius_m * radius[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
            if camera.blades:
                corner = np.radians(camera.blade_turn_deg) + 2 * np.pi / camera.blades * (
                    rng.integers(0, camera.blades, count) + np.array([[0], [1]])
                )
                a, b = (camera.aperture_radius_m * np.stack([np.cos(c), np.sin(c)], axis=1) for c in corner)
                s, t = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
                lens = s * ((1 - t) * a + t * b)
        focus = camera.focus_distance_m if np.isfinite(camera.focus_distance_m) else 1e9
        origin = np.column_stack([lens, np.zeros(count)])
        direction = np.column_stack([xy * focus, np.full(count, focus)]) - origin
        time = motion.row_time_s(row) + motion.exposure_s * (rng.random(count) - 0.5)
        pose = pose_at(motion, frame.camera_from_sheet, time)
        normal = pose[:, :3, 2]
        along = np.sum((pose[:, :3, 3] - origin) * normal, axis=1) / np.sum(direction * normal, axis=1)
        at = origin + along[:, None] * direction - pose[:, :3, 3]
        r = np.hypot(np.sum(at * pose[:, :3, 0], axis=1), np.sum(at * pose[:, :3, 1], axis=1))
        softness = frame.sheet.edge_softness_m
        inside = (part.radius_m - r) / softness + 0.5 if softness > 0 else (r < part.radius_m).astype(float)
        out.append(np.clip(inside, 0, 1).mean())
    return np.array(out)


FILLED = ("light:", "sensor: {fill_factor: 0.5}\nlight:")


@pytest.mark.parametrize(
    "edits",
    [
        *(EFFECTS[name] for name in ("defocus", "diffraction", "motion", "rolling_shutter", "soft_edges", "all")),
        (*EFFECTS["all"], FILLED),
        (*EFFECTS["sharp"], FILLED),
    ],
    ids=["defocus", "diffraction", "motion", "rolling_shutter", "soft_edges", "all", "all_filled", "filled"],
)
def test_blurred_edges_are_what_rays_from_the_pixels_see(tmp_path: Path, edits) -> None:
    frame = frame_of(small_study(tmp_path, *edits), 0)
    row0, col0, found = predict_coverage(frame, frame.sheet.parts[0])
    edge = np.argwhere((found > 0.05) & (found < 0.95))
    chosen = edge[np.linspace(0, len(edge) - 1, 60).astype(int)]
    count = 10_000
    brute = brute_force(frame, chosen[:, 0] + row0, chosen[:, 1] + col0, count)
    predicted = found[chosen[:, 0], chosen[:, 1]]
    # Binomial errors; a soft edge has less. 60 scores have an RMS of 1 +- 0.09, and the worst stays below 4.5.
    score = (brute - predicted) / np.sqrt(predicted * (1 - predicted) / count)
    assert np.abs(score).max() < 4.5
    assert np.sqrt(np.mean(score**2)) < 1.3


def test_defocus_adds_the_variance_of_its_disc(tmp_path: Path) -> None:
    wide = (CAMERA, CAMERA + ", aperture_mm: 60, focus_m: 0.45")
    frame = frame_of(small_study(tmp_path, wide, *FACING), 0)
    part = frame.sheet.parts[0]
    _, sharp = moments(*predict_coverage(frame_of(small_study(tmp_path, *FACING), 0), part))
    _, blurred = moments(*predict_coverage(frame, part))
    camera, z = frame.camera, frame.camera_from_sheet[2, 3]
    radius = camera.K[0, 0] * camera.aperture_radius_m * abs(1 / z - 1 / camera.focus_distance_m)
    assert radius > 6
    # The variance of a disc along one axis is R^2 / 4. Whole pixels see the variance of a sharp disc to 0.01 px^2.
    np.testing.assert_allclose(blurred - sharp, radius**2 / 4, atol=0.02)


def test_motion_adds_the_variance_of_its_path(tmp_path: Path) -> None:
    moving = motion("exposure_s: 0.05, camera: {velocity_m_s: [0.5, 0, 0]}")
    frame = frame_of(small_study(tmp_path, moving, *FACING), 0)
    part = frame.sheet.parts[0]
    centre, sharp = moments(*predict_coverage(frame_of(small_study(tmp_path, *FACING), 0), part))
    middle, blurred = moments(*predict_coverage(frame, part))
    length = 320 * 0.5 * 0.05 / frame.camera_from_sheet[2, 3]
    assert length > 10
    # A uniform path of length L has the variance L^2 / 12; pixels as above.
    np.testing.assert_allclose(blurred - sharp, [length**2 / 12, 0], atol=0.02)
    np.testing.assert_allclose(middle, centre, atol=1e-3)


def test_a_rolling_shutter_shears(tmp_path: Path) -> None:
    # Camera to the right at constant speed: the image goes left, row by row further: x = x0 - v t(row).
    moving = motion("exposure_s: 0, readout_s: 0.12, camera: {velocity_m_s: [0.5, 0, 0]}")
    frame = frame_of(small_study(tmp_path, moving, *FACING), 0)
    part = frame.sheet.parts[0]
    row0, col0, found = predict_coverage(frame, part)
    row1, col1, still = predict_coverage(frame_of(small_study(tmp_path, *FACING), 0), part)
    speed = 320 * 0.5 / frame.camera_from_sheet[2, 3]
    for row in range(row1 + 6, row1 + still.shape[0] - 6):
        now, then = found[row - row0], still[row - row1]
        shift = (now @ np.arange(len(now)) / now.sum() + col0) - (then @ np.arange(len(then)) / then.sum() + col1)
        assert now.sum() == pytest.approx(then.sum(), abs=1e-6)
        # Where in a pixel the edge is, its whole does not tell: an eighth of a pixel at most, over a row of thirty.
        assert shift == pytest.approx(-speed * (row - frame.motion.centre_row_px) * 0.12 / 120, abs=0.01)


def test_soft_edges_keep_their_light(tmp_path: Path) -> None:
    frame = frame_of(small_study(tmp_path, *EFFECTS["soft_edges"], *FACING), 0)
    _, _, found = predict_coverage(frame, frame.sheet.parts[0])
    scale = 320 / frame.camera_from_sheet[2, 3]
    # The mean of pi r^2 over the ramp's width w: pi (R^2 + w^2 / 12).
    area = np.pi * scale**2 * (0.04**2 + 0.004**2 / 12)
    assert found.sum() == pytest.approx(area, rel=1e-6)


BLURRED = [name for name in EFFECTS if name not in ("sharp", "distortion", "all")]


@pytest.mark.parametrize("name", [*BLURRED, pytest.param("all", marks=pytest.mark.slow)])
def test_the_nodes_are_enough(tmp_path: Path, name: str) -> None:
    frame = frame_of(small_study(tmp_path, *EFFECTS[name]), 0)
    part, nodes = frame.sheet.parts[0], nodes_for(frame)
    seen = predict(frame, part, nodes=nodes)
    window = (seen.row0, seen.col0, *seen.coverage.shape)
    _, _, finer = predict_coverage(frame, part, window, 2 * len(nodes))
    edge = (finer > 0.02) & (finer < 0.98)
    error = (seen.coverage - finer)[edge]
    # What the measurement of fidelity declares as the prediction's own error.
    assert np.sqrt(np.mean(error**2)) < 1e-3
    slopes = np.stack([a[edge] / seen.step for a in (seen.shift_x, seen.shift_y, seen.growth)], axis=1)
    shift, *_ = np.linalg.lstsq(slopes, error, rcond=None)
    # A tenth of the bias that is promised of a blurred edge.
    assert np.abs(shift[:2]).max() < 5e-4


@pytest.mark.parametrize(
    "marker",
    [
        "{kind: ring, diameter_m: 0.08, inner_diameter_m: 0.07, margin_m: 0.004}",
        "{kind: disc_with_tick, diameter_m: 0.08, margin_m: 0.002}",
        "{kind: two_discs, diameter_m: 0.05, second_diameter_m: 0.04, spacing_m: 0.048}",
        "{kind: disc_with_chessboard, diameter_m: 0.05, gap_m: 0.003, "
        "chessboard: {columns: 3, rows: 4, square_m: 0.01}}",
    ],
    ids=["ring", "tick", "two_discs", "board"],
)
def test_the_pattern_round_a_circle_is_that_of_the_print(tmp_path: Path, marker: str) -> None:
    kind = ("{kind: disc, diameter_m: 0.08}", marker)
    distance = ("distance_D: {uniform: [7, 9]}", "distance_m: 0.5")
    frame = frame_of(small_study(tmp_path, kind, distance, (CAMERA, f"{CAMERA}, {DISTORTION}")), 0)
    seen = predict(frame, frame.sheet.parts[0])
    band = np.argwhere((seen.coverage > 1e-9) & (seen.coverage < 1 - 1e-9))
    # Every other pixel of the band and its neighbour, by 24 x 24 rays through each.
    band = np.concatenate([band[::2], band[::2] + np.array([1, -1])])
    fine = (np.arange(24) + 0.5) / 24 - 0.5
    step = np.stack(np.meshgrid(fine, fine), axis=-1).reshape(-1, 2)
    px = (band[:, ::-1] + [seen.col0, seen.row0])[:, None] + step
    xy = normalise(frame.camera, undistort_px(frame.camera, px))
    pose = frame.camera_from_sheet
    ray = np.concatenate([xy, np.ones((*xy.shape[:-1], 1))], axis=-1)
    at = ray * (pose[:3, 2] @ pose[:3, 3] / (ray @ pose[:3, 2]))[..., None] - pose[:3, 3]
    brute = reflectance_at(frame.sheet, at @ pose[:3, 0], at @ pose[:3, 1]).mean(axis=1)
    # An edge along a row of subpixels: 0.75 / 24 of the step at worst.
    np.testing.assert_allclose(seen.pattern[band[:, 0], band[:, 1]], brute, atol=0.012)


def test_light_that_falls_off_is_followed_to_where_it_falls(tmp_path: Path) -> None:
    # Under light 1 + g (x - x0) in the sharp image, a defocused image is the blur of light times pattern.
    frame = frame_of(small_study(tmp_path, *EFFECTS["defocus"], *FACING), 0)
    seen = predict(frame, frame.sheet.parts[0])
    z, camera = frame.camera_from_sheet[2, 3], frame.camera
    radius = camera.K[0, 0] * camera.aperture_radius_m * abs(1 / z - 1 / camera.focus_distance_m)
    # A fronto-parallel disc through the middle: along the row through its centre, both edges pull their own way.
    row = round(frame.motion.centre_row_px) - seen.row0
    left, right = seen.drift_x[row, : seen.drift_x.shape[1] // 2], seen.drift_x[row, seen.drift_x.shape[1] // 2 :]
    # A straight edge's line spread is 2 / (pi R^2) (R^2 - s^2)^(1/2); its first moment beyond 0 is 2 R / (3 pi).
    peak = 0.75 * 2 * radius / (3 * np.pi)
    assert left.min() == pytest.approx(-peak, rel=0.05)
    assert right.max() == pytest.approx(peak, rel=0.05)


def test_what_outruns_the_shutter_is_said(tmp_path: Path) -> None:
    # Fast, but not so fast that the frame itself is refused: upward by nearly a row a row.
    moving = motion("exposure_s: 0, readout_s: 0.12, marker: {velocity_m_s: [0, -1.86, 0]}")
    frame = frame_of(small_study(tmp_path, moving, *FACING, ("{uniform: [7, 9]}", "8")), 0)
    with pytest.raises(ValueError, match="rows while one row is read"):
        predict_coverage(frame, frame.sheet.parts[0])


def test_a_moving_marker_does_not_move_its_light(tmp_path: Path) -> None:
    still = frame_of(small_study(tmp_path, motion(f"exposure_s: 0.02, {TWIST}".replace("camera", "marker"))), 0)
    seen = predict(still, still.sheet.parts[0])
    # What differs is the edge, not the light: nothing drifts.
    assert np.abs(seen.drift_x).max() < 1e-9
