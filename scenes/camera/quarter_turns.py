"""A camera whose image is turned by quarter turns, as photographs are that were taken with the camera held upright.

A camera has one sensor: photographs taken upright and across share one K only as the sensor stores them. What a viewer
shows, and what `roundel solve` measures, is the image turned as its EXIF orientation says.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera
from roundel.scenes.camera.parameter_covariance import parameter_names

Array = NDArray[np.float64]

# Clockwise quarter turns that show a stored image upright, by its EXIF orientation; the others mirror it.
TURNS = {1: 0, 6: 1, 3: 2, 8: 3}
# With k1, k2, p1, p2 and k3; the tilted and the prism model have axes of their own.
_MOST_COEFFICIENTS = 5


def can_turn(camera: Camera) -> bool:
    """Whether the model describes the camera turned by a quarter turn, too.

    It does without skew, and with a lens of OpenCV's first five coefficients.
    """
    plain = camera.distortion_model == "opencv" and len(camera.distortion) <= _MOST_COEFFICIENTS
    return plain and not camera.K[0, 1] and not camera.magnification


def turned_camera(camera: Camera, covariance: Array | None, turns: int) -> tuple[Camera, Array | None]:
    """The camera of the image turned clockwise by quarter turns, and the covariance of its parameters.

    A quarter turn takes the pixel (x, y) of an image of height H to (H - 1 - y, x). The radial coefficients stay, and
    (p2, p1) turns like any vector of the image.

    Parameters
    ----------
    camera : Camera
        For which `can_turn` is true.
    covariance : (c, c) array or None
        Of `parameter_names(camera)`.
    turns : int
    """
    for _ in range(turns % 4):
        names = parameter_names(camera)
        step = np.eye(len(names))
        for new, old, sign in (("fx", "fy", 1), ("fy", "fx", 1), ("cx", "cy", -1), ("cy", "cx", 1)):
            _set(step, names, new, old, sign)
        if "p1" in names:
            _set(step, names, "p1", "p2", 1)
            _set(step, names, "p2", "p1", -1)
        k = camera.K
        values = step @ np.array([k[0, 0], k[1, 1], k[0, 2], k[1, 2], *camera.distortion])
        values[2] += camera.height_px - 1
        fx, fy, cx, cy, *lens = values.tolist()
        k = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        camera = replace(
            camera, width_px=camera.height_px, height_px=camera.width_px, K=k, distortion=tuple(float(v) for v in lens)
        )
        covariance = None if covariance is None else step @ covariance @ step.T
    return camera, covariance


def _set(step: Array, names: tuple[str, ...], new: str, old: str, sign: int) -> None:
    row = names.index(new)
    step[row] = 0.0
    step[row, names.index(old)] = sign
