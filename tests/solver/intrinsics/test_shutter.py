"""Which rolling shutter the solver assumes: what is declared, else a phone's for an assumed camera."""

import json
from dataclasses import replace

import numpy as np
import pytest

from roundel.scenes.camera.model import Camera, camera_to_json
from roundel.scenes.camera.row_time import GLOBAL_SHUTTER, RowTime
from roundel.scenes.errors import DataError
from roundel.solver.intrinsics.shutter import HELD_BY_HAND
from roundel.solver.intrinsics.specification import parse_intrinsics, uncertain_camera_for

CAMERA = Camera(1280, 720, np.array([[1000.0, 0, 639.5], [0, 1000.0, 359.5], [0, 0, 1]]), focal_35mm_mm=30.0)
DECLARED = RowTime(0.02, 0.1, 5.0)


def shutter(text, declared=None, size=(1280, 720)):
    camera = replace(CAMERA, width_px=size[0], height_px=size[1])
    return uncertain_camera_for(parse_intrinsics(text), camera, *size, row_time=declared).row_time


@pytest.mark.parametrize("text", ["true", "scaled:0.7", "default", "exif", "focal:900", "focal35:26+-1"])
def test_what_is_declared_is_used(text) -> None:
    assert shutter(text, DECLARED) == DECLARED
    assert shutter(text, GLOBAL_SHUTTER) is None
    moving = RowTime(0.0, 0.1, 5.0)  # its exposures are smeared
    assert shutter(text, moving) == moving


def test_nothing_declared() -> None:
    for text in ("true", "scaled:0.7"):
        assert shutter(text) is None
    for text in ("default", "exif", "focal:900", "focal35:26+-1"):
        assert shutter(text) == HELD_BY_HAND


def test_a_photograph_that_was_turned_upright() -> None:
    assert shutter("default", size=(720, 1280)) == replace(HELD_BY_HAND, along_x=True)
    assert shutter("default", DECLARED, size=(720, 1280)) == DECLARED


def test_a_camera_file_declares_its_shutter(tmp_path) -> None:
    file = tmp_path / "phone.json"
    declared = {"readout_s": 0.02, "twist_prior": {"velocity_sigma_m_s": 0.1, "rate_sigma_deg_s": 5}}
    file.write_text(json.dumps(camera_to_json(CAMERA) | declared))
    assert shutter(f"calibrated:{file}") == DECLARED
    # The frame's own declaration is nearer to it than a file for many images.
    assert shutter(f"calibrated:{file}", GLOBAL_SHUTTER) is None
    file.write_text(json.dumps(camera_to_json(CAMERA) | {"readout_s": -1}))
    with pytest.raises(DataError, match=r"phone\.json: camera record: readout_s"):
        parse_intrinsics(f"calibrated:{file}")
