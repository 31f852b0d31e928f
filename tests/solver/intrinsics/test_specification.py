"""`--intrinsics`: labels, focal lengths, one-sentence errors."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from roundel.scenes.camera.film import DEFAULT_FOCAL_35MM_MM, FOCAL_35MM_2020S_MM, FOCAL_35MM_2020S_SIGMA_MM
from roundel.scenes.camera.model import Camera, camera_to_json
from roundel.scenes.camera.parameter_covariance import parameter_names
from roundel.scenes.errors import DataError, UsageError
from roundel.solver.intrinsics.exif import ExifTags
from roundel.solver.intrinsics.specification import (
    LENS_SIGMAS,
    camera_for,
    focal_px_of,
    parse_intrinsics,
    uncertain_camera_for,
)

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


def assumed(text, camera=CAMERA, size=(1280, 720), exif=None):
    return uncertain_camera_for(parse_intrinsics(text), camera, *size, exif)


@pytest.mark.parametrize(
    ("text", "focal_px", "sigma_px"),
    [("default", 1016.6, 117), ("default:width", 1064.9, 122), ("default:crop43", 1107.6, 127)],
)
def test_three_conventions_of_the_default(text, focal_px, sigma_px):
    # Errata, section 4; the last sigma is 11.5 % of its focal length.
    one = assumed(text)
    assert one.camera.K[0, 0] == pytest.approx(focal_px, abs=0.05)
    assert one.focal_sigma * focal_px == pytest.approx(sigma_px, abs=0.6)
    assert one.focal_sigma == pytest.approx(0.115, abs=5e-5)
    assert one.principal_sigma_px == 12.8
    assert one.basis.startswith("default phone model: 29.95 mm (35-mm equivalent, by ")
    assert one.basis.endswith("+- 11.5 %")


@pytest.mark.parametrize("convention", ["", ":width", ":crop43"])
def test_phones_of_the_2020s_differ_from_the_papers_by_the_focal_length_alone(convention):
    old, new = assumed(f"default{convention}"), assumed(f"default:2020s{convention}")
    assert new.camera.K[0, 0] / old.camera.K[0, 0] == pytest.approx(FOCAL_35MM_2020S_MM / DEFAULT_FOCAL_35MM_MM)
    assert new.focal_sigma == pytest.approx(FOCAL_35MM_2020S_SIGMA_MM / FOCAL_35MM_2020S_MM)
    assert new.principal_sigma_px == old.principal_sigma_px
    assert new.basis.startswith(f"default phone of the 2020s: {FOCAL_35MM_2020S_MM} mm (35-mm equivalent, by ")
    assert parse_intrinsics(f"default:2020s{convention}").label == f"default:2020s{convention}"


def test_the_crop_makes_no_difference_to_a_whole_sensor():
    for size in ((1280, 960), (960, 1280), (1000, 1000)):
        assert assumed("default:crop43", size=size).camera.K[0, 0] == pytest.approx(
            assumed("default", size=size).camera.K[0, 0]
        )


def test_what_is_exact_has_no_spread(tmp_path):
    file = tmp_path / "bench.json"
    file.write_text(json.dumps(camera_to_json(CAMERA)))
    for text in ("true", "scaled:0.7", f"calibrated:{file}"):
        one = assumed(text)
        assert one.is_exact
        assert str(tmp_path) not in one.basis
    assert assumed(f"calibrated:{file}").basis == "calibrated camera bench, taken as exact"


def test_a_calibration_brings_its_covariance(tmp_path):
    file = tmp_path / "bench.json"
    names = list(parameter_names(CAMERA))
    covariance = np.diag([0.64, 0.64, 1.0, 1.0, 1e-6, 1e-5, 1e-8, 1e-8][: len(names)])
    about = {"parameters": names, "covariance": covariance.tolist()}
    file.write_text(json.dumps({**camera_to_json(CAMERA), "calibration": about}))
    one = assumed(f"calibrated:{file}")
    np.testing.assert_array_equal(one.covariance, covariance)
    assert (one.focal_sigma, one.principal_sigma_px) == (0.0, 0.0)
    sigma = 100 * 0.8 / CAMERA.K[0, 0]
    assert one.basis == f"calibrated camera bench, with the covariance of its parameters: fx +- {sigma:.2g} %"
    about["covariance"][0][0] = -1.0
    file.write_text(json.dumps({**camera_to_json(CAMERA), "calibration": about}))
    with pytest.raises(DataError, match=r"bench\.json: its covariance is damaged; calibrate the camera again"):
        parse_intrinsics(f"calibrated:{file}")


@pytest.mark.parametrize("text", ["default", "default:2020s:width", "focal:1000", "focal35:26+-1"])
def test_an_assumed_lens_is_uncertain(text):
    one = assumed(text)
    np.testing.assert_allclose(np.sqrt(np.diag(one.covariance)), [0.0] * 4 + list(LENS_SIGMAS))
    assert one.camera.distortion == ()


@pytest.mark.parametrize(
    ("text", "label", "focal_px", "sigma"),
    [
        ("focal:3100", "focal:3100", 3100.0, 0.0),
        ("focal:3100px+-62", "focal:3100+-62", 3100.0, 0.02),
        ("focal: 3100 +- 2%", "focal:3100+-2%", 3100.0, 0.02),
        ("focal:3100±2%", "focal:3100+-2%", 3100.0, 0.02),
        ("focal35:26+-1.3", "focal35:26+-1.3", 26 * math.hypot(1280, 720) / math.hypot(36, 24), 0.05),
    ],
)
def test_a_focal_length_of_the_users(text, label, focal_px, sigma):
    assert parse_intrinsics(text).label == label
    assert parse_intrinsics(label).label == label
    one = assumed(text, camera=None)
    assert one.camera.K[0, 0] == pytest.approx(focal_px)
    assert one.focal_sigma == pytest.approx(sigma)
    assert one.principal_sigma_px == 12.8
    assert ("taken as exact" in one.basis) == (sigma == 0)


def test_exif_of_a_photograph():
    one = assumed("exif", camera=None, size=(3024, 4032), exif=ExifTags(focal_35mm_mm=26.0))
    assert one.camera.K[0, 0] == pytest.approx(26 * 5040 / math.hypot(36, 24))
    assert (one.camera.K[0, 2], one.camera.K[1, 2]) == (1511.5, 2015.5)
    assert one.focal_sigma == pytest.approx(0.0229, abs=1e-4)
    with pytest.raises(UsageError, match=r"exif: its EXIF has no 35-mm .*; use default, or focal35:MM"):
        assumed("exif", camera=None, exif=ExifTags())


def test_a_calibration_of_the_image_before_it_was_turned(tmp_path):
    file = tmp_path / "bench.json"
    file.write_text(json.dumps(camera_to_json(CAMERA)))
    with pytest.raises(UsageError, match="turned upright"):
        assumed(f"calibrated:{file}", size=(720, 1280))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("defualt", "did you mean default"),
        ("ture", "did you mean true"),
        ("default:widht", "did you mean default:width"),
        ("default:2020", "did you mean default:2020s"),
        ("default:2020s:widht", "did you mean default:2020s:width"),
        ("default:", "unknown"),
        ("default:width:crop43", "unknown"),
        ("default:width:2020s", "unknown"),
        ("default:2020s:", "unknown"),
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
        ("default:crop", "did you mean default:crop43"),
        ("focal", "positive focal length in px, for example focal:3100"),
        ("focal:-1", "positive focal length"),
        ("focal:3100+-", "in px or %, at most half"),
        ("focal:3100+-x", "standard deviation"),
        ("focal:3100+-2000", "at most half of it"),
        ("focal35:26+-80%", "at most half of it, for example focal35:26"),
        ("focal35:nan", "positive focal length in mm"),
        ("calibrated", "give the camera file"),
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
