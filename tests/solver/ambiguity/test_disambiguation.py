"""Disambiguation by prior knowledge: sides, normals, parsing, and calibration of the probabilities."""

from __future__ import annotations

import math
from math import erf, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roundel.scenes.camera.model import Camera
from roundel.scenes.errors import UsageError
from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic
from roundel.scenes.geometry.pose import angle_deg, camera_from_marker_of, minimal_rotation, normal_of
from roundel.solver.ambiguity.concentric_circle import ConcentricCircle
from roundel.solver.ambiguity.disambiguation import GreatCirclePrior, NormalPrior, check_knowledge, choose
from roundel.solver.ambiguity.normal_prior import on_ceiling, on_floor, on_wall, previous_normal
from roundel.solver.ambiguity.observation import Evidence, Observation, Verdict
from roundel.solver.ambiguity.parse_prior import mark_of, parse_knowledge
from roundel.solver.ambiguity.pattern_cue import Pattern
from roundel.solver.ambiguity.vanishing_line_side import SideRule, _order
from roundel.solver.ambiguity.viewing_cone import viewing_cone
from roundel.solver.fit.ellipse import ellipse_of_shape, shape_of_ellipse
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera
from roundel.solver.pose.circle_pose import poses_from_conic, poses_from_ellipse

K = np.array([[1016.0, 0.0, 639.5], [0.0, 1016.0, 359.5], [0.0, 0.0, 1.0]])
NORMALS = np.stack([normal_of(20.0, 40.0), normal_of(30.0, -140.0)])


def test_nothing_known_nothing_chosen():
    choice = choose(NORMALS)
    assert choice.probability == (0.5, 0.5)
    assert choice.chosen is None


def test_sides():
    assert choose(NORMALS, "same_side").chosen == 0
    assert choose(NORMALS, "same_side").probability == (1.0, 0.0)
    assert choose(NORMALS, "opposite_side").chosen == 1
    assert choose(NORMALS, "opposite_side").probability == (0.0, 1.0)


def test_the_exact_criterion_tells_the_candidate():
    # Errata, section 3: E > 0 exactly if the true pose is the errata's `+`, index 0 here. E in the plane's frame: F the
    # foot of the camera at (0, -c), q the origin on the axis, (xc, yc) the circle, s = sin th the camera's height.
    generator = np.random.default_rng(0)
    for _ in range(300):
        normal = normal_of(generator.uniform(10, 70), generator.uniform(-180, 180))
        centre = generator.uniform(5, 50) * np.array([generator.uniform(-0.5, 0.5), generator.uniform(-0.3, 0.3), 1.0])
        if normal @ centre > -0.1 * np.linalg.norm(centre):
            continue
        away = -normal
        depth = away @ centre  # distance of the plane; the axis meets it at q, depth / away_z along z
        q = np.array([0.0, 0.0, depth / away[2]])
        unit = q[2]  # the camera is at distance 1 from q in the errata's frame
        s = away[2]
        c = np.sqrt(1 - s * s)
        y_axis = (q - depth * away) / (unit * c)  # from F to q
        x_axis = np.cross(y_axis, normal)
        xc, yc, radius = (centre - q) @ x_axis / unit, (centre - q) @ y_axis / unit, 0.5 / unit
        e = (1 + c * yc) * (xc**2 + yc**2 + c * yc) - c * radius**2 * (yc + c)
        poses = poses_from_conic(conic_of_circle(camera_from_marker_of(normal, centre), 0.5, K), K, 0.5)
        chosen = choose(poses.normal, "same_side" if e > 0 else "opposite_side").chosen
        assert chosen is not None
        # The candidates are apart by degrees; the closed form is exact to 1e-9.
        assert angle_deg(poses.normal[chosen], normal) < 1e-4


# --- the side rule -------------------------------------------------------------------------------------------------


def exact_sighting(normal, centre_m, radius_m=0.5, **uncertain):
    ellipse = ellipse_of_conic(conic_of_circle(camera_from_marker_of(normal, centre_m), radius_m, K))
    poses = poses_from_ellipse(ellipse, K, radius_m)
    cov = uncertain.pop("shape_cov", None)
    return Observation(poses.normal, None, ellipse, cov, UncertainCamera(Camera(1280, 720, K), **uncertain))


def phi(z):
    return 0.5 * (1 + erf(z / sqrt(2)))


poses_in_view = st.tuples(st.floats(12, 65), st.floats(-180, 180), st.floats(-0.4, 0.4), st.floats(-0.25, 0.25))


@settings(max_examples=40, deadline=None)
@given(poses_in_view, st.floats(5, 50))
def test_order_has_the_derivatives_of_the_cone(pose, distance):
    tilt, azimuth, x, y = pose
    normal, centre = normal_of(tilt, azimuth), distance * np.array([x, y, 1.0])
    if normal @ centre > -0.3 * distance:
        return
    observation = exact_sighting(normal, centre)
    if angle_deg(*observation.normal) < 20:  # nearly one solution: the steps of 1e-4 are then no longer small beside it
        return
    cone = viewing_cone(observation)
    g, gradient, _ = _order(observation.ellipse, K)
    numeric = cone.derivative(cone.side[:, 2])
    assert g == pytest.approx(cone.side[0, 2], abs=1e-9)
    # Central differences of steps 1e-4: their curvature is 1e-8 of a gap that may be a hundredth.
    np.testing.assert_allclose(gradient, numeric[:6], atol=1e-4 * np.abs(numeric[:6]).max())
    np.testing.assert_allclose(-gradient[:2], numeric[6:], atol=1e-4 * np.abs(numeric[6:]).max())


def test_without_doubt_about_the_camera_the_rule_is_certain():
    observation = exact_sighting(normal_of(40, 30), np.array([2.0, 1.0, 10.0]))
    assert choose(observation, "same_side").probability == (1.0, 0.0)
    assert choose(observation, "opposite_side").probability == (0.0, 1.0)


def test_the_papers_set_up_is_close_to_a_coin_flip():
    # Errata, section 3: a marker aimed at the principal point to within 1 px, 15 D away, f = 1280 px. It gives .61, .73
    # and .74 by simulation; the formula has .64, .73 and .76 for its offsets of .36, .62 and .71 px.
    for tilt, expected in ((15, 0.61), (30, 0.73), (45, 0.74)):
        k = np.diag([1280.0, 1280.0, 1.0])
        normal, centre = normal_of(tilt, 20.0), np.array([0.0, 0.0, 15.0])
        ellipse = ellipse_of_conic(conic_of_circle(camera_from_marker_of(normal, centre), 0.5, k))
        poses = poses_from_ellipse(ellipse, k, 0.5)
        assert angle_deg(poses.normal[1], normal) < 1e-6  # E < 0 always: the separating line
        uncertain = UncertainCamera(Camera(1280, 720, k), 0.0, 1.0)
        said = choose(Observation(poses.normal, None, ellipse, None, uncertain), "opposite_side").probability[1]
        assert said == pytest.approx(expected, abs=0.035)
        # And by simulation here: the principal point off by 1 px is the ellipse off by 1 px.
        generator = np.random.default_rng(1)
        moved = np.repeat(ellipse[None], 4000, axis=0)
        moved[:, :2] += generator.standard_normal((4000, 2))
        seen = poses_from_ellipse(moved, k, 0.5)
        right = np.mean(angle_deg(seen.normal[:, 1], normal) < angle_deg(seen.normal[:, 0], normal))
        assert right == pytest.approx(said, abs=0.025)  # 3 sigma of 4,000 cases


def test_guard_against_a_wrong_principal_point():
    # Errata: with a principal point wrong by 20 px the rule is right in 70 % of the cases within 20 px of it along the
    # minor axis, and always beyond.
    generator = np.random.default_rng(2)
    near, far, said = [], [], []
    for _ in range(1500):
        normal = normal_of(generator.uniform(10, 70), generator.uniform(-180, 180))
        distance = generator.uniform(5, 50)
        offset = generator.uniform(-60, 60, 2)
        centre = distance * np.array([*(offset / 1016.0), 1.0])
        if normal @ centre > -0.1 * distance:
            continue
        observation = exact_sighting(normal, centre, principal_sigma_px=20.0 / sqrt(2))
        turn = generator.uniform(0, 2 * np.pi)
        moved = observation.ellipse + np.array([20 * np.cos(turn), 20 * np.sin(turn), 0, 0, 0])
        seen = poses_from_ellipse(moved, K, 0.5).normal
        before = int(np.argmin(angle_deg(observation.normal, normal)))
        right = int(np.argmin(angle_deg(seen, normal))) == before
        g, _, to_px = _order(moved, K)
        (near if g * to_px < 20 else far).append(right)
        said.append(
            max(choose(Observation(seen, None, moved, None, observation.uncertain_camera), "same_side").probability)
        )
        assert g * to_px < 20 or said[-1] > 0.9
    assert np.mean(near) == pytest.approx(0.70, abs=0.06)  # 400 cases: 2.3 % a sigma
    assert np.mean(far) > 0.995
    assert np.mean(near + far) == pytest.approx(np.mean(said), abs=0.03)


def test_side_probability_is_calibrated():
    # Noise on the ellipse, focal length and principal point off as declared: three bins, said against right.
    generator = np.random.default_rng(3)
    said, right = [], []
    for _ in range(1500):
        normal, distance = normal_of(generator.uniform(10, 70), generator.uniform(-180, 180)), generator.uniform(5, 50)
        centre = distance * np.array([*(generator.uniform(-60, 60, 2) / 1016.0), 1.0])
        if normal @ centre > -0.1 * distance:
            continue
        k = K.copy()
        k[:2, :2] *= 1 + 0.115 * generator.standard_normal()
        k[:2, 2] += 15 * generator.standard_normal(2)
        exact = ellipse_of_conic(conic_of_circle(camera_from_marker_of(normal, centre), 0.5, k))
        truth = int(np.argmin(angle_deg(poses_from_ellipse(exact, k, 0.5).normal, normal)))
        ellipse = ellipse_of_shape(shape_of_ellipse(exact) + 0.05 * generator.standard_normal(5))
        seen = poses_from_ellipse(ellipse, K, 0.5).normal
        uncertain = UncertainCamera(Camera(1280, 720, K), 0.115, 15.0)
        word = ("same_side", "opposite_side")[truth]
        said.append(choose(Observation(seen, None, ellipse, 0.05**2 * np.eye(5), uncertain), word).probability[truth])
        right.append(int(np.argmin(angle_deg(seen, normal))) == truth)
    said, right = np.array(said), np.array(right)
    for low, high in ((0.5, 0.7), (0.7, 0.9), (0.9, 1.01)):
        inside = (said >= low) & (said < high)
        # 3 sigma of some 200 cases in a bin, and of 900 in the last.
        assert abs(said[inside].mean() - right[inside].mean()) < 3 * 0.5 / sqrt(np.count_nonzero(inside))


# --- normals -------------------------------------------------------------------------------------------------------


def test_a_prior_weighs():
    near = NormalPrior(normal_of(21.0, 45.0))
    choice = choose(NORMALS, near)
    assert choice.chosen == 0
    assert choice.probability[0] > 0.99
    assert sum(choice.probability) == pytest.approx(1.0, abs=1e-15)
    assert choose(NORMALS[::-1], near).chosen == 1
    assert "2.0 and 50.9 deg off" in choice.basis
    # The formula: angles t0, t1 and a spread of 40 degrees; one declaration in a hundred says nothing.
    wide = choose(NORMALS, NormalPrior(3.0 * normal_of(21.0, 45.0), 40.0))
    t, s = np.radians(angle_deg(NORMALS, normal_of(21.0, 45.0))), np.radians(40.0)
    weights = 0.99 * np.exp(-(t**2) / (2 * s**2)) / (2 * np.pi * s**2) + 0.01 / (2 * np.pi)
    assert wide.probability[0] == pytest.approx(weights[0] / weights.sum(), rel=1e-12)


def test_the_candidates_own_errors_widen_a_prior():
    cov = np.zeros((2, 6, 6))
    sharp = choose(Observation(NORMALS, cov), NormalPrior(NORMALS[0], 8.0)).probability[0]
    for i, n in enumerate(NORMALS):
        cov[i, 3:, 3:] = np.radians(30.0) ** 2 * (np.eye(3) - np.outer(n, n))
    blunt = choose(Observation(NORMALS, cov), NormalPrior(NORMALS[0], 8.0)).probability[0]
    same = choose(NORMALS, NormalPrior(NORMALS[0], np.hypot(8.0, 30.0))).probability[0]
    assert blunt == pytest.approx(same, rel=1e-12)
    assert 0.5 < blunt < sharp


def test_a_prior_in_the_middle_decides_nothing():
    pair = np.stack([normal_of(20.0, 0.0), normal_of(20.0, 180.0)])
    choice = choose(pair, NormalPrior(np.array([0.0, 0.0, -1.0])))
    assert choice.chosen is None
    assert choice.probability == pytest.approx((0.5, 0.5))


def test_a_prior_that_fits_neither_does_not_decide():
    choice = choose(NORMALS, NormalPrior(normal_of(85.0, 130.0), 5.0))
    assert "it fits neither" in choice.basis
    assert max(choice.probability) < 0.51
    far = choose(NORMALS, NormalPrior(-NORMALS[0], 0.01))  # all exponents underflow
    assert far.probability == (0.5, 0.5)
    assert far.chosen is None


def test_contradictions_are_said():
    choice = choose(NORMALS, (NormalPrior(NORMALS[0], 5.0), NormalPrior(NORMALS[1], 5.0)))
    assert "contradict each other" in choice.basis
    assert max(choice.probability) < 0.75
    certain = choose(NORMALS, ("same_side", "opposite_side"))
    assert certain.probability == (0.5, 0.5)
    assert certain.chosen is None
    assert "contradict each other" in certain.basis


def test_log_odds_add():
    one, other = NormalPrior(normal_of(22.0, 80.0), 30.0), NormalPrior(normal_of(25.0, 120.0), 40.0)
    odds = [np.log(p[0] / p[1]) for p in (choose(NORMALS, k).probability for k in (one, other, (one, other)))]
    assert odds[2] == pytest.approx(odds[0] + odds[1], rel=1e-12)
    assert choose(NORMALS, ()).probability == (0.5, 0.5)


def test_gravity():
    down = np.array([0.0, np.cos(0.5), np.sin(0.5)])  # the camera looks 29 degrees below the horizon
    table = np.stack([-down, normal_of(61.0, 90.0)])  # a marker on a table, and its other candidate
    assert choose(table, on_floor(down)).probability[0] > 0.99
    assert choose(table, on_floor()).probability[0] > 0.99  # upright: the normal has no x, and points up
    assert choose(-table * np.array([1, 1, -1]), on_ceiling()).chosen == 0
    wall = np.stack([normal_of(40.0, 0.0), normal_of(40.0, 75.0)])
    assert choose(wall, on_wall()).chosen == 0
    assert choose(wall, on_wall(np.array([0.0, 2.0, 0.0]), 5.0)).probability[0] > 0.99
    # Along the horizon a wall knows nothing.
    assert choose(np.stack([normal_of(20.0, 0.0), normal_of(50.0, 180.0)]), on_wall()).chosen is None


def test_previous_frame():
    turn = minimal_rotation([0.0, 0.0, 1.0], [0.6, 0.0, 0.8])
    prior = previous_normal(turn.T @ NORMALS[1], 5.0, turn)
    np.testing.assert_allclose(prior.normal, NORMALS[1], atol=1e-15)
    assert choose(NORMALS, prior).chosen == 1


# --- words ---------------------------------------------------------------------------------------------------------


def test_unknown_knowledge():
    with pytest.raises(UsageError, match="did you mean same_side"):
        check_knowledge("same-side")
    with pytest.raises(UsageError, match="prior"):
        check_knowledge(NormalPrior(np.zeros(3)))
    with pytest.raises(UsageError, match="prior"):
        check_knowledge(GreatCirclePrior(np.array([0, np.nan, 0])))
    with pytest.raises(UsageError, match="float is not a valid prior"):
        check_knowledge(0.8)
    with pytest.raises(UsageError, match="concentric circle"):
        check_knowledge(ConcentricCircle(1.2))
    with pytest.raises(UsageError, match="pattern"):
        check_knowledge(Pattern(np.zeros((64, 64))))
    check_knowledge(None)
    check_knowledge(("same_side", NormalPrior(NORMALS[0])))


def test_words():
    assert parse_knowledge("none") is None
    assert parse_knowledge("same_side") == (SideRule(True),)
    prior, circle = parse_knowledge("normal:0,-1,-1:12 + circle:0.5")
    assert (prior.normal.tolist(), prior.spread_deg, circle) == ([0, -1, -1], 12.0, ConcentricCircle(0.5))
    (floor,) = parse_knowledge("floor:0,1,0:4")
    assert (floor.normal.tolist(), floor.spread_deg) == ([0, -1, 0], 4.0)
    (upright,) = parse_knowledge("ceiling:7")
    assert (upright.toward.tolist(), upright.spread_deg) == ([0, 1, 0], 7.0)
    (wall,) = parse_knowledge("wall")
    assert wall.axis.tolist() == [0, 1, 0]
    (tick,) = parse_knowledge("tick")
    assert tick.name == "orientation tick"


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("", "use one of none, same_side"),
        ("flor", "did you mean floor"),
        ("normal", "write normal:X,Y,Z"),
        ("normal:1,2", "has three numbers"),
        ("normal:0,0,0", "non-zero"),
        ("normal:0,0,1:-3", "positive standard deviation"),
        ("normal:0,0,x", "'x' is not a number"),
        ("floor:0,1,0:5:6", "write floor"),
        ("circle:2", "between 0 and"),
        ("tick:0.5", "write tick"),
        ("same_side+none", "write none"),
        ("same_side:1", "write same_side"),
    ],
)
def test_wrong_words_are_one_line(text, match):
    with pytest.raises(UsageError, match=match) as error:
        parse_knowledge(text)
    assert str(error.value).startswith("--knowledge")
    assert "\n" not in str(error.value)


def test_marks_of_markers():
    assert mark_of("disc", 0.1, {}) is None
    assert mark_of("ring", 0.1, {"inner_diameter_m": 0.05}) == ConcentricCircle(0.5)
    assert mark_of("rings", 0.25, {"diameters_m": [0.25, 0.1875, 0.125]}) == ConcentricCircle(0.5, 0.75)
    tick = mark_of("disc_with_tick", 0.1, {"tick_from_m": 0.025, "tick_to_m": 0.045, "tick_width_m": 0.006})
    assert tick.texture.shape == (1024, 1024)
    assert tick.texture[511, 512 + 256 + 10] == 1.0  # to the right of the centre only
    assert tick.texture[511, 512 - 256 - 10] == 0.0
    assert tick.texture.sum() * (2 / 1024) ** 2 == pytest.approx((0.9 - 0.5) * 0.12)  # its area in square radii


class Declared(Evidence):
    """Knowledge that is sure of one candidate to some degree."""

    def __init__(self, log_odds: float) -> None:
        self.log_odds = log_odds

    def problem(self) -> str:
        return ""

    def verdict(self, observation: Observation) -> Verdict:
        return Verdict(self.log_odds, "declared")


@pytest.mark.parametrize(("probability", "contradicts"), [(0.88, False), (0.97, True)])
def test_pieces_contradict_each_other_where_both_are_sure(probability: float, contradicts: bool) -> None:
    odds = math.log(probability / (1 - probability))
    normals = np.array([[0.0, 0.6, -0.8], [0.0, -0.6, -0.8]])
    choice = choose(normals, [Declared(odds), Declared(-odds)])
    assert ("contradict each other" in choice.basis) == contradicts
