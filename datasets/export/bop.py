"""BOP: scenes of frames with poses in millimetres, masks, 16-bit depth, and a model of each kind of marker.

Source: BOP's format, https://github.com/thodan/bop_toolkit/blob/master/docs/bop_datasets_format.md. Integer pixel
coordinates are the centres of pixels, as in Roundel: K is unchanged.
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.datasets.export.output import Output, json_bytes
from roundel.datasets.export.reading import ReadFrame, ReadMarker, read_bytes, read_json, read_picture
from roundel.datasets.stream.frames import Frame, Marker
from roundel.datasets.stream.masks import box_of
from roundel.scenes.camera.model import distorts
from roundel.scenes.errors import DataError, UsageError, first_line

FOLDERS = {"train": "train_pbr", "val": "val", "test": "test"}
LEFT_OUT = (
    "the lens: aperture, focus and exposure",
    "motion: poses are those at mid-exposure of the marker's centre row",
    "the conic, the contour to a fraction of a pixel, the second candidate pose",
    "boards and tags: only circular markers are objects",
    "noise: levels and their standard deviations at the edge",
)

_SCENE_FRAMES = 1000
# Millimetres in a level of a depth image: the finer, if all depths of the image fit.
_DEPTH_MM = (0.1, 1.0)
_LARGEST = (1 << 16) - 1
# Corners of a model's rim: MSSD and MSPD at corners are within 4e-7 of those of the circle.
_RIM = 3600
# Smallest visible fraction of a target of the challenge.
_TARGET = 0.1


@dataclass
class _Scene:
    folder: str
    number: int
    cameras: dict[str, Any] = field(default_factory=dict)
    poses: dict[str, list[Any]] = field(default_factory=dict)
    infos: dict[str, list[Any]] = field(default_factory=dict)

    @property
    def path(self) -> str:
        return f"{self.folder}/{self.number:06d}"


def write_bop(frames: Iterator[Frame], out: Output, splits: tuple[str, ...]) -> None:
    """Write frames as a BOP dataset.

    Raises
    ------
    UsageError
        If a frame has lens distortion, or another size than the first; or its depth does not fit into 16 bits.
    """
    scenes = {split: _Scene(FOLDERS[split], 0) for split in splits}
    objects: dict[str, int] = {}
    models: dict[str, Any] = {}
    targets: list[dict[str, int]] = []
    camera: dict[str, Any] = {}
    for frame in frames:
        _check(frame, camera)
        scene = scenes[frame.split]
        if len(scene.cameras) == _SCENE_FRAMES:
            _end_scene(out, scene)
            scene = scenes[frame.split] = _Scene(scene.folder, scene.number + 1)
        for marker in frame.markers:
            number = objects.setdefault(marker.category, len(objects) + 1)
            if str(number) not in models:
                models[str(number)] = _write_model(out, number, marker)
        scale = _write_images(out, scene, frame)
        entry = {"cam_K": frame.camera.K.ravel().tolist(), "depth_scale": scale}
        if not camera:
            k, size = frame.camera.K, (frame.camera.width_px, frame.camera.height_px)
            camera |= {"cx": float(k[0, 2]), "cy": float(k[1, 2]), "fx": float(k[0, 0]), "fy": float(k[1, 1])}
            camera |= {"depth_scale": scale, "width": size[0], "height": size[1]}
        key = str(frame.frame_id)
        scene.cameras[key] = entry
        scene.poses[key] = [_pose(marker, objects) for marker in frame.markers]
        scene.infos[key] = infos = [_info(frame, marker) for marker in frame.markers]
        if frame.split == "test":
            targets += _targets(scene.number, frame, infos, objects)
    for scene in scenes.values():
        if scene.cameras:
            _end_scene(out, scene)
    out.write("models/models_info.json", _pretty(models))
    out.write("camera.json", _pretty(camera))
    if "test" in splits:
        out.write("test_targets_bop19.json", _pretty(targets))


def _check(frame: Frame, camera: dict[str, Any]) -> None:
    if distorts(frame.camera):
        raise UsageError(f"frame {frame.frame_id}: has lens distortion, for which BOP has no place; use another format")
    size = frame.camera.width_px, frame.camera.height_px
    if camera and size != (camera["width"], camera["height"]):
        raise UsageError(
            f"frame {frame.frame_id}: is {size[0]}x{size[1]} px, the first {camera['width']}x{camera['height']}, and a "
            "BOP dataset has one size: export the groups apart with --groups"
        )


def _end_scene(out: Output, scene: _Scene) -> None:
    for name, records in (("camera", scene.cameras), ("gt", scene.poses), ("gt_info", scene.infos)):
        lines = [f'  "{key}": '.encode() + json_bytes(value) for key, value in records.items()]
        out.write(f"{scene.path}/scene_{name}.json", b"{\n" + b",\n".join(lines) + b"\n}\n")


def _write_images(out: Output, scene: _Scene, frame: Frame) -> float:
    """The image, its depth if there is one, and the masks; returns the millimetres of a level of depth."""
    image, name = frame.image, f"{frame.frame_id:06d}"
    out.write(f"{scene.path}/{'rgb' if image.ndim == 3 else 'gray'}/{name}{frame.suffix}", frame.image_bytes)
    scale = _DEPTH_MM[0]
    if frame.depth_m is not None:
        depth_mm = 1000 * np.where(np.isfinite(frame.depth_m), frame.depth_m, 0.0).astype(np.float64)
        fitting = [s for s in _DEPTH_MM if depth_mm.max() <= s * _LARGEST]
        if not fitting:
            raise UsageError(
                f"frame {frame.frame_id}: a depth of {depth_mm.max() / 1000:.4g} m does not fit into BOP's 16 bits; "
                "leave depth out with --no-depth"
            )
        scale = fitting[0]
        out.write(f"{scene.path}/depth/{name}.png", png_bytes(np.rint(depth_mm / scale).astype(np.uint16)))
    for i, marker in enumerate(frame.markers):
        for folder, mask in (("mask", marker.full_mask), ("mask_visib", marker.visible_mask)):
            out.write(f"{scene.path}/{folder}/{name}_{i:06d}.png", png_bytes(mask.astype(np.uint8) * 255))
    return scale


def png_bytes(image: NDArray[Any]) -> bytes:
    """An image of 8 or 16 bits as PNG; the bytes depend on its pixels alone."""
    from PIL import Image

    sink = io.BytesIO()
    Image.fromarray(image).save(sink, format="PNG", compress_level=6)
    return sink.getvalue()


def _pose(marker: Marker, objects: dict[str, int]) -> dict[str, Any]:
    pose = marker.camera_from_marker
    return {
        "cam_R_m2c": pose[:3, :3].ravel().tolist(),
        "cam_t_m2c": (1000 * pose[:3, 3]).tolist(),
        "obj_id": objects[marker.category],
    }


def _info(frame: Frame, marker: Marker) -> dict[str, Any]:
    """Boxes are [left, top, width, height] with width = last - first column, as in BOP's toolkit; -1 for none."""
    x0, y0, window = marker.full_window
    whole, visible = box_of(window), box_of(marker.visible_mask)
    every, seen = int(window.sum()), int(marker.visible_mask.sum())
    valid = marker.full_mask if frame.depth_m is None else marker.full_mask & (frame.depth_m > 0)
    return {
        "bbox_obj": _box(whole, x0, y0),
        "bbox_visib": _box(visible),
        "px_count_all": every,
        "px_count_valid": int(valid.sum()),
        "px_count_visib": seen,
        "visib_fract": seen / every if every else 0.0,
    }


def _box(box: tuple[int, int, int, int] | None, x0: int = 0, y0: int = 0) -> list[int]:
    if box is None:
        return [-1, -1, -1, -1]
    return [box[0] + x0, box[1] + y0, box[2] - box[0], box[3] - box[1]]


def _targets(scene: int, frame: Frame, infos: list[dict[str, Any]], objects: dict[str, int]) -> list[dict[str, int]]:
    counts: dict[int, int] = {}
    for marker, info in zip(frame.markers, infos, strict=True):
        if info["visib_fract"] >= _TARGET:
            number = objects[marker.category]
            counts[number] = counts.get(number, 0) + 1
    return [
        {"im_id": frame.frame_id, "inst_count": count, "obj_id": number, "scene_id": scene}
        for number, count in sorted(counts.items())
    ]


def _write_model(out: Output, number: int, marker: Marker) -> dict[str, Any]:
    """A flat disc as a mesh of triangles, and its entry of models_info.json; millimetres."""
    radius = 1000 * marker.diameter_m / 2
    angle = 2 * np.pi * np.arange(_RIM) / _RIM
    rim = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(_RIM)])
    corners = np.vstack([np.zeros((1, 3)), rim])
    head = (
        f"ply\nformat ascii 1.0\nelement vertex {len(corners)}\n"
        + "".join(f"property float {axis}\n" for axis in ("x", "y", "z", "nx", "ny", "nz"))
        + f"element face {_RIM}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    points = "".join(f"{x:.9g} {y:.9g} {z:.9g} 0 0 1\n" for x, y, z in corners.tolist())
    faces = "".join(f"3 0 {i + 1} {(i + 1) % _RIM + 1}\n" for i in range(_RIM))
    out.write(f"models/obj_{number:06d}.ply", (head + points + faces).encode())
    size = 2 * radius
    symmetry = {"symmetries_continuous": [{"axis": [0, 0, 1], "offset": [0, 0, 0]}]} if marker.is_symmetric else {}
    ends = {"min_x": -radius, "min_y": -radius, "min_z": 0.0, "size_x": size, "size_y": size, "size_z": 0.0}
    return {"diameter": size, **ends, **symmetry, "name": marker.category}


def _pretty(value: Any) -> bytes:
    return (json.dumps(value, indent=2, allow_nan=False) + "\n").encode()


def read_bop(folder: Path) -> Iterator[ReadFrame]:
    """The frames of a BOP dataset.

    Raises
    ------
    DataError
        If a file is missing, or not as the format has it.
    """
    models = read_json(folder / "models" / "models_info.json", dict)
    for split, name in FOLDERS.items():
        for scene in sorted((folder / name).glob("[0-9]*")):
            cameras, poses, infos = (read_json(scene / f"scene_{n}.json", dict) for n in ("camera", "gt", "gt_info"))
            if not set(cameras) == set(poses) == set(infos):
                raise DataError(f"{scene}: scene_camera, scene_gt and scene_gt_info have other images")
            for key, camera in cameras.items():
                yield _read_frame(scene, split, int(key), camera, poses[key], infos[key], models)


def _read_frame(
    scene: Path,
    split: str,
    frame_id: int,
    camera: dict[str, Any],
    poses: list[dict[str, Any]],
    infos: list[dict[str, Any]],
    models: dict[str, Any],
) -> ReadFrame:
    name, place = f"{frame_id:06d}", f"{scene}: image {frame_id}"
    images = [file for folder in ("rgb", "gray") for file in (scene / folder).glob(f"{name}.*")]
    if len(images) != 1:
        raise DataError(f"{place}: has {len(images)} files in rgb and gray, not one")
    try:
        depth = scene / "depth" / f"{name}.png"
        depth_m = camera["depth_scale"] / 1000 * read_picture(depth).astype(np.float64) if depth.exists() else None
        markers = []
        for i, (pose, info) in enumerate(zip(poses, infos, strict=True)):
            matrix = np.eye(4)
            matrix[:3, :3] = np.reshape(pose["cam_R_m2c"], (3, 3))
            matrix[:3, 3] = np.array(pose["cam_t_m2c"]) / 1000
            model = models[str(pose["obj_id"])]
            full, visible = (read_picture(scene / f / f"{name}_{i:06d}.png") > 0 for f in ("mask", "mask_visib"))
            markers.append(
                ReadMarker(
                    pose=matrix,
                    diameter_m=model["diameter"] / 1000,
                    category=model.get("name"),
                    full_mask=full,
                    visible_mask=visible,
                    facts={**info, "symmetric": "symmetries_continuous" in model},
                )
            )
        k = np.reshape(np.array(camera["cam_K"], dtype=np.float64), (3, 3))
        return ReadFrame(frame_id, split, k=k, image=read_bytes(images[0]), depth_m=depth_m, markers=markers)
    except (KeyError, ValueError, TypeError) as error:
        raise DataError(f"{place}: is not as BOP has it: {type(error).__name__} at {first_line(error)}") from error
