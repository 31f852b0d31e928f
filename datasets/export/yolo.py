"""YOLO: a line of numbers for each marker, for keypoints (`pose`) and for outlines (`segment`), and data.yaml.

Source: the documented formats of Ultralytics, https://docs.ultralytics.com/datasets/pose and /segment. Coordinates are
fractions of the image's size, counted from the corner of the first pixel: half a pixel is added to Roundel's.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from roundel.datasets.export.coco import keypoints_of
from roundel.datasets.export.output import Output
from roundel.datasets.export.reading import ReadFrame, ReadMarker, decoded, read_bytes, read_lines
from roundel.datasets.stream.frames import CORNER_PX, KEYPOINTS, Frame, Marker
from roundel.scenes.errors import DataError

Array = NDArray[np.float64]

LEFT_OUT = (
    "the camera",
    "poses, but for what the keypoints say of them",
    "what hides a marker: outlines are those of whole markers, cut by the image",
    "depth",
    "boards and tags: only circular markers are labelled",
)
TASKS = ("pose", "segment")

# Corners of an outline; between them and a circle of radius 1,000 px is at most 0.02 px.
_CORNERS = 512


def write_yolo(frames: Iterator[Frame], out: Output, splits: tuple[str, ...]) -> None:
    """Write frames as two datasets beside each other, `pose` and `segment`, with the same images."""
    categories: dict[str, int] = {}
    for frame in frames:
        name = f"{frame.split}/{frame.frame_id:06d}"
        shown = [m for m in frame.markers if m.box_px is not None]
        lines: dict[str, list[str]] = {task: [] for task in TASKS}
        for marker in shown:
            number = categories.setdefault(marker.category, len(categories))
            lines["pose"].append(_line(number, _pose(frame, marker)))
            lines["segment"].append(_line(number, _outline(frame, marker)))
        for task in TASKS:
            out.write(f"{task}/images/{name}{frame.suffix}", frame.image_bytes)
            out.write(f"{task}/labels/{name}.txt", "".join(lines[task]).encode())
    for task in TASKS:
        out.write(f"{task}/data.yaml", _data_yaml(task, splits, categories))


def _data_yaml(task: str, splits: tuple[str, ...], categories: dict[str, int]) -> bytes:
    # The format wants train and val; of a dataset with one part they are the same.
    parts = {"train": splits[0], "val": "val" if "val" in splits else splits[0]}
    parts |= {"test": "test"} if "test" in splits else {}
    data: dict[str, Any] = {"path": ".", **{part: f"images/{name}" for part, name in parts.items()}}
    data["names"] = {number: name for name, number in categories.items()}
    if task == "pose":
        # Seen in a mirror, +Y and -Y change their places.
        data |= {"kpt_shape": [len(KEYPOINTS), 3], "flip_idx": [0, 1, 4, 3, 2]}
    return yaml.safe_dump(data, sort_keys=False).encode()


def _line(number: int, values: list[float]) -> str:
    return f"{number} " + " ".join(f"{value:.10g}" for value in values) + "\n"


def _box(frame: Frame, marker: Marker) -> list[float]:
    assert marker.box_px is not None, "only markers in the image"
    left, top, right, bottom = (v + CORNER_PX for v in marker.box_px)
    width, height = frame.camera.width_px, frame.camera.height_px
    return [(left + right) / 2 / width, (top + bottom) / 2 / height, (right - left) / width, (bottom - top) / height]


def _pose(frame: Frame, marker: Marker) -> list[float]:
    points = np.reshape(keypoints_of(marker), (-1, 3)) / [frame.camera.width_px, frame.camera.height_px, 1]
    return [*_box(frame, marker), *points.ravel().tolist()]


def _outline(frame: Frame, marker: Marker) -> list[float]:
    size = np.array([frame.camera.width_px, frame.camera.height_px])
    step = max(1, len(marker.outline_px) // _CORNERS)
    points = (marker.outline_px[::step] + CORNER_PX) / size
    return [float(v) for v in np.clip(points, 0.0, 1.0).ravel()]


def read_yolo(folder: Path) -> Iterator[ReadFrame]:
    """The frames of an export: boxes and keypoints of `pose`, outlines of `segment`.

    Raises
    ------
    DataError
        If a file is missing, or not as the format has it.
    """
    data = {task: _read_data(folder / task / "data.yaml") for task in TASKS}
    shape = data["pose"].get("kpt_shape")
    if shape != [len(KEYPOINTS), 3]:
        raise DataError(f"{folder / 'pose' / 'data.yaml'}: kpt_shape is {shape}, not {[len(KEYPOINTS), 3]}")
    names = data["pose"]["names"]
    for split in sorted(p.name for p in (folder / "pose" / "images").iterdir()):
        for image in sorted((folder / "pose" / "images" / split).iterdir()):
            pixels = read_bytes(image)
            height, width = decoded(pixels, str(image)).shape[:2]
            label = f"labels/{split}/{image.stem}.txt"
            pose, outline = (_read_labels(folder / task / label, names) for task in TASKS)
            if [n for n, _ in pose] != [n for n, _ in outline]:
                raise DataError(f"{folder}: {label}: pose and segment have other markers")
            size = np.array([width, height])
            markers = [
                _read_marker(names[n], values, more, size, folder / "pose" / label)
                for (n, values), (_, more) in zip(pose, outline, strict=True)
            ]
            yield ReadFrame(int(image.stem), split, size_px=(width, height), image=pixels, markers=markers)


def _read_data(path: Path) -> dict[str, Any]:
    try:
        data = yaml.safe_load(read_bytes(path))
        names = data["names"]
        if sorted(names) != list(range(len(names))):
            raise ValueError("names are not numbered from 0")
    except (yaml.YAMLError, ValueError, KeyError, TypeError) as error:
        raise DataError(f"{path}: is not as YOLO has it: {' '.join(str(error).split())[:120]}") from error
    return dict(data)


def _read_labels(path: Path, names: dict[int, str]) -> list[tuple[int, Array]]:
    out = []
    for number, line in enumerate(read_lines(path), start=1):
        try:
            head, *rest = line.split()
            values = np.array([float(word) for word in rest])
        except ValueError:
            raise DataError(f"{path}:{number}: is not a line of numbers") from None
        if not head.isdecimal() or int(head) not in names:
            raise DataError(f"{path}:{number}: there is no class {head}")
        out.append((int(head), values))
    return out


def _read_marker(name: str, values: Array, outline: Array, size: Array, path: Path) -> ReadMarker:
    if len(values) != 4 + 3 * len(KEYPOINTS) or len(outline) < 6 or len(outline) % 2:
        raise DataError(f"{path}: a line has {len(values)} numbers, its outline {len(outline)}")
    points = values[4:].reshape(-1, 3)
    coordinates = np.concatenate([values[:4], points[:, :2].ravel(), outline])
    if np.any((coordinates < 0) | (coordinates > 1)) or not set(points[:, 2].tolist()) <= {0.0, 1.0, 2.0}:
        raise DataError(f"{path}: has a coordinate outside the image, or a visibility that is not 0, 1 or 2")
    centre, extent = values[:2] * size, values[2:4] * size
    keypoints = np.where(points[:, 2:] > 0, points[:, :2] * size - CORNER_PX, np.nan)
    return ReadMarker(
        category=name,
        box_px=np.concatenate([centre - extent / 2, centre + extent / 2]) - CORNER_PX,
        keypoints_px=keypoints,
        outline_px=outline.reshape(-1, 2) * size - CORNER_PX,
    )
