"""The camera of an import as a camera file, and back: parameters with their covariance."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.camera_file import read_camera_record
from roundel.scenes.camera.model import Camera, camera_to_json
from roundel.scenes.camera.parameter_covariance import parameter_covariance
from roundel.scenes.errors import DataError
from roundel.validate.calibration.board_bundle import BoardFit
from roundel.validate.calibration.opencv import read_camera

Array = NDArray[np.float64]


def camera_to_file(fit: BoardFit, camera: Camera, board: str, photographs: Sequence[str]) -> dict[str, Any]:
    """A camera file: the camera keys of `cameras.json`, and the parameters with their covariance.

    Parameters
    ----------
    fit : BoardFit
    camera : Camera
        That of the fit, with what else is known of it.
    board : str
        Its kind.
    photographs : sequence of str
        Names of those that the camera was calibrated from.
    """
    return {
        **camera_to_json(camera),
        "calibration": {
            "board": board,
            "rms_px": float(np.sqrt(np.mean(fit.rms_px**2))),
            "views": len(photographs),
            "photographs": list(photographs),
            "group": None,
            "dataset_id": None,
            "opencv": cv2.__version__,
            "widened": fit.widened,
            "parameters": list(fit.parameters),
            "sigma": dict(zip(fit.parameters, np.sqrt(np.diag(fit.covariance)).tolist(), strict=True)),
            "covariance": fit.covariance.tolist(),
        },
    }


def read_camera_covariance(path: str | Path) -> tuple[Camera, Array | None]:
    """The camera of a camera file, and the covariance (c, c) of its parameters; None if the file has none.

    Raises
    ------
    UsageError
        If there is no such file.
    DataError
        If it is not a camera file, its lens is not OpenCV's, or its covariance is damaged.
    """
    camera = read_camera(path)
    if camera.distortion_model != "opencv" or camera.K[0, 1] != 0 or camera.magnification:
        raise DataError(f"{path}: an import needs OpenCV's lens model without skew; calibrate the camera so")
    try:
        return camera, parameter_covariance(read_camera_record(path), camera)
    except DataError as error:
        raise DataError(f"{path}: {error}") from error
