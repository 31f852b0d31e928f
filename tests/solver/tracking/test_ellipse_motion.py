"""Predicted ellipses, and which measured one belongs to which."""

import numpy as np
import pytest

from roundel.solver.fit.ellipse import shape_of_ellipse
from roundel.solver.tracking.assignment import assign, same_contour
from roundel.solver.tracking.ellipse_motion import GATE, EllipseMotion

FOCAL = 600.0
DT = 1 / 30


def ellipse(i: float) -> np.ndarray:
    """Moves by 3 px, grows by 0.2 px and turns by 1 degree a frame."""
    return np.array([100 + 3 * i, 80 - 2 * i, 40 + 0.2 * i, 25 + 0.2 * i, 30 + i])


def followed(count: int) -> EllipseMotion:
    motion = EllipseMotion.begin(ellipse(0), FOCAL)
    for i in range(1, count):
        motion = motion.after(DT).seen(ellipse(i), None)
    return motion


def test_a_steady_motion_is_predicted_to_the_noise():
    predicted = followed(20).after(DT)
    # The curvature of a turn by one degree, and the prior of no motion that twenty frames have nearly forgotten.
    np.testing.assert_allclose(shape_of_ellipse(predicted.ellipse), shape_of_ellipse(ellipse(20)), atol=0.15)
    assert predicted.distance(ellipse(20)) < 1.0
    assert predicted.distance(ellipse(20) + np.array([12.0, 0, 0, 0, 0])) > GATE
    assert predicted.distance(ellipse(20) * np.array([1.0, 1.0, 1.2, 1.2, 1.0])) > GATE


def test_a_prediction_without_measurements_is_less_certain():
    one, three = followed(20).after(DT), followed(20).after(3 * DT)
    assert np.all(np.diag(three.cov)[:5] > np.diag(one.cov)[:5])
    assert three.ellipse[0] == pytest.approx(ellipse(22)[0], abs=1.0)


def test_a_contour_that_shrinks_to_nothing_is_no_ellipse():
    motion = EllipseMotion.begin(np.array([50.0, 50.0, 6.0, 5.0, 0.0]), FOCAL).after(DT)
    motion = motion.seen(np.array([50.0, 50.0, 5.0, 4.0, 0.0]), None)
    assert motion.after(1.0).ellipse is None


def test_a_vague_prediction_does_not_take_the_ellipse_of_a_certain_one():
    # Lost for half a second, its gate holds the other's ellipse as well.
    certain = followed(20).after(DT)
    vague = followed(15).after(0.5)
    assert vague.distance(ellipse(20)) < GATE
    assert assign([vague, certain], [True, True], [ellipse(20)], [True]) == {1: 0}
    assert assign([vague], [True], [ellipse(20)], [True]) == {0: 0}


def test_the_other_polarity_is_another_contour():
    certain = followed(20).after(DT)
    assert assign([certain], [True], [ellipse(20)], [False]) == {}
    assert assign([], [], [ellipse(20)], [True]) == {}


def test_same_contour():
    assert same_contour(ellipse(0), ellipse(0) + np.array([0.5, 0.5, 0.3, -0.3, 0.5]))
    assert not same_contour(ellipse(0), ellipse(0) * np.array([1.0, 1.0, 1.15, 1.15, 1.0]))
