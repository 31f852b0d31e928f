"""Choosing by declared knowledge."""

from __future__ import annotations

import numpy as np
import pytest

from roundel.scenes.conic import conic_of_circle
from roundel.scenes.errors import UsageError
from roundel.scenes.pose import angle_deg, camera_from_marker_of, normal_of
from roundel.solver.choose import NormalPrior, check_knowledge, choose
from roundel.solver.circle_pose import poses_from_conic

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


def test_a_prior_weighs():
    near = NormalPrior(normal_of(21.0, 45.0))
    choice = choose(NORMALS, near)
    assert choice.chosen == 0
    assert choice.probability[0] > 0.999
    assert sum(choice.probability) == pytest.approx(1.0, abs=1e-15)
    assert choose(NORMALS[::-1], near).chosen == 1
    # The formula: angles t0, t1 and a spread of 40 degrees.
    wide = choose(NORMALS, NormalPrior(3.0 * normal_of(21.0, 45.0), 40.0))
    t = angle_deg(NORMALS, normal_of(21.0, 45.0))
    weights = np.exp(-(t**2) / (2 * 40.0**2))
    assert wide.probability[0] == pytest.approx(weights[0] / weights.sum(), rel=1e-12)


def test_a_prior_in_the_middle_decides_nothing():
    pair = np.stack([normal_of(20.0, 0.0), normal_of(20.0, 180.0)])
    choice = choose(pair, NormalPrior(np.array([0.0, 0.0, -1.0])))
    assert choice.chosen is None
    assert choice.probability == pytest.approx((0.5, 0.5))


def test_far_priors_do_not_underflow():
    assert choose(NORMALS, NormalPrior(-NORMALS[0], 0.01)).chosen in (0, 1)


def test_unknown_knowledge():
    with pytest.raises(UsageError, match="did you mean same_side"):
        check_knowledge("same-side")
    with pytest.raises(UsageError, match="prior"):
        check_knowledge(NormalPrior(np.zeros(3)))
    check_knowledge(None)
