"""MSSD and MSPD of a disc: against BOP's definitions, closed forms, and invariance under its symmetries."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from roundel.scenes.camera.model import Camera, project
from roundel.scenes.geometry.pose import camera_from_marker_of, normal_of
from roundel.validate.metrics.bop import mspd_px, mssd_m

PLAIN = Camera(1280, 720, np.array([[1280.0, 0, 639.5], [0, 1280.0, 359.5], [0, 0, 1.0]]))
LENS = Camera(1280, 720, PLAIN.K, (-0.2, 0.05, 0.001, -0.0005))
RADIUS = 0.04

angles = st.floats(0, 360)
tilts = st.floats(0, 65)
sizes = st.floats(1e-4, 0.1)


def random_pose(rng: np.random.Generator) -> np.ndarray:
    centre = rng.uniform(0.3, 3) * np.array([rng.uniform(-0.2, 0.2), rng.uniform(-0.1, 0.1), 1.0])
    return camera_from_marker_of(normal_of(rng.uniform(0, 60), rng.uniform(0, 360)), centre, rng.uniform(0, 360))


def moved(pose: np.ndarray, rng: np.random.Generator, size: float) -> np.ndarray:
    """A pose beside another: turned by about `size` rad about any axis, shifted by so many radii."""
    out = pose.copy()
    out[:3, :3] = Rotation.from_rotvec(size * rng.normal(size=3)).as_matrix() @ pose[:3, :3]
    out[:3, 3] += size * RADIUS * rng.normal(size=3)
    return out


def bop(estimate: np.ndarray, truth: np.ndarray, image: Callable[[np.ndarray], np.ndarray]) -> float:
    """BOP's definition, from its paper: min over symmetries S of max over vertices x of |image(P' x) - image(P S x)|.

    S turns about the model's Z axis. Both are sought to their limits: vertices between vertices, symmetries between
    symmetries, so that no step size is left in the number.
    """

    def rim(pose: np.ndarray, t: np.ndarray) -> np.ndarray:
        points = RADIUS * np.stack([np.cos(t), np.sin(t), np.zeros_like(t)], axis=-1)
        return image(points @ pose[:3, :3].T + pose[:3, 3])

    t = np.arange(720) * (2 * np.pi / 720)
    mine = rim(estimate, t)

    def largest(turn: float, exact: bool = True) -> float:
        gap = np.linalg.norm(mine - rim(truth, t + turn), axis=-1)
        if not exact:
            return float(gap.max())
        best = []
        for i in np.flatnonzero((gap >= np.roll(gap, 1)) & (gap >= np.roll(gap, -1))):
            # A parabola thrice: the maximum's place to some 1e-8, its value to the square of that.
            place, step = t[i], t[1]
            for _ in range(3):
                x = place + step * np.array([-1.0, 0.0, 1.0])
                y = np.sum((rim(estimate, x) - rim(truth, x + turn)) ** 2, axis=-1)
                bend = y[0] - 2 * y[1] + y[2]
                place += 0.5 * step * np.clip((y[0] - y[2]) / bend, -2, 2) if bend < 0 else 0.0
                step /= 20
            best.append(np.sqrt(np.sum((rim(estimate, np.array([place])) - rim(truth, np.array([place + turn]))) ** 2)))
        return float(max(best))

    turns = np.linspace(-np.pi, np.pi, 361)
    first = turns[np.argmin([largest(turn, exact=False) for turn in turns])]
    low, high = first - 0.04, first + 0.04
    for _ in range(64):
        a, b = low + (high - low) / 3, high - (high - low) / 3
        low, high = (low, b) if largest(a) < largest(b) else (a, high)
    return largest(0.5 * (low + high))


@pytest.mark.parametrize("size", [1e-3, 0.05, 0.3])
def test_agreement_with_the_definition_of_bop(size: float) -> None:
    rng = np.random.default_rng(5)
    for camera in (PLAIN, LENS):
        truth = random_pose(rng)
        estimate = moved(truth, rng, size)
        pose = estimate[:3, 2], estimate[:3, 3], RADIUS
        assert mssd_m(truth, *pose) == pytest.approx(bop(estimate, truth, lambda x: x), abs=1e-9, rel=0)
        expected = bop(estimate, truth, lambda x, c=camera: project(c, x))
        assert mspd_px(truth, camera, *pose) == pytest.approx(expected, abs=1e-9, rel=0)


def test_no_finite_set_of_symmetries_does_better_far_off() -> None:
    # Beyond errors of a radius there may be several best turns; half a step of those tried moves a rim by 0.13 radii.
    rng = np.random.default_rng(6)
    t = np.arange(256) * (2 * np.pi / 256)
    circle = RADIUS * np.stack([np.cos(t), np.sin(t), 0 * t], axis=-1)
    for _ in range(20):
        truth = random_pose(rng)
        estimate = moved(truth, rng, 2.0)
        a, b = (circle @ m[:3, :3].T + m[:3, 3] for m in (estimate, truth))
        brute = min(np.linalg.norm(a - np.roll(b, k, axis=0), axis=-1).max() for k in range(256))
        found = float(mssd_m(truth, estimate[:3, 2], estimate[:3, 3], RADIUS))
        # A step of 256 is 0.6 % of the radius on either side of either.
        assert brute - 0.02 * RADIUS < found < brute + 0.13 * RADIUS


@given(tilts, angles, sizes, angles, st.floats(1e-12, 1.0))
def test_closed_forms(tilt: float, azimuth: float, radius: float, turn: float, error: float) -> None:
    pose = camera_from_marker_of(normal_of(tilt, azimuth), [0.02, -0.01, 1.0], turn)
    across = normal_of(tilt + 90, azimuth)
    normal = np.cos(error) * pose[:3, 2] + np.sin(error) * across
    # Rounding of coordinates of one metre, and of turns of a unit vector.
    alone = mssd_m(pose, normal, pose[:3, 3], radius)
    assert alone == pytest.approx(2 * radius * np.sin(error / 2), rel=1e-9, abs=1e-16)
    shift = error * np.array([0.6, 0.0, 0.8])
    shifted = mssd_m(pose, pose[:3, 2], pose[:3, 3] + shift, radius)
    assert shifted == pytest.approx(error, rel=1e-9, abs=1e-15)


@settings(max_examples=30, deadline=None)
@given(tilts, angles, angles, st.integers(0, 10**6))
def test_neither_sees_the_frame_nor_the_turn(tilt: float, azimuth: float, roll: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth = camera_from_marker_of(normal_of(tilt, azimuth), [0.05, -0.02, 0.8])
    estimate = moved(truth, rng, 0.05)
    one = mssd_m(truth, estimate[:3, 2], estimate[:3, 3], RADIUS)
    image = mspd_px(truth, LENS, estimate[:3, 2], estimate[:3, 3], RADIUS)
    # Turned about its own normal, the truth is the same circle.
    turned = camera_from_marker_of(truth[:3, 2], truth[:3, 3], roll)
    assert mssd_m(turned, estimate[:3, 2], estimate[:3, 3], RADIUS) == pytest.approx(one, rel=1e-9)
    assert mspd_px(turned, LENS, estimate[:3, 2], estimate[:3, 3], RADIUS) == pytest.approx(image, rel=1e-8)
    # Seen from elsewhere, space is the same space.
    rigid = np.eye(4)
    rigid[:3, :3], rigid[:3, 3] = Rotation.random(rng=rng).as_matrix(), rng.normal(size=3)
    a, b = rigid @ truth, rigid @ estimate
    assert mssd_m(a, b[:3, 2], b[:3, 3], RADIUS) == pytest.approx(one, rel=1e-9)


def test_the_truth_has_none_and_the_unknown_has_no_number() -> None:
    truth = camera_from_marker_of(normal_of(30, 20), [0.1, 0.0, 1.0])
    assert mssd_m(truth, truth[:3, 2], truth[:3, 3], RADIUS) < 1e-16
    assert mspd_px(truth, LENS, truth[:3, 2], truth[:3, 3], RADIUS) < 1e-10
    assert np.isnan(mssd_m(truth, truth[:3, 2], truth[:3, 3], np.nan))
    # Behind the camera there is no image, but there is space.
    behind = truth[:3, 3] * [1, 1, -1]
    assert np.isnan(mspd_px(truth, PLAIN, truth[:3, 2], behind, RADIUS))
    assert mssd_m(truth, truth[:3, 2], behind, RADIUS) == pytest.approx(2.0, rel=1e-9)
    # Turned over, a rim still lies on itself: at the best turn two points of it stand still, two change places.
    assert mssd_m(truth, -truth[:3, 2], truth[:3, 3], RADIUS) == pytest.approx(2 * RADIUS, rel=1e-9)


def test_rows_are_independent_of_each_other() -> None:
    rng = np.random.default_rng(9)
    truths = np.stack([random_pose(rng) for _ in range(12)])
    estimates = np.stack([moved(t, rng, s) for t, s in zip(truths, np.geomspace(1e-6, 3, 12), strict=True)])
    together = mspd_px(truths, LENS, estimates[:, :3, 2], estimates[:, :3, 3], RADIUS)
    for i in range(12):
        alone = mspd_px(truths[i], LENS, estimates[i, :3, 2], estimates[i, :3, 3], RADIUS)
        assert together[i] == pytest.approx(alone, rel=1e-8, nan_ok=True)
