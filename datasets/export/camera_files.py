"""Camera files of other tools: COLMAP's text model, Kalibr's camchain, ROS's camera_info.

COLMAP counts pixels from the corner of the first, so that half a pixel is added; Kalibr and ROS take OpenCV's centre.
Sources: https://colmap.github.io/format.html and cameras.html; https://github.com/ethz-asl/kalibr/wiki/yaml-formats;
sensor_msgs/CameraInfo and camera_calibration_parsers.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from roundel.datasets.export.output import Output
from roundel.datasets.export.reading import ReadFrame, ReadMarker, read_bytes, read_lines
from roundel.datasets.stream.frames import CORNER_PX, Frame
from roundel.scenes.camera.model import Camera, distorts
from roundel.scenes.errors import DataError, UsageError

Array = NDArray[np.float64]

_IMAGE = "images, masks, boxes and keypoints: they are in other formats"
_LENS = "the lens: aperture, focus and exposure"
COLMAP_LEFT_OUT = (_IMAGE.replace("images, ", ""), _LENS, "poses of markers other than the first of each frame")
CAMERA_LEFT_OUT = ("images", _IMAGE.replace("images, ", ""), _LENS, "poses")

# COLMAP's models by the number of OpenCV's coefficients.
_COLMAP = {0: "PINHOLE", 4: "OPENCV", 8: "FULL_OPENCV"}


@dataclass(frozen=True)
class _Model:
    """A camera model of another tool, with its distortion."""

    name: str
    coefficients: tuple[float, ...]


def _refuse(frame: Frame, tool: str, what: str) -> UsageError:
    return UsageError(
        f"frame {frame.frame_id}: its camera has {what}, for which {tool} has no model; use another format"
    )


def _coefficients(camera: Camera, count: int) -> tuple[float, ...] | None:
    """OpenCV's first coefficients; None if others differ from zero."""
    mine = camera.distortion if distorts(camera) else ()
    if any(mine[count:]):
        return None
    return (*mine[:count], *[0.0] * (count - len(mine)))


def _model(frame: Frame, tool: str, fisheye: str, opencv: dict[int, str]) -> _Model:
    """The tool's smallest model that holds the frame's lens."""
    camera = frame.camera
    if camera.K[0, 1] != 0.0:
        raise _refuse(frame, tool, "skew")
    if camera.distortion_model == "fisheye" and distorts(camera):
        return _Model(fisheye, camera.distortion)
    for count, name in sorted(opencv.items()):
        found = _coefficients(camera, count)
        if found is not None:
            return _Model(name, found)
    raise _refuse(frame, tool, f"{len(camera.distortion)} coefficients of distortion")


def write_colmap(frames: Iterator[Frame], out: Output) -> None:
    """Write a text model: cameras.txt, images.txt and an empty points3D.txt, with the images beside it.

    The world is the first marker of each frame: images.txt has `camera_from_marker` of it, in metres.
    """
    known: dict[str, int] = {}
    with out.open("sparse/0/images.txt") as poses:
        poses.write(b"# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME; the world is the marker, in metres\n")
        for frame in frames:
            number = known.setdefault(_colmap_camera(frame), len(known) + 1)
            name = f"{frame.frame_id:06d}{frame.suffix}"
            out.write(f"images/{name}", frame.image_bytes)
            if frame.markers:
                pose = frame.markers[0].camera_from_marker
                numbers = " ".join(repr(float(v)) for v in (*_quaternion_wxyz(pose), *pose[:3, 3]))
                # Line 2 of an image has its points: none.
                poses.write(f"{frame.frame_id + 1} {numbers} {number} {name}\n\n".encode())
    lines = "".join(f"{number} {text}\n" for text, number in known.items())
    out.write("sparse/0/cameras.txt", f"# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS\n{lines}".encode())
    out.write("sparse/0/points3D.txt", b"# no points\n")


def _quaternion_wxyz(pose: Array) -> Array:
    x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat()
    return np.array([w, x, y, z])


def _colmap_camera(frame: Frame) -> str:
    model, k = _model(frame, "COLMAP", "OPENCV_FISHEYE", _COLMAP), frame.camera.K
    values = (k[0, 0], k[1, 1], k[0, 2] + CORNER_PX, k[1, 2] + CORNER_PX, *model.coefficients)
    numbers = " ".join(repr(float(v)) for v in values)
    return f"{model.name} {frame.camera.width_px} {frame.camera.height_px} {numbers}"


def write_kalibr(frames: Iterator[Frame], out: Output) -> None:
    """Write camchain.yaml with the camera that all frames share."""
    model, camera = _only_camera(frames, "Kalibr", "equidistant", {4: "radtan"})
    k = camera.K
    chain = {
        "cam0": {
            "camera_model": "pinhole",
            "intrinsics": [float(v) for v in (k[0, 0], k[1, 1], k[0, 2], k[1, 2])],
            "distortion_model": model.name,
            "distortion_coeffs": [float(v) for v in model.coefficients],
            "resolution": [camera.width_px, camera.height_px],
            "rostopic": "/cam0/image_raw",
        }
    }
    out.write("camchain.yaml", yaml.safe_dump(chain, sort_keys=False).encode())


def write_ros(frames: Iterator[Frame], out: Output) -> None:
    """Write camera_info.yaml with the camera that all frames share."""
    model, camera = _only_camera(frames, "ROS", "equidistant", {5: "plumb_bob", 8: "rational_polynomial"})

    def matrix(values: Array) -> dict[str, Any]:
        return {"rows": len(values), "cols": values.shape[1], "data": [float(v) for v in values.ravel()]}

    info = {
        "image_width": camera.width_px,
        "image_height": camera.height_px,
        "camera_name": "roundel",
        "camera_matrix": matrix(camera.K),
        "distortion_model": model.name,
        "distortion_coefficients": matrix(np.array([model.coefficients])),
        "rectification_matrix": matrix(np.eye(3)),
        "projection_matrix": matrix(np.column_stack([camera.K, np.zeros(3)])),
    }
    out.write("camera_info.yaml", yaml.safe_dump(info, sort_keys=False).encode())


def _only_camera(frames: Iterator[Frame], tool: str, fisheye: str, opencv: dict[int, str]) -> tuple[_Model, Camera]:
    first = next(frames)
    model = _model(first, tool, fisheye, opencv)
    for frame in frames:
        if _identity(frame.camera) != _identity(first.camera):
            raise UsageError(
                f"frame {frame.frame_id}: its camera is not that of frame {first.frame_id}, and {tool}'s file has one; "
                "export a group with one camera (--groups), or use colmap"
            )
    return model, first.camera


def _identity(camera: Camera) -> tuple[object, ...]:
    return camera.width_px, camera.height_px, tuple(camera.K.ravel()), camera.distortion_model, camera.distortion


def read_colmap(folder: Path) -> Iterator[ReadFrame]:
    """The frames of a text model.

    Raises
    ------
    DataError
        If a file is missing, or not as the format has it.
    """
    model = folder / "sparse" / "0"
    cameras: dict[str, tuple[tuple[int, int], Array, tuple[float, ...]]] = {}
    for line in _lines(model / "cameras.txt"):
        number, name, width, height, *values = line.split()
        fx, fy, cx, cy, *numbers = (float(v) for v in values)
        counts = {"PINHOLE": 0, "OPENCV": 4, "OPENCV_FISHEYE": 4, "FULL_OPENCV": 8}
        if counts.get(name) != len(numbers):
            raise DataError(f"{model / 'cameras.txt'}: camera {number}: {name} with {len(numbers)} coefficients")
        k = np.array([[fx, 0.0, cx - CORNER_PX], [0.0, fy, cy - CORNER_PX], [0.0, 0.0, 1.0]])
        cameras[number] = (int(width), int(height)), k, tuple(numbers)
    for line in _lines(model / "images.txt"):
        number, *values, camera, name = line.split()
        if camera not in cameras or len(values) != 7:
            raise DataError(f"{model / 'images.txt'}: image {number}: camera {camera}, {len(values)} numbers")
        w, x, y, z, *t = (float(v) for v in values)
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = Rotation.from_quat([x, y, z, w]).as_matrix(), t
        size, k, coefficients = cameras[camera]
        image = read_bytes(folder / "images" / name)
        marker = ReadMarker(pose=pose)
        yield ReadFrame(int(number) - 1, "", k, coefficients, size, image, markers=[marker])


def _lines(path: Path) -> list[str]:
    return [line for line in read_lines(path) if line.strip() and not line.startswith("#")]


def read_camera(folder: Path) -> ReadFrame:
    """The camera of a camchain.yaml or camera_info.yaml, as a frame without a number.

    Raises
    ------
    DataError
        If it is not as the format has it.
    """
    path = next((p for p in (folder / "camchain.yaml", folder / "camera_info.yaml") if p.exists()), folder)
    try:
        data = yaml.safe_load(read_bytes(path))
        if path.name == "camchain.yaml":
            cam = data["cam0"]
            fx, fy, cx, cy = (float(v) for v in cam["intrinsics"])
            k = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
            if cam["camera_model"] != "pinhole" or cam["distortion_model"] not in ("radtan", "equidistant"):
                raise ValueError(f"{cam['camera_model']}, {cam['distortion_model']}")
            size, numbers = tuple(cam["resolution"]), cam["distortion_coeffs"]
        else:
            k = np.reshape(np.array(data["camera_matrix"]["data"], dtype=np.float64), (3, 3))
            size, numbers = (data["image_width"], data["image_height"]), data["distortion_coefficients"]["data"]
            counts = {"plumb_bob": 5, "rational_polynomial": 8, "equidistant": 4}
            if counts.get(data["distortion_model"]) != len(numbers):
                raise ValueError(f"{data['distortion_model']} with {len(numbers)} coefficients")
            projection = np.reshape(np.array(data["projection_matrix"]["data"], dtype=np.float64), (3, 4))
            if not np.array_equal(projection[:, :3], k):
                raise ValueError("projection_matrix is not camera_matrix")
        return ReadFrame(None, "", k, tuple(float(v) for v in numbers), (int(size[0]), int(size[1])))
    except (yaml.YAMLError, KeyError, ValueError, TypeError, IndexError) as error:
        raise DataError(f"{path}: is not as the format has it: {' '.join(str(error).split())[:120]}") from error
