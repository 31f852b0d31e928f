"""Sectors that deviate are found, noise alone is not; errors shared along the contour are measured."""

import numpy as np
import pytest

from roundel.solver.fit.contour_sectors import deviating_sectors, shared_excess

COUNT = 150


def noise(seed, pixels=2):
    """Offsets in sigmas, sums of squares and numbers of pixels of a contour without errors but noise."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=COUNT), rng.chisquare(pixels, COUNT), np.full(COUNT, float(pixels))


def found(offset, square, pixels, width=1, used=None):
    every = np.ones(COUNT, bool) if used is None else used
    return deviating_sectors(offset, np.ones(COUNT), square, pixels, every, width)


@pytest.mark.parametrize("pixels", [2, 12])
def test_noise_is_no_deviation(pixels):
    # 4.5 sigmas, three means a sector: 150 * 3 * 7e-6 = 0.3 % of the contours; 6 of 300 are not chance (p < 1e-4).
    assert sum(bool(np.any(found(*noise(seed, pixels)))) for seed in range(300)) < 6


def test_a_sector_far_off_goes_with_its_neighbours():
    offset, square, pixels = noise(0)
    offset *= 0.1
    offset[40] = 9.0
    bad = np.flatnonzero(found(offset, square, pixels, width=2))
    # The means of three that contain it are off, too: those of its two neighbours.
    assert bad.tolist() == list(range(37, 44))


def test_a_run_that_is_off_together_goes():
    offset, square, pixels = noise(1)
    offset[-3:], offset[:4] = 3.0, 3.0  # around the end of the contour
    bad = found(offset, square, pixels, width=0)
    assert bad[0]
    assert np.count_nonzero(bad) <= 9


def test_a_loud_sector_goes():
    offset, square, pixels = noise(2)
    square[70] = 400.0
    assert found(offset, square, pixels)[70]


def test_a_blur_that_the_model_does_not_describe_is_no_deviation():
    # A camera that moves during the exposure makes both ends of a diameter equally loud, an occluder only one.
    offset, square, pixels = noise(2, 12)
    square[20:40] *= 4.0
    assert np.count_nonzero(found(offset, square, pixels)) >= 12
    square[95:115] *= 4.0
    assert not np.any(found(offset, square, pixels))


def test_most_of_a_contour_stays():
    offset, square, pixels = noise(3)
    offset[:100] += np.where(np.arange(100) % 2, 300.0, -300.0)
    assert not np.any(found(offset, square, pixels))
    few = np.arange(COUNT) < 11
    offset[0] = 100.0
    assert not np.any(found(offset, square, pixels, used=few))


def contour(seed, shared):
    rng = np.random.default_rng(seed)
    direction = (np.arange(COUNT) + 0.5) * 2 * np.pi / COUNT
    # Independent errors, and others that change slowly: a moving mean of 15 sectors, of the given variance.
    slow = np.convolve(np.tile(rng.normal(size=COUNT), 3), np.ones(15), "same")[COUNT : 2 * COUNT] / np.sqrt(15)
    offset = rng.normal(size=COUNT) + np.sqrt(shared) * slow
    c, s = np.cos(direction), np.sin(direction)
    shape = -np.stack([c, s, c * c, 2 * c * s, s * s], axis=1)
    return offset, np.ones(COUNT), direction, shape


def test_independent_errors_share_nothing():
    values = [shared_excess(*contour(seed, 0.0)) for seed in range(100)]
    # Twelve squares shrunk by eight: a mean of 1.1 where the excess is cut at one.
    assert np.mean(values) < 1.2
    assert min(values) >= 1.0


def test_shared_errors_are_measured():
    values = [shared_excess(*contour(seed, 1.0)) for seed in range(100)]
    # Fifteen neighbours that err alike raise the first harmonics' power by up to 15; shrinking keeps 12 / 20 of it.
    assert 3.0 < np.mean(values) < 15.0
