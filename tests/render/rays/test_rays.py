"""The rays of pixels, against the forward projection of `scenes` in float64."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from helpers_studies import small_study

from roundel.render.rays.rays import optics_of, shoot
from roundel.scenes.camera.airy import encircled_energy
from roundel.scenes.camera.model import denormalise, distort_px, normalise
from roundel.scenes.camera.motion import pose_at
from roundel.scenes.study.sensor_section import filters_of
from roundel.scenes.world.frame import frame_of

MOVING = (
    "pose:",
    "motion: {exposure_s: 0.01, readout_s: 0.02, camera: {velocity_m_s: [0.3, 0.2, -0.4], rate_deg_s: [40, 10, 50]},\n"
    "         marker: {velocity_m_s: [0.1, 0, 0.2], rate_deg_s: [0, 60, 0]}}\npose:",
)


class Fixed:
    """A sampler that gives the same numbers in turn: what a ray is made of can then be said."""

    def __init__(self, mi, *numbers) -> None:
        self.mi, self.numbers = mi, list(numbers)

    def next_1d(self):
        return self.mi.Float(np.asarray(self.numbers.pop(0), dtype=np.float32))

    def next_2d(self):
        return self.mi.Point2f(*(self.mi.Float(np.asarray(n, dtype=np.float32)) for n in self.numbers.pop(0)))


def shot(mi, frame, columns, rows, *numbers):
    """Origins and directions (n, 3), weights (n,) in float64."""
    import drjit as dr  # after `start`, which chooses the LLVM that it loads

    optics = optics_of(dr, mi, frame)
    pixel = (mi.UInt32(np.asarray(a, dtype=np.uint32)) for a in (columns, rows))
    ray, weight = shoot(dr, mi, optics, *pixel, Fixed(mi, *numbers))
    o, d = np.array(ray.o, dtype=float).T, np.array(ray.d, dtype=float).T
    o = np.broadcast_to(o, d.shape)
    return o, d, np.broadcast_to(np.array(weight, dtype=float), len(d))


def plane_hits(frame, o, d):
    """Where rays meet the sheet's plane at time 0, in the sheet's frame."""
    pose = frame.camera_from_sheet
    distance = ((pose[:3, 3] - o) @ pose[:3, 2]) / (d @ pose[:3, 2])
    return (o + d * distance[:, None] - pose[:3, 3]) @ pose[:3, :3]


@pytest.mark.parametrize("edits", [(), (MOVING,)], ids=["still", "moving"])
@pytest.mark.parametrize(
    "aperture", ["", ", aperture_mm: 20, focus_m: 0.5", ", aperture_mm: 20, focus_m: 0.5, blades: 6"]
)
def test_a_ray_meets_the_point_that_is_imaged_where_it_began(mi, tmp_path: Path, edits, aperture) -> None:
    lens = ("focal_px: 320", f"focal_px: 320, aspect: 1.1, skew_px: 3{aperture}")
    frame = frame_of(small_study(tmp_path, lens, *edits), 0)
    camera, motion = frame.camera, frame.motion
    random = np.random.default_rng(4)
    n = 300
    columns, rows = random.integers(0, camera.width_px, n), random.integers(0, camera.height_px, n)
    jitter, at, tau = random.random((2, n)), random.random((2, n)), random.random(n)
    numbers = [jitter, at] if aperture else [jitter]
    o, d, _ = shot(mi, frame, columns, rows, *numbers, tau)
    points = plane_hits(frame, o, d)
    time = motion.row_time_s(rows) + (tau - 0.5) * motion.exposure_s if motion.moves else np.zeros(n)
    poses = pose_at(motion, frame.camera_from_sheet, time)
    seen = np.einsum("nij,nj->ni", poses[:, :3, :3], points) + poses[:, :3, 3]
    normalised = seen[:, :2] / seen[:, 2:]
    if aperture:
        still = frame_of(small_study(tmp_path, lens, name="still.yaml"), 0)
        lens_point = shot(mi, still, columns, rows, jitter, at)[0][:, :2]
        assert np.hypot(*lens_point.T).max() <= camera.aperture_radius_m * (1 + 1e-6)
        normalised = normalised + lens_point * (1 / camera.focus_distance_m - 1 / seen[:, 2:])
    px = distort_px(camera, denormalise(camera, normalised))
    # float32 has seven digits: of a distance of 0.7 m, at 320 px a metre's slope, some 1e-4 px.
    np.testing.assert_allclose(px, np.stack([columns, rows], -1) + (jitter.T - 0.5), atol=1e-3)


def test_fill_factor_shrinks_the_pixel(mi, tmp_path: Path) -> None:
    frame = frame_of(small_study(tmp_path, ("light:", "sensor: {fill_factor: 0.25}\nlight:")), 0)
    _, d, _ = shot(mi, frame, [10, 10], [20, 20], [[0.0, 1.0], [0.0, 1.0]])
    px = denormalise(frame.camera, d[:, :2] / d[:, 2:])
    np.testing.assert_allclose(px, [[9.75, 19.75], [10.25, 20.25]], atol=1e-4)


def test_airy_offsets_have_the_declared_energy(mi, tmp_path: Path) -> None:
    lens = ("focal_px: 320", "focal_px: 320, aperture_mm: 0.1, focus_m: 0.5, diffraction: true, wavelengths_nm: [600]")
    frame = frame_of(small_study(tmp_path, lens), 0)
    n = 20_000
    random = np.random.default_rng(1)
    numbers = [np.full((2, n), 0.5), random.random((2, n)), np.full((2, n), 0.5)]
    _, d, _ = shot(mi, frame, np.full(n, 80), np.full(n, 60), *numbers)
    xy = d[:, :2] / d[:, 2:] - normalise(frame.camera, np.array([80.0, 60.0]))
    x = np.hypot(*xy.T) * 2 * np.pi * 0.05e-3 / 600e-9
    # Energy within x is uniform over the draws; 1.95 / sqrt(n) (Kolmogorov, Smirnov) is exceeded once in a thousand.
    energy = np.sort(encircled_energy(x))
    assert np.abs(energy - (np.arange(n) + 0.5) / n).max() < 1.95 / np.sqrt(n)
    assert np.abs(np.mean(np.arctan2(*xy.T))) < 5 * np.pi / np.sqrt(3 * n)


def test_a_mosaic_diffracts_each_colour_by_its_own_wavelength(mi, tmp_path: Path) -> None:
    lens = (
        "focal_px: 320",
        "focal_px: 320, aperture_mm: 0.1, focus_m: 0.5, diffraction: true, wavelengths_nm: [600, 500, 400]",
    )
    frame = frame_of(small_study(tmp_path, lens, ("light:", "sensor: {mosaic: grbg}\nlight:")), 0)
    columns, rows = [80, 81, 80, 81], [60, 60, 61, 61]
    numbers = [np.full((2, 4), 0.5), np.array([np.full(4, 0.7), np.zeros(4)]), np.full((2, 4), 0.5)]
    _, d, _ = shot(mi, frame, columns, rows, *numbers)
    offset = d[:, 0] / d[:, 2] - normalise(frame.camera, np.stack([columns, rows], -1).astype(float))[:, 0]
    # Green, red, blue, green: the offset is proportional to the wavelength.
    np.testing.assert_allclose(offset / offset[0], [1, 600 / 500, 400 / 500, 1], rtol=1e-3)
    assert filters_of("grbg") == (1, 0, 2, 1)


def test_an_aperture_of_blades_is_filled_evenly(mi, tmp_path: Path) -> None:
    lens = ("focal_px: 320", "focal_px: 320, aperture_mm: 20, focus_m: 0.5, blades: 5, blade_turn_deg: 90")
    frame = frame_of(small_study(tmp_path, lens), 0)
    n = 40_000
    at = np.random.default_rng(2).random((2, n))
    o, _, _ = shot(mi, frame, np.full(n, 80), np.full(n, 60), np.full((2, n), 0.5), at)
    x, y = o[:, 0] / 0.01, o[:, 1] / 0.01
    # Five corners, the first at +y: its five sides are never crossed, and are reached.
    for k in range(5):
        side = np.radians(90 + 36 + 72 * k)
        across = x * np.cos(side) + y * np.sin(side)
        assert np.cos(np.radians(36)) * 0.99 < across.max() <= np.cos(np.radians(36)) + 1e-5
    # Moments of a regular pentagon: mean 0, variance (2 + cos 72) / 12 along each axis; 5 sigma of 40,000 draws.
    variance = (2 + np.cos(np.radians(72))) / 12
    for axis in (x, y):
        assert abs(axis.mean()) < 5 * np.sqrt(variance / n)
        assert axis.var() == pytest.approx(variance, rel=5 * np.sqrt(2 / n))


def test_natural_vignetting_is_the_fourth_power_of_the_cosine(mi, tmp_path: Path) -> None:
    frame = frame_of(small_study(tmp_path, ("focal_px: 320", "focal_px: 320, natural_vignetting: true")), 0)
    _, d, weight = shot(mi, frame, [0, 80, 159], [0, 60, 119], np.full((2, 3), 0.5))
    np.testing.assert_allclose(weight, d[:, 2] ** 4, rtol=1e-5)
    assert weight[0] < 0.9 < weight[1]


def test_a_barrel_cuts_the_rays_that_miss_its_opening(mi, tmp_path: Path) -> None:
    lens = ("focal_px: 320", "focal_px: 100, aperture_mm: 10, focus_m: 0.5, barrel_mm: 10, barrel_length_mm: 10")
    frame = frame_of(small_study(tmp_path, lens, ("{uniform: [7, 9]}", "4")), 0)
    n = 4000
    at = np.random.default_rng(3).random((2, n))
    _, _, axis = shot(mi, frame, np.full(n, 80), np.full(n, 60), np.full((2, n), 0.5), at)
    _, _, corner = shot(mi, frame, np.zeros(n), np.zeros(n), np.full((2, n), 0.5), at)
    chief = normalise(frame.camera, np.array([0.0, 0.0]))
    # Two discs of radius 5 mm whose centres stand 10 mm x tan(field angle) apart: the area of their lens (Weisstein).
    apart = np.hypot(*chief) * 10 / 5
    overlap = (2 * np.arccos(apart / 2) - apart / 2 * np.sqrt(4 - apart**2)) / np.pi
    assert axis.mean() > 0.98
    assert corner.mean() == pytest.approx(overlap, abs=5 * np.sqrt(overlap / n))
    assert set(np.unique(corner)) == {0.0, 1.0}


def test_numbers_of_a_frame_do_not_change_the_kernel(mi, tmp_path: Path) -> None:
    # A kernel of its own for each frame would cost more than its rays.
    import drjit as dr

    from roundel.render.radiance import render_radiance

    study = small_study(tmp_path, MOVING, ("focal_px: 320", "focal_px: 320, aperture_mm: 8, focus_m: 0.5"))
    render_radiance(mi, frame_of(study, 0))
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        frame = frame_of(study, 1)
        render_radiance(mi, dataclasses.replace(frame, ray_seed=99))
        history = dr.kernel_history([dr.KernelType.JIT])
    fresh = [entry for entry in history if not entry["cache_hit"]]
    # A tier of samples that frame 0 did not need is a kernel that it did not leave; few of them.
    assert len(history) > 4
    assert len(fresh) <= len(history) / 3
