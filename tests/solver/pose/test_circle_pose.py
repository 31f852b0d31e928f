"""The closed form: both poses reproduce the conic, one is the truth, in a fixed order."""

from __future__ import annotations

import time
import timeit

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from roundel.scenes.geometry.conic import conic_of_circle, conic_of_ellipse, ellipse_of_conic, other_candidate
from roundel.scenes.geometry.pose import angle_deg, camera_from_marker_of, normal_of
from roundel.solver.pose.circle_pose import CirclePoses, poses_from_conic, poses_from_ellipse, poses_up_to_scale

K_PAPER = np.array([[1280.0, 0.0, 639.5], [0.0, 1280.0, 359.5], [0.0, 0.0, 1.0]])


def ellipse_of_pose(normal, centre, radius, k):
    """Image ellipse of a circle in long double, without the cancellation that float64 conics suffer.

    A^-1 ~ c c^T + R^2 n n^T - R^2 I (errata, section 2), divided by c_z^2; the shape is its 2x2 Schur complement, the
    products of large terms taken out by hand.
    """
    n, c, k = (np.asarray(v, dtype=np.longdouble) for v in (normal, centre, k))
    n = n / np.sqrt(np.sum(n * n))
    at, rho2 = c[:2] / c[2], (np.longdouble(radius) / c[2]) ** 2
    g = np.eye(3, dtype=np.longdouble) - np.outer(n, n)
    below = 1 - rho2 * g[2, 2]
    middle = (at - rho2 * g[:2, 2]) / below
    cross = np.outer(at, g[:2, 2])
    inner = g[2, 2] * np.outer(at, at) - cross - cross.T + rho2 * np.outer(g[:2, 2], g[:2, 2]) + below * g[:2, :2]
    square = k[:2, :2] @ inner @ k[:2, :2].T * rho2 / below**2
    half, mean = np.hypot((square[0, 0] - square[1, 1]) / 2, square[0, 1]), (square[0, 0] + square[1, 1]) / 2
    a2 = mean + half
    b2 = (square[0, 0] * square[1, 1] - square[0, 1] ** 2) / a2
    angle = np.degrees(np.arctan2(square[0, 1], (square[0, 0] - square[1, 1]) / 2) / 2)
    centre_px = k[:2, :2] @ middle + k[:2, 2]
    return np.array([*centre_px, np.sqrt(a2), np.sqrt(b2), angle], dtype=np.float64)


def random_scene(generator, tilt_deg=None, off_axis_deg=60.0, size_px=None):
    for _ in range(10_000):
        fx = generator.uniform(300, 3000)
        fy, skew = fx * generator.uniform(0.6, 1.6), generator.uniform(-50, 50)
        k = np.array([[fx, skew, generator.uniform(0, 2000)], [0, fy, generator.uniform(0, 1500)], [0, 0, 1.0]])
        tilt = generator.uniform(0, 85) if tilt_deg is None else tilt_deg
        normal = normal_of(tilt, generator.uniform(-180, 180))
        off, azimuth = np.radians(generator.uniform(0, off_axis_deg)), generator.uniform(0, 2 * np.pi)
        ray = np.array([np.sin(off) * np.cos(azimuth), np.sin(off) * np.sin(azimuth), np.cos(off)])
        centre = ray * generator.uniform(0.2, 5.0)
        size = 10 ** generator.uniform(0, 2) if size_px is None else size_px
        radius = size / fx * np.linalg.norm(centre)
        facing = -normal @ ray > 0.02  # the printed face is seen, not its edge
        if facing and centre[2] > 1.05 * radius * np.hypot(normal[0], normal[1]):
            return normal, centre, radius, k
    raise AssertionError("no such scene")


def truth_among(poses: CirclePoses, normal, centre):
    error = np.radians(angle_deg(poses.normal, normal))
    i = int(np.argmin(error))
    return float(error[i]), float(np.linalg.norm(poses.centre_m[i] - centre) / np.linalg.norm(centre)), i


def reprojected(poses: CirclePoses, radius, k):
    return np.stack(
        [
            conic_of_circle(camera_from_marker_of(n, c), radius, k)
            for n, c in zip(poses.normal, poses.centre_m, strict=True)
        ]
    )


def test_random_scenes_conic():
    generator = np.random.default_rng(1)
    for _ in range(1000):
        size_px = 10 ** generator.uniform(1, 2.5)
        normal, centre, radius, k = random_scene(generator, off_axis_deg=40.0, size_px=size_px)
        conic = conic_of_circle(camera_from_marker_of(normal, centre), radius, k)
        poses = poses_from_conic(conic * generator.uniform(-1e3, 1e3), k, radius)
        # Unit Frobenius norm on both sides: 1e-9 is the promised relative accuracy.
        assert np.abs(reprojected(poses, radius, k) - conic).max() < 1e-9
        # The conic itself holds a semi-axis b at d px from the origin to some 1e-16 (d / b)^2; a circle seen nearly
        # along its axis takes the root of that.
        _, distance, i = truth_among(poses, normal, centre)
        lost = 1e-14 * (np.linalg.norm(k[:2, 2]) + k[0, 0]) ** 2 / ellipse_of_conic(conic)[3] ** 2
        between = np.radians(angle_deg(poses.normal[i], poses.normal[1 - i]))
        assert np.radians(angle_deg(poses.normal[i], normal)) < 1e-9 + lost / max(between, np.sqrt(lost))
        assert distance < 1e-9 + lost


def test_both_poses_of_1000_cameras_in_the_field():
    """Inside a 1280x720 image, 3 to 50 D away, tilted up to 80 degrees: one pose is the truth, the other its mirror."""
    limit = 1e-9
    generator = np.random.default_rng(2)
    for _ in range(1000):
        f, radius = generator.uniform(500, 3000), 10 ** generator.uniform(-2, 0)
        k = np.array([[f, generator.normal(0, 3), 640.0], [0, f * generator.uniform(0.9, 1.1), 360.0], [0, 0, 1.0]])
        while True:
            sight = np.linalg.solve(k, [generator.uniform(0, 1280), generator.uniform(0, 720), 1.0])
            centre = sight / np.linalg.norm(sight) * generator.uniform(3, 50) * 2 * radius
            normal = normal_of(generator.uniform(0, 80), generator.uniform(-180, 180))
            if -normal @ centre > 0.05 * np.linalg.norm(centre):
                break
        poses = poses_from_conic(conic_of_circle(camera_from_marker_of(normal, centre), radius, k), k, radius)
        other_normal, other_centre = other_candidate(normal, centre, radius)
        angle, distance, i = truth_among(poses, normal, centre)
        assert angle < limit
        assert distance < limit
        assert np.linalg.norm(poses.normal[1 - i] - other_normal) < limit
        assert np.linalg.norm(poses.centre_m[1 - i] - other_centre) < limit * np.linalg.norm(centre)


@pytest.mark.parametrize("size_px", [1e-5, 1e-2, 1.0, 50.0, 1000.0])
@pytest.mark.parametrize("tilt_deg", [0.0, 0.01, 1.0, 30.0, 60.0, 85.0, 89.0])
def test_ellipse_of_any_size_and_tilt(size_px, tilt_deg):
    generator = np.random.default_rng(2)
    for _ in range(10):
        normal, centre, radius, k = random_scene(generator, tilt_deg=tilt_deg, size_px=size_px)
        ellipse = ellipse_of_pose(normal, centre, radius, k)
        poses = poses_from_ellipse(ellipse, k, radius)
        angle, distance, i = truth_among(poses, normal, centre)
        # 1e-9 is promised; the ellipse's own rounding is 1e-16 and its worst condition here about 1e4.
        assert angle < 1e-9
        assert distance < 1e-9
        other = ellipse_of_pose(poses.normal[1 - i], poses.centre_m[1 - i], radius, k)
        assert np.allclose(other[2:4] / ellipse[2:4], 1.0, rtol=0, atol=1e-9)
        # The direction to the centre, in focal lengths: below 1e-5 px nothing finer exists in float64.
        assert np.abs(other[:2] - ellipse[:2]).max() < 1e-12 * k[0, 0] + 1e-9 * size_px


def test_both_reproduce_the_cone_and_mirror_each_other():
    generator = np.random.default_rng(3)
    for _ in range(200):
        normal, centre, radius, k = random_scene(generator)
        poses = poses_from_ellipse(ellipse_of_pose(normal, centre, radius, k), k, radius)
        n, c = poses.normal, poses.centre_m
        cone = c[:, :, None] * c[:, None] + radius**2 * (n[:, :, None] * n[:, None] - np.eye(3))
        # The cones agree up to a scale; the closed form has the same d and l1, so the scale is one.
        assert np.allclose(cone[0], cone[1], rtol=0, atol=1e-9 * np.abs(cone).max())
        assert np.allclose(np.linalg.norm(n, axis=-1), 1.0, rtol=0, atol=1e-12)
        assert np.allclose(np.linalg.norm(c[0]), np.linalg.norm(c[1]), rtol=1e-9)
        apart = n[1] - n[0]
        if np.linalg.norm(apart) > 1e-3:
            e3 = apart / np.linalg.norm(apart)
            assert np.allclose(c[0] - 2 * (c[0] @ e3) * e3, c[1], rtol=0, atol=1e-9 * np.linalg.norm(c[0]))


@given(
    st.floats(0.5, 80.0),
    st.floats(-180.0, 180.0),
    st.floats(-0.5, 0.5),
    st.floats(-0.5, 0.5),
    st.floats(3.0, 100.0),
)
def test_candidates_face_the_camera_in_order(tilt_deg, azimuth_deg, x, y, distance):
    normal, centre = normal_of(tilt_deg, azimuth_deg), distance * np.array([x, y, 1.0])
    assume(normal @ centre < -0.05 * distance)
    poses = poses_from_conic(conic_of_circle(camera_from_marker_of(normal, centre), 0.5, K_PAPER), K_PAPER, 0.5)
    assert np.all(np.sum(poses.normal * poses.centre_m, axis=-1) < 0)
    assert np.all(poses.centre_m[:, 2] > 0)
    assert poses.normal[0, 2] <= poses.normal[1, 2] + 1e-12


@pytest.mark.parametrize("angle_of_minor_axis", [0.0, 30.0, 90.0, 150.0])
def test_a_tie_is_broken_by_normal_x(angle_of_minor_axis):
    # Centred on the principal point both normals have the same z, and only rounding tells them apart.
    ellipse = np.array([639.5, 359.5, 40.0, 30.0, angle_of_minor_axis + 90.0])
    for poses in (
        poses_from_ellipse(ellipse, K_PAPER, 0.5),
        poses_from_conic(conic_of_ellipse(ellipse), K_PAPER, 0.5),
    ):
        assert abs(poses.normal[0, 2] - poses.normal[1, 2]) < 1e-12
        assert poses.normal[0, 0] > poses.normal[1, 0] - 1e-12


def test_a_circle_on_its_own_axis_has_one_pose():
    poses = poses_from_ellipse([639.5, 359.5, 40.0, 40.0, 0.0], K_PAPER, 0.5)
    assert np.allclose(poses.normal, [0, 0, -1], rtol=0, atol=1e-12)
    assert np.allclose(poses.centre_m, [0, 0, 1280 * 0.5 / 40], rtol=1e-12, atol=1e-12)


def test_batch_is_the_loop():
    generator = np.random.default_rng(4)
    centres = np.stack([generator.uniform(200, 1000, 12), generator.uniform(100, 600, 12)], axis=-1)
    rest = np.stack(
        [generator.uniform(20, 40, 12), generator.uniform(5, 20, 12), generator.uniform(0, 180, 12)], axis=-1
    )
    ellipses = np.concatenate([centres, rest], axis=-1).reshape(3, 4, 5)
    together = poses_from_conic(conic_of_ellipse(ellipses), K_PAPER, 0.5)
    assert together.normal.shape == together.centre_m.shape == (3, 4, 2, 3)
    for i in np.ndindex(3, 4):
        alone = poses_from_conic(conic_of_ellipse(ellipses[i]), K_PAPER, 0.5)
        # The batch may stop a sweep later: rounding only.
        assert np.allclose(alone.normal, together.normal[i], rtol=0, atol=1e-13)
        assert np.allclose(alone.centre_m, together.centre_m[i], rtol=1e-13)
    radii = np.full((3, 4), 0.25)
    assert np.allclose(poses_from_conic(conic_of_ellipse(ellipses), K_PAPER, radii).centre_m * 2, together.centre_m)


def between(poses: CirclePoses):
    return np.linalg.norm(poses.normal[0] - poses.normal[1])


def ellipses(smallest_exponent):
    """Up to 1000 px, and down to 1/50 as wide as long."""
    return st.tuples(
        st.floats(-2000.0, 3000.0),
        st.floats(-2000.0, 3000.0),
        st.floats(smallest_exponent, 3.0),
        st.floats(0.02, 1.0),
        st.floats(-180.0, 180.0),
    ).map(lambda v: np.array([v[0], v[1], 10.0 ** v[2], 10.0 ** v[2] * v[3], v[4]]))


@given(ellipses(-5.0), st.floats(200.0, 4000.0), st.floats(0.6, 1.6), st.floats(-50.0, 50.0))
def test_one_alone_is_as_in_a_batch(ellipse, f, aspect, skew):
    k = np.array([[f, skew, 640.0], [0.0, f * aspect, 360.0], [0.0, 0.0, 1.0]])
    alone, together = poses_from_ellipse(ellipse, k, 0.3), poses_from_ellipse(ellipse[None], k, 0.3)
    # A few ulps; where both candidates nearly coincide, the root takes the half of the digits.
    close = 4e-15 / max(between(alone), 1e-7)
    assert np.allclose(alone.normal, together.normal[0], rtol=0, atol=close)
    assert np.allclose(alone.centre_m, together.centre_m[0], rtol=0, atol=close * np.linalg.norm(alone.centre_m))


@given(ellipses(1.0), st.floats(200.0, 4000.0), st.sampled_from([1.0, -1.0, 3.7e12, -1e-9]))
def test_one_conic_alone_is_as_in_a_batch(ellipse, f, scale):
    k = np.array([[f, 3.0, 640.0], [0.0, f, 360.0], [0.0, 0.0, 1.0]])
    conic = conic_of_ellipse(ellipse) * scale
    alone, together = poses_from_conic(conic, k, 0.3), poses_from_conic(conic[None], k, 0.3)
    close = 4e-15 / max(between(alone), 1e-7)
    assert np.allclose(alone.normal, together.normal[0], rtol=0, atol=close)
    assert np.allclose(alone.centre_m, together.centre_m[0], rtol=0, atol=close * np.linalg.norm(alone.centre_m))


def test_a_batch_longer_than_a_chunk_with_a_camera_and_a_radius_each():
    generator = np.random.default_rng(5)
    count = 5000  # more than one chunk, and not a whole number of them
    size = 10 ** generator.uniform(-4, 2.5, count)
    ellipses = np.stack(
        [
            generator.uniform(0, 1280, count),
            generator.uniform(0, 720, count),
            size,
            size * generator.uniform(0.05, 1, count),
            generator.uniform(0, 180, count),
        ],
        axis=-1,
    )
    k = np.tile(K_PAPER, (count, 1, 1))
    k[:, 0, 0] *= generator.uniform(0.7, 1.3, count)
    radius = generator.uniform(0.01, 1.0, count)
    together = poses_from_ellipse(ellipses, k, radius)
    for i in range(0, count, 37):
        alone = poses_from_ellipse(ellipses[i], k[i], radius[i])
        close = 4e-15 / max(between(alone), 1e-7)
        assert np.allclose(alone.normal, together.normal[i], rtol=0, atol=close)
        assert np.allclose(alone.centre_m, together.centre_m[i], rtol=0, atol=close * np.linalg.norm(alone.centre_m))
    one_image = poses_from_ellipse(ellipses[0], k[:7], radius[:7])
    assert one_image.normal.shape == one_image.centre_m.shape == (7, 2, 3)
    assert poses_from_ellipse(np.empty((0, 5)), K_PAPER, 1.0).normal.shape == (0, 2, 3)


def test_unknown_radius_gives_the_pose_in_radii():
    ellipse = np.array([700.0, 300.0, 40.0, 30.0, 20.0])
    free, known = poses_up_to_scale(ellipse, K_PAPER), poses_from_ellipse(ellipse, K_PAPER, 0.07)
    assert np.array_equal(free.normal, known.normal)
    assert np.allclose(free.centre_m * 0.07, known.centre_m, rtol=1e-15)


@given(
    st.floats(1.0, 75.0),
    st.floats(-180.0, 180.0),
    st.floats(-0.6, 0.6),
    st.floats(-0.6, 0.6),
    st.floats(2.0, 40.0),
    st.floats(-60.0, 60.0),
)
def test_identities_of_the_closed_form(tilt_deg, azimuth_deg, x, y, distance, skew):
    """Errata, section 2: eigenvalues l1 > 0 > l2 >= l3 of A = K^T C K, and what n, c and d are in them."""
    k = np.array([[900.0, skew, 600.0], [0.0, 1100.0, 400.0], [0.0, 0.0, 1.0]])
    radius, centre, normal = 0.5, distance * np.array([x, y, 1.0]), normal_of(tilt_deg, azimuth_deg)
    sight = centre / np.linalg.norm(centre)
    assume(-normal @ sight > 0.1)
    assume(np.linalg.norm(np.cross(normal, sight)) > 0.05)  # apart from the double root, which costs half the digits
    assume(centre[2] > 1.5 * radius)
    conic = conic_of_circle(camera_from_marker_of(normal, centre), radius, k)
    poses = poses_from_conic(conic, k, radius)
    a = k.T @ conic @ k
    a /= np.cbrt(np.linalg.det(a))
    (l3, l2, l1), vectors = np.linalg.eigh(a)
    assert l1 > 0 > l2 >= l3
    e1, e3 = vectors[:, 2] * np.sign(vectors[2, 2]), vectors[:, 0] * np.sign(vectors[2, 0])
    cos, sin = np.sqrt((l1 - l2) / (l1 - l3)), np.sqrt((l2 - l3) / (l1 - l3))
    # The eigenvalues themselves hold (size / distance)^2 of the digits: 1e-16 * 80^2, and 1 / 0.05 from the root.
    close = 1e-9
    for i, sign in enumerate((1.0, -1.0)):
        n, c = -poses.normal[i], poses.centre_m[i]  # the errata's n points away from the camera
        if abs(sin * e3[2]) > 1e-9:  # at a tie the order is another
            assert np.allclose(n, cos * e1 + sign * sin * e3, rtol=0, atol=close)
        assert n @ np.linalg.solve(a, n) == pytest.approx(l2 / (l1 * l3), rel=close)
        assert np.allclose(c, radius * np.sqrt(-l1 * l3) * np.linalg.solve(a, n), rtol=0, atol=close * distance)
        assert n @ c == pytest.approx(radius * abs(l2) / np.sqrt(-l1 * l3), rel=close)
    apart = np.linalg.norm(poses.centre_m[0] - poses.centre_m[1])
    assert apart == pytest.approx(2 * radius * sin * np.sqrt(-l1 / l3), rel=1e-7, abs=close * distance)


def test_scale_of_k_does_not_matter():
    ellipse = [700.0, 300.0, 40.0, 30.0, 20.0]
    assert np.allclose(
        poses_from_ellipse(ellipse, 3 * K_PAPER, 0.5).normal,
        poses_from_ellipse(ellipse, K_PAPER, 0.5).normal,
        atol=1e-14,
    )


def test_conic_and_ellipse_agree():
    ellipse = np.array([700.0, 300.0, 40.0, 30.0, 20.0])
    one, other = poses_from_ellipse(ellipse, K_PAPER, 0.5), poses_from_conic(conic_of_ellipse(ellipse), K_PAPER, 0.5)
    # 1e-16 (d / b)^2 with d = 760 px, b = 30 px, and the condition of the tilt.
    assert np.allclose(one.normal, other.normal, rtol=0, atol=1e-12)
    assert np.allclose(ellipse_of_conic(reprojected(one, 0.5, K_PAPER)), ellipse, rtol=1e-9)


ELLIPSE = conic_of_ellipse([700.0, 300.0, 40.0, 30.0, 20.0])


@pytest.mark.parametrize(
    ("conic", "k", "radius", "says"),
    [
        (np.diag([1.0, -1.0, -1.0]), K_PAPER, 1.0, "hyperbola"),
        (np.diag([1.0, 1.0, 1.0]), K_PAPER, 1.0, "no real points"),
        (np.diag([1.0, 0.0, -1.0]), K_PAPER, 1.0, "parabola"),
        (np.zeros((3, 3)), K_PAPER, 1.0, "zero matrix"),
        (np.full((3, 3), np.nan), K_PAPER, 1.0, "not finite"),
        (np.eye(2), K_PAPER, 1.0, "3x3"),
        (ELLIPSE, np.diag([1280.0, 0.0, 1.0]), 1.0, "singular"),
        (ELLIPSE, np.full((3, 3), np.inf), 1.0, "not finite"),
        (ELLIPSE, K_PAPER.T, 1.0, "upper triangular"),
        (ELLIPSE, np.eye(4), 1.0, "3x3"),
        (ELLIPSE, np.where(K_PAPER == 1280.0, np.nan, K_PAPER), 1.0, "not finite"),
        (ELLIPSE, np.diag([1280.0, 1280.0, 0.0]), 1.0, "singular"),
        (ELLIPSE, K_PAPER, np.inf, "radius"),
        (ELLIPSE, K_PAPER, 0.0, "radius"),
        (ELLIPSE, K_PAPER, -1.0, "radius"),
        (ELLIPSE, K_PAPER, np.nan, "radius"),
    ],
)
def test_bad_input_says_what_is_wrong(conic, k, radius, says):
    with pytest.raises(ValueError, match=says):
        poses_from_conic(conic, k, radius)
    with pytest.raises(ValueError, match=says):  # alone it goes another way than in company
        poses_from_conic(np.stack([conic, ELLIPSE] if np.shape(conic) == (3, 3) else [conic]), k, radius)


@pytest.mark.parametrize(
    "ellipse",
    [
        [1, 2, 0, 1, 0],
        [1, 2, 3, -1, 0],
        [1, 2, 3, np.nan, 0],
        [1, 2, 3, 1, np.inf],
        [np.inf, 2, 3, 1, 0],
        [1, 2, 3, 4],
        [1, 2, 1e200, 1e200, 0],
        [1, 2, 1e-200, 1e-200, 0],
    ],
)
def test_bad_ellipses(ellipse):
    for batch in (ellipse, [ellipse, ellipse]):
        with pytest.raises(ValueError, match=r"ellipse"):
            poses_from_ellipse(batch, K_PAPER, 1.0)


def test_shapes_that_do_not_fit_together():
    with pytest.raises(ValueError, match="broadcast"):
        poses_from_ellipse(np.full((3, 5), 10.0), np.stack([K_PAPER] * 4), 1.0)
    with pytest.raises(ValueError, match="K must be a 3x3"):
        poses_from_ellipse([1, 2, 3, 2, 0], K_PAPER[0], 1.0)


@pytest.mark.slow
def test_speed():
    """1.5 microseconds a pose among 100,000, 60 a call: three times that, because test machines are shared."""
    generator = np.random.default_rng(6)
    count = 100_000
    ellipses = np.stack(
        [generator.uniform(low, high, count) for low, high in ((0, 1280), (0, 720), (20, 60), (5, 20), (0, 180))],
        axis=-1,
    )
    conics = conic_of_ellipse(ellipses)
    for call, images in ((poses_from_conic, conics), (poses_from_ellipse, ellipses)):
        # The processor's time, not the clock's: others run meanwhile.
        batch = timeit.Timer(lambda c=call, i=images: c(i, K_PAPER, 0.5), timer=time.process_time)
        alone = timeit.Timer(lambda c=call, i=images[0]: c(i, K_PAPER, 0.5), timer=time.process_time)
        assert min(batch.repeat(number=1, repeat=9)) / count < 3 * 1.5e-6
        assert min(alone.repeat(number=100, repeat=20)) / 100 < 3 * 60e-6
