"""Covariances in camera files: read in the camera's order, refused if damaged."""

import numpy as np
import pytest

from roundel.scenes.camera.model import Camera
from roundel.scenes.camera.parameter_covariance import parameter_covariance, parameter_names
from roundel.scenes.errors import DataError

CAMERA = Camera(640, 480, np.diag([500.0, 500, 1]), (0.1, 0.0, 0.0, 0.0))
NAMES = ["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"]


def test_names():
    assert parameter_names(CAMERA) == tuple(NAMES)
    assert parameter_names(Camera(640, 480, np.eye(3))) == ("fx", "fy", "cx", "cy")


def test_parameters_are_found_by_name():
    rng = np.random.default_rng(1)
    root = rng.standard_normal((6, 6))
    covariance = root @ root.T
    known = ["diameter_m", "k1", "fy", "fx", "cy", "cx"]
    found = parameter_covariance({"calibration": {"parameters": known, "covariance": covariance.tolist()}}, CAMERA)
    for i, one in enumerate(NAMES):
        for j, other in enumerate(NAMES):
            both = one in known and other in known
            expected = covariance[known.index(one), known.index(other)] if both else 0.0
            assert found[i, j] == expected


@pytest.mark.parametrize("record", [{}, {"calibration": None}, {"calibration": {"rms_px": 0.1}}])
def test_a_file_without_a_covariance(record):
    assert parameter_covariance(record, CAMERA) is None


@pytest.mark.parametrize(
    "covariance",
    [
        np.eye(3).tolist(),
        [[1, 2], [2, 1]],
        [[1, 0.5], [0.1, 1]],
        [[-1, 0], [0, 1]],
        [[float("nan"), 0], [0, 1]],
        [[1, 0], [0]],
        "none",
        None,
    ],
)
def test_a_damaged_covariance_is_refused(covariance):
    with pytest.raises(DataError, match="its covariance is damaged"):
        parameter_covariance({"calibration": {"parameters": ["fx", "fy"], "covariance": covariance}}, CAMERA)


def test_small_covariances_are_sound():
    # Variances of twelve orders of magnitude: rounding in one of them is not a negative variance in another.
    scale = np.array([1.0, 1e-6])
    covariance = np.array([[1.0, 0.999999], [0.999999, 1.0]]) * np.outer(scale, scale)
    found = parameter_covariance(
        {"calibration": {"parameters": ["fx", "k1"], "covariance": covariance.tolist()}}, CAMERA
    )
    assert found[0, 4] == covariance[0, 1]
