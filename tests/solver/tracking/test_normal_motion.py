"""Evidence for a branch from the motion of both candidates."""

import numpy as np
import pytest

from roundel.solver.tracking.normal_motion import NormalMotion

SIGMA = np.radians(0.2)
DT = 1 / 30


def mirrored(normal: np.ndarray, sight: np.ndarray) -> np.ndarray:
    """The false candidate: as far from the line of sight, on the other side."""
    return 2 * (normal @ sight) * sight - normal


def unit(*v: float) -> np.ndarray:
    return np.array(v) / np.linalg.norm(v)


def feed(motion: NormalMotion, true: np.ndarray, sight: np.ndarray, generator, odds_of_true: float = 0.0) -> int:
    """Take up a frame; the candidates in their order, by normal_z. Returns the index of the true one.

    Both candidates come from one measured ellipse: the error of one is the mirrored error of the other.
    """
    error = generator.normal(0.0, SIGMA, 3)
    measured = unit(*(true + (error - true * (true @ error))))
    both = [measured, mirrored(measured, sight)]
    order = sorted((0, 1), key=lambda i: both[i][2])
    normal = np.stack([both[i] for i in order])
    cov = np.stack([SIGMA**2 * (np.eye(3) - np.outer(n, n)) for n in normal])
    right = order.index(0)
    motion.update(normal, cov, DT, odds_of_true if right == 0 else -odds_of_true)
    return right


def test_a_marker_that_is_moved_without_turning():
    # The line of sight swings by 0.3 rad in a second, the false normal by twice that.
    motion, generator, true = NormalMotion(), np.random.default_rng(0), unit(0.5, 0.2, -0.8)
    for i in range(30):
        right = feed(motion, true, unit(0.3 * i * DT, 0.1, 1.0), generator)
    assert motion.probability[right] > 0.99


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_a_marker_that_stays_where_it_is_tells_nothing(turn):
    # At rest or turning about a fixed axis: both candidates move alike.
    motion, generator, sight = NormalMotion(), np.random.default_rng(1), unit(0.1, 0.05, 1.0)
    for i in range(150):
        angle = turn * i * DT
        true = unit(0.6 * np.cos(angle), 0.6 * np.sin(angle), -0.8)
        right = feed(motion, true, sight, generator)
        assert 0.2 < motion.probability[right] < 0.8
    assert sum(motion.probability) == pytest.approx(1.0)


def test_the_choice_goes_on_smoothly_where_both_candidates_meet():
    # It moves first, which tells them apart; then it turns through the line of sight without moving on.
    motion, generator = NormalMotion(), np.random.default_rng(2)
    for i in range(45):
        right = feed(motion, unit(0.4, 0.0, -1.0), unit(0.3 * np.sin(2 * i * DT), 0.1, 1.0), generator)
    assert motion.probability[right] > 0.95
    sight = unit(0.3 * np.sin(2 * 44 * DT), 0.0, 1.0)
    for i in range(60):
        right = feed(motion, unit(0.4 - 0.5 * i * DT, 0.0, -1.0), sight, generator)
    # It ends on the other side of the line of sight, and so does what was chosen.
    assert motion.probability[right] > 0.6


def test_the_order_of_the_candidates_does_not_matter():
    first, second = NormalMotion(), NormalMotion()
    for i in range(20):
        normal = np.stack([unit(0.5, 0.1, -0.9), unit(-0.5 + 0.01 * i, 0.1, -0.9)])
        cov = np.stack([SIGMA**2 * (np.eye(3) - np.outer(n, n)) for n in normal])
        first.update(normal, cov, DT, 0.3)
        second.update(normal[::-1], cov[::-1], DT, -0.3)
    assert first.probability == pytest.approx(second.probability[::-1], abs=1e-9)


def test_the_same_knowledge_in_every_frame_counts_once():
    motion, generator = NormalMotion(), np.random.default_rng(3)
    for _ in range(60):
        right = feed(motion, unit(0.5, 0.2, -0.8), unit(0.1, 0.0, 1.0), generator, odds_of_true=2.0)
    # The motion adds nothing, up to the noise.
    assert motion.probability[right] == pytest.approx(1 / (1 + np.exp(-2.0)), abs=0.05)
