"""COCO: boxes, run-length masks and keypoints, with camera and pose in keys of their own.

Source: https://cocodataset.org/#format-data. Coordinates count from the corner of the first pixel: half a pixel is
added to Roundel's.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, cast

import numpy as np

from roundel.datasets.export.output import Output, json_bytes
from roundel.datasets.export.reading import ReadFrame, ReadMarker, read_bytes, read_json
from roundel.datasets.stream.frames import CORNER_PX, KEYPOINTS, Frame, Marker
from roundel.datasets.stream.masks import mask_of_runs, run_lengths
from roundel.scenes.errors import DataError, first_line

LEFT_OUT = (
    "depth",
    "the lens: aperture, focus and exposure",
    "motion: poses are those at mid-exposure of the marker's centre row",
    "the conic and the second candidate pose",
    "boards and tags: only circular markers are annotated",
    "noise: levels and their standard deviations at the edge",
)

# Lines between keypoints, numbered from 1: the centre to the rim's points.
_SKELETON = [[1, 2], [1, 3], [1, 4], [1, 5]]


@dataclass
class _Split:
    """The annotations of a split: images go to one temporary file and annotations to another, and are joined."""

    images: IO[bytes]
    annotations: IO[bytes]
    counts: dict[str, int] = field(default_factory=lambda: {"images": 0, "annotations": 0})

    def add(self, kind: str, record: dict[str, Any]) -> None:
        """Add a record to one of the lists."""
        file = self.images if kind == "images" else self.annotations
        file.write((b",\n" if self.counts[kind] else b"\n") + json_bytes(record))
        self.counts[kind] += 1


def write_coco(frames: Iterator[Frame], out: Output, splits: tuple[str, ...], about: dict[str, Any]) -> None:
    """Write frames with COCO's annotations.

    Parameters
    ----------
    frames : iterator of Frame
    out : Output
    splits : tuple of str
    about : dict
        `name` and `licence` of the dataset.
    """
    categories: dict[str, int] = {}
    with ExitStack() as stack:
        files = {s: _Split(_spool(stack), _spool(stack)) for s in splits}
        for frame in frames:
            split = files[frame.split]
            name = f"{frame.split}/{frame.frame_id:06d}{frame.suffix}"
            out.write(f"images/{name}", frame.image_bytes)
            split.add("images", _image(frame, name))
            for marker in frame.markers:
                category = categories.setdefault(marker.category, len(categories) + 1)
                if marker.box_px is not None:
                    number = split.counts["annotations"] + 1
                    split.add("annotations", annotation_of(frame, marker, category, number))
        for name, split in files.items():
            with out.open(f"annotations/instances_{name}.json") as file:
                _join(file, split, _head(about, categories))


def _spool(stack: ExitStack) -> IO[bytes]:
    return cast(IO[bytes], stack.enter_context(tempfile.TemporaryFile()))


def _join(file: IO[bytes], split: _Split, head: dict[str, Any]) -> None:
    file.write(b'{\n"info": ' + json_bytes(head["info"]) + b',\n"licenses": ' + json_bytes(head["licenses"]))
    file.write(b',\n"categories": ' + json_bytes(head["categories"]))
    for kind, source in (("images", split.images), ("annotations", split.annotations)):
        file.write(f',\n"{kind}": ['.encode())
        source.seek(0)
        shutil.copyfileobj(source, file)
        file.write(b"\n]")
    file.write(b"\n}\n")


def _head(about: dict[str, Any], categories: dict[str, int]) -> dict[str, Any]:
    described = "Coordinates count from the corner of the first pixel; camera_from_marker is in metres."
    return {
        "info": {"description": f"{about['name']}. {described}", "version": about["dataset_id"][:12]},
        "licenses": [{"id": 1, "name": about["licence"]}],
        "categories": [
            {"id": n, "name": name, "supercategory": "marker", "keypoints": list(KEYPOINTS), "skeleton": _SKELETON}
            for name, n in categories.items()
        ],
    }


def _corner_k(frame: Frame) -> list[list[float]]:
    """The calibration matrix for coordinates from the corner of the first pixel."""
    k = frame.camera.K.copy()
    k[:2, 2] += CORNER_PX
    return [[float(v) for v in row] for row in k]


def _image(frame: Frame, name: str) -> dict[str, Any]:
    return {
        "id": frame.frame_id,
        "file_name": name,
        "width": frame.camera.width_px,
        "height": frame.camera.height_px,
        "license": 1,
        "group": frame.group,
        "K": _corner_k(frame),
        "distortion_model": frame.record.get("distortion_model", "opencv"),
        "distortion": [float(v) for v in frame.camera.distortion],
    }


def annotation_of(frame: Frame, marker: Marker, category: int, number: int) -> dict[str, Any]:
    """A marker as an annotation: the box is that of the outline in the image, the mask is what is seen.

    `area` is that of the mask to a fraction of a pixel, where the dataset keeps coverage.
    """
    assert marker.box_px is not None, "only markers in the image"
    left, top, right, bottom = marker.box_px
    visible = marker.visible_mask
    size = [frame.camera.height_px, frame.camera.width_px]
    area = visible.sum() if marker.coverage is None else marker.coverage.sum(dtype=np.float64)
    return {
        "id": number,
        "image_id": frame.frame_id,
        "category_id": category,
        "iscrowd": 0,
        "bbox": [left + CORNER_PX, top + CORNER_PX, right - left, bottom - top],
        "area": float(area),
        "segmentation": {"counts": run_lengths(visible), "size": size},
        "segmentation_full": {"counts": run_lengths(marker.full_mask), "size": size},
        "keypoints": keypoints_of(marker),
        "num_keypoints": int(marker.keypoints_in_image.sum()),
        "marker_id": marker.marker_id,
        "diameter_m": marker.diameter_m,
        "camera_from_marker": marker.camera_from_marker.tolist(),
        "visible_fraction": marker.truth["visible_fraction"],
    }


def keypoints_of(marker: Marker) -> list[float]:
    """x, y, v of each keypoint: v is 2 where it is seen, 1 where something hides it, 0 (with x = y = 0) outside."""
    out: list[float] = []
    for (x, y), inside, seen in zip(
        marker.keypoints_px.tolist(), marker.keypoints_in_image, marker.keypoints_visible, strict=True
    ):
        out += [x + CORNER_PX, y + CORNER_PX, 2 if seen else 1] if inside else [0.0, 0.0, 0]
    return out


def read_coco(folder: Path) -> Iterator[ReadFrame]:
    """The frames of an export in COCO's format.

    Raises
    ------
    DataError
        If a file is missing, or not as the format has it; COCO's own client accepts nearly anything.
    """
    files = sorted((folder / "annotations").glob("instances_*.json"))
    if not files:
        raise DataError(f"{folder}: has no annotations/instances_*.json")
    for file in files:
        split = file.stem.removeprefix("instances_")
        whole = read_json(file, dict)
        try:
            categories = {c["id"]: c["name"] for c in whole["categories"]}
            sizes = {image["id"]: (int(image["width"]), int(image["height"])) for image in whole["images"]}
            markers: dict[int, list[ReadMarker]] = {number: [] for number in sizes}
            seen: set[int] = set()
            for a in whole["annotations"]:
                for key, known in (("category_id", categories), ("image_id", sizes)):
                    if a[key] not in known:
                        raise DataError(f"{file}: annotation {a['id']}: there is no {key} {a[key]}")
                if a["id"] in seen:
                    raise DataError(f"{file}: annotation {a['id']}: is there twice")
                seen.add(a["id"])
                markers[a["image_id"]].append(_read_marker(a, categories, *sizes[a["image_id"]]))
            for image in whole["images"]:
                k = np.array(image["K"], dtype=np.float64)
                k[:2, 2] -= CORNER_PX
                yield ReadFrame(
                    image["id"],
                    split,
                    k=k,
                    distortion=tuple(image["distortion"]),
                    size_px=sizes[image["id"]],
                    image=read_bytes(folder / "images" / image["file_name"]),
                    markers=markers[image["id"]],
                )
        except (KeyError, ValueError, TypeError, IndexError) as error:
            raise DataError(f"{file}: is not as COCO has it: {type(error).__name__} at {first_line(error)}") from error


def _read_marker(a: dict[str, Any], categories: dict[int, str], width: int, height: int) -> ReadMarker:
    x, y, w, h = a["bbox"]
    if not (w > 0 and h > 0 and x >= 0 and y >= 0 and x + w <= width + 1e-9 and y + h <= height + 1e-9):
        raise ValueError(f"annotation {a['id']}: the box lies outside the image")
    for name in ("segmentation", "segmentation_full"):
        if a[name]["size"] != [height, width]:
            raise ValueError(f"annotation {a['id']}: {name} has another size than the image")
    points = np.reshape(np.array(a["keypoints"], dtype=np.float64), (len(KEYPOINTS), 3))
    shown = np.where(points[:, 2:] > 0, points[:, :2] - CORNER_PX, np.nan)
    return ReadMarker(
        marker_id=a["marker_id"],
        pose=np.array(a["camera_from_marker"], dtype=np.float64),
        diameter_m=a["diameter_m"],
        category=categories[a["category_id"]],
        full_mask=mask_of_runs(a["segmentation_full"]["counts"], height, width),
        visible_mask=mask_of_runs(a["segmentation"]["counts"], height, width),
        box_px=np.array([x, y, x + w, y + h]) - CORNER_PX,
        keypoints_px=shown,
        facts={"area": a["area"], "num_keypoints": a["num_keypoints"]},
    )
