"""Trajectories for evo and others: poses of the camera in the frame of a marker, in metres.

TUM: `timestamp tx ty tz qx qy qz qw`, https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats. KITTI: the first
three rows of the matrix, https://www.cvlibs.net/datasets/kitti/eval_odometry.php. A frame's time is its number.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from roundel.datasets.export.output import Output
from roundel.datasets.export.reading import ReadFrame, ReadMarker, read_lines
from roundel.datasets.stream.frames import Frame
from roundel.scenes.errors import DataError, first_line

Array = NDArray[np.float64]

LEFT_OUT = (
    "everything but poses: images, cameras, masks, boxes and keypoints are in other formats",
    "times: a frame's number stands for its time",
)


def _inverse(pose: Array) -> Array:
    out = np.eye(4)
    out[:3, :3] = pose[:3, :3].T
    out[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
    return out


def write_trajectories(frames: Iterator[Frame], out: Output, kind: str) -> None:
    """Write marker-N.tum or marker-N.kitti for each marker, and frames-N.txt: the frame of each KITTI line."""
    with ExitStack() as stack:
        files: dict[int, tuple[IO[bytes], IO[bytes] | None]] = {}
        for frame in frames:
            for marker in frame.markers:
                number = marker.marker_id
                if number not in files:
                    poses = stack.enter_context(out.open(f"marker-{number}.{kind}"))
                    names = stack.enter_context(out.open(f"frames-{number}.txt")) if kind == "kitti" else None
                    files[number] = poses, names
                    if kind == "tum":
                        poses.write(b"# timestamp tx ty tz qx qy qz qw: the camera in the marker's frame, metres\n")
                pose, (file, ids) = _inverse(marker.camera_from_marker), files[number]
                if ids is None:
                    values = (*pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_quat())
                    file.write(f"{frame.frame_id} {_numbers(values)}\n".encode())
                else:
                    file.write(f"{_numbers(pose[:3].ravel())}\n".encode())
                    ids.write(f"{frame.frame_id}\n".encode())


def _numbers(values: Array | tuple[float, ...]) -> str:
    return " ".join(repr(float(v)) for v in values)


def read_trajectories(folder: Path) -> Iterator[ReadFrame]:
    """The frames of an export's trajectories, marker after marker.

    Raises
    ------
    DataError
        If a line is not as the format has it, or a rotation is none.
    """
    paths = sorted([*folder.glob("marker-*.tum"), *folder.glob("marker-*.kitti")])
    if not paths:
        raise DataError(f"{folder}: has no marker-N.tum or marker-N.kitti")
    for path in paths:
        marker_id, tum = int(path.stem.removeprefix("marker-")), path.suffix == ".tum"
        lines = [line for line in read_lines(path) if not line.startswith("#")]
        frames = [] if tum else read_lines(folder / f"frames-{marker_id}.txt")
        if not tum and len(frames) != len(lines):
            raise DataError(f"{path}: has {len(lines)} poses, but {len(frames)} frames")
        for number, line in enumerate(lines):
            try:
                values = np.array([float(word) for word in line.split()])
                if len(values) != (8 if tum else 12):
                    raise ValueError(f"{len(values)} numbers")
                pose = np.eye(4)
                if tum:
                    pose[:3, :3], pose[:3, 3] = Rotation.from_quat(values[4:]).as_matrix(), values[1:4]
                else:
                    pose[:3] = values.reshape(3, 4)
                frame_id = int(values[0]) if tum else int(frames[number])
            except ValueError as error:
                raise DataError(f"{path}:{number + 1}: is not a pose: {first_line(error)}") from error
            marker = ReadMarker(marker_id=marker_id, pose=_inverse(pose))
            yield ReadFrame(frame_id, "", markers=[marker])
