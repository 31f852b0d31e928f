"""`--intrinsics`: labels, focal lengths, errors of one sentence."""

from __future__ import annotations

import json

import numpy as np
import pytest

from roundel.scenes.camera import Camera, camera_to_json
from roundel.scenes.errors import DataError, UsageError
from roundel.solver.intrinsics import camera_for, focal_px_of, parse_intrinsics

K = np.array([[1280.0, 2.0, 600.0], [0.0, 1290.0, 350.0], [0.0, 0.0, 1.0]])
CAMERA = Camera(1280, 720, K, (0.1, 0.0, 0.0, 0.0), focal_35mm_mm=28.0)


def used(text, camera=CAMERA, size=(1280, 720)):
    return camera_for(parse_intrinsics(text), camera, *size)


def test_true_is_the_frames_own():
    assert used("true") is CAMERA


def test_default_by_diagonal_and_by_width():
    # Errata, section 4: 1016.6 and 1064.9 px for 1280 x 720.
    camera = used("default")
    assert camera.K[0, 0] == pytest.approx(1016.6, abs=0.05)
    assert camera.K[1, 1] == camera.K[0, 0]
    assert camera.K[0, 1] == 0
    assert (camera.K[0, 2], camera.K[1, 2]) == (639.5, 359.5)
    assert camera.distortion == ()
    assert used("default:width").K[0, 0] == pytest.approx(1064.9, abs=0.05)
    assert used("default", camera=None).K[0, 0] == camera.K[0, 0]


def test_portrait_is_landscape_turned():
    assert used("default", size=(720, 1280)).K[0, 0] == used("default").K[0, 0]
    assert used("default:width", size=(720, 1280)).K[0, 0] == used("default:width").K[0, 0]


def test_scaled_keeps_the_rest():
    camera = used("scaled:0.7")
    assert np.allclose(camera.K, [[896.0, 2.0, 600.0], [0.0, 903.0, 350.0], [0.0, 0.0, 1.0]])
    assert camera.distortion == CAMERA.distortion
    assert parse_intrinsics("scaled:0.70").label == "scaled:0.7"
    assert parse_intrinsics("scaled:1").label == "scaled:1"


def test_scaled_keeps_the_lens_model():
    fisheye = Camera(1280, 720, K, (0.01, 0.0, 0.0, 0.0), distortion_model="fisheye")
    camera = used("scaled:0.7", camera=fisheye)
    assert (camera.distortion_model, camera.distortion) == ("fisheye", fisheye.distortion)


def test_exif():
    camera = used("exif")
    assert camera.K[0, 0] == pytest.approx(28.0 * np.hypot(1280, 720) / np.hypot(36, 24))
    assert focal_px_of(36.0, 1280, 720, by_width=True) == 1280.0
    with pytest.raises(UsageError, match="EXIF"):
        used("exif", camera=Camera(1280, 720, K))


def test_calibrated(tmp_path):
    file = tmp_path / "bench.json"
    file.write_text(json.dumps(camera_to_json(CAMERA)))
    spec = parse_intrinsics(f"calibrated:{file}")
    assert spec.label == "calibrated:bench"
    assert np.array_equal(camera_for(spec, None, 1280, 720).K, K)
    with pytest.raises(UsageError, match="1280x720"):
        camera_for(spec, None, 640, 480)
    broken = tmp_path / "broken.json"
    for text in ("{", "[]", '{"width_px": 3}'):
        broken.write_text(text)
        with pytest.raises(DataError, match="broken"):
            parse_intrinsics(f"calibrated:{broken}")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("defualt", "did you mean default"),
        ("ture", "did you mean true"),
        ("default:widht", "did you mean default:width"),
        ("", "use one of"),
        ("xyzzy", "use one of"),
        ("true:1", "unknown"),
        ("scaled", "positive number"),
        ("scaled:", "positive number"),
        ("scaled:zero", "positive number"),
        ("scaled:0", "positive number"),
        ("scaled:-1", "positive number"),
        ("scaled:nan", "positive number"),
        ("scaled:inf", "positive number"),
        ("calibrated", "name the camera file"),
        ("calibrated:/no/such/file.json", "no such file"),
    ],
)
def test_wrong_labels(text, says):
    with pytest.raises(UsageError, match=says):
        parse_intrinsics(text)


def test_cameras_that_are_not_known():
    for text in ("true", "scaled:0.7", "exif"):
        with pytest.raises(UsageError, match="not known"):
            used(text, camera=None)
