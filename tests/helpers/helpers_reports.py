"""Small datasets and estimates for the validator, without the renderer or the solver's image processing."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from helpers_boards import corner_rays, subpixel_rays
from PIL import Image
from scipy.ndimage import binary_dilation

from roundel.datasets.dataset import Dataset, open_dataset
from roundel.datasets.environment import environment_of, key_of
from roundel.datasets.finish import Frames, finish_shard
from roundel.datasets.layout import files
from roundel.datasets.layout.shards import shard_of, shards_of
from roundel.datasets.records import study_bytes, write_manifest
from roundel.datasets.store.folder import Folder
from roundel.datasets.store.writing import sha256, write_file
from roundel.scenes.camera.model import Camera
from roundel.scenes.geometry.conic import conic_of_ellipse
from roundel.scenes.geometry.pose import minimal_rotation
from roundel.scenes.markers.ink_pattern import reflectance_at
from roundel.scenes.study.study import load_study
from roundel.scenes.world.frame import Frame, frames_of, total_frames
from roundel.solver.pose.circle_pose import poses_from_conic

POINTS = """\
schema: 1
name: points
seed: 4
mode: points
camera: {width_px: 1280, height_px: 720, focal_px: 1280}
marker: {kind: disc, diameter_m: 0.08}
pose:
  tilt_deg: {grid: [15, 30, 45]}
  distance_D: {grid: [15, 25, 40]}
  azimuth_deg: {uniform: [-180, 180]}
  offset_x_px: {uniform: [-5, 5]}
frames_per_cell: 4
solve: {intrinsics: ["scaled:0.7", "scaled:1", "scaled:1.3"]}
"""

BOARDS = """\
schema: 1
name: boards
seed: 5
camera: {width_px: 640, height_px: 480, focal_px: 600, distortion: [-0.1, 0.03, 0.0005, -0.0007]}
groups:
  calibration:
    marker: {kind: chessboard, columns: 9, rows: 6, square_m: 0.025}
    pose:
      distance_m: {uniform: [0.4, 0.5]}
      tilt_deg: {uniform: [10, 45]}
      azimuth_deg: {uniform: [-180, 180]}
      offset_x_px: {uniform: [-60, 60]}
      offset_y_px: {uniform: [-50, 50]}
    frames: 5
  marker:
    marker:
      kind: disc_with_chessboard
      diameter_m: 0.08
      gap_m: 0.02
      chessboard: {columns: 5, rows: 4, square_m: 0.02}
    pose:
      tilt_deg: {uniform: [15, 45]}
      distance_m: {uniform: [0.45, 0.6]}
      azimuth_deg: {uniform: [-180, 180]}
      offset_x_px: -120
    frames: 4
solve: {groups: [marker], intrinsics: ["true", calibrated, default], calibrate_from: calibration}
"""


def sheet_image(frame: Frame, subpixels: int = 8) -> np.ndarray:
    """Noise-free 8-bit image of a frame's sheet in uniform illumination; only edges are subdivided."""
    camera, pose = frame.camera, frame.camera_from_sheet

    def seen(xy: np.ndarray) -> np.ndarray:
        ray = np.concatenate([xy, np.ones((*xy.shape[:-1], 1))], axis=-1)
        depth = (pose[:3, 2] @ pose[:3, 3]) / (ray @ pose[:3, 2])
        flat = (ray * depth[..., None] - pose[:3, 3]) @ pose[:3, :2]
        return np.asarray(reflectance_at(frame.sheet, flat[..., 0], flat[..., 1]))

    corner = corner_rays(
        camera.width_px, camera.height_px, tuple(camera.K.ravel()), camera.distortion, camera.distortion_model
    )
    value = seen(corner)
    four = np.stack([value[:-1, :-1], value[1:, :-1], value[:-1, 1:], value[1:, 1:]])
    image = four.mean(axis=0)
    mixed = binary_dilation(np.ptp(four, axis=0) > 0, np.ones((3, 3)))
    image[mixed] = seen(subpixel_rays(corner, mixed, subpixels)).mean(axis=1)
    return np.rint(255 * image).astype(np.uint8)


def make_dataset(folder: Path, text: str) -> Dataset:
    """A finished dataset of a study, with images drawn by `sheet_image`."""
    folder.mkdir(parents=True, exist_ok=True)
    source = folder.parent / f"{folder.name}.yaml"
    source.write_text(text)
    study = load_study(source)
    write_file(folder / files.STUDY, study_bytes(study))
    entries: dict[int, dict[str, Any]] = {}
    for frame in frames_of(study):
        if frame.settings.mode != "images":
            continue
        sink = io.BytesIO()
        Image.fromarray(sheet_image(frame)).save(sink, format="PNG")
        name, data = files.image_name(frame.frame_id), sink.getvalue()
        write_file(folder / shard_of(total_frames(study), frame.frame_id).name(name), data)
        entries[frame.frame_id] = {
            "frame_id": frame.frame_id,
            "group": frame.group,
            "files": {name: {"sha256": sha256(data), "bytes": len(data)}},
            "photometry": {},
            "fidelity": {},
        }
    own = environment_of({"variant": None})
    records = []
    for shard in shards_of(total_frames(study)):
        its = {i: {**entry, "environment": key_of(own)} for i, entry in entries.items() if i in shard.frames}
        records.append((shard, finish_shard(study, Folder(folder), shard, Frames(its, {}, {key_of(own): own}))))
    write_manifest(study, Folder(folder), records, own)
    return open_dataset(folder)


def used_camera(camera: Camera, intrinsics: str) -> Camera:
    """The intrinsics of a label."""
    if intrinsics.startswith("scaled:"):
        k = camera.K.copy()
        k[[0, 1], [0, 1]] *= float(intrinsics.partition(":")[2])
        return replace(camera, K=k)
    if intrinsics == "default":
        focal = 29.95 * np.hypot(camera.width_px, camera.height_px) / np.hypot(36, 24)
        k = np.array([[focal, 0, (camera.width_px - 1) / 2], [0, focal, (camera.height_px - 1) / 2], [0, 0, 1.0]])
        return Camera(camera.width_px, camera.height_px, k)
    return camera


def estimate_rows(
    dataset: Dataset, intrinsics: list[str], noise_px: float = 0.0, method: str = "ml", chosen: bool = False
) -> list[dict[str, Any]]:
    """Estimates in the format of a solver: the true ellipses, moved by `noise_px`, in closed form."""
    rng = np.random.default_rng(11)
    index = {f: i for i, f in enumerate(dataset.images.frame_ids)}
    rows: list[dict[str, Any]] = []
    detection: dict[int, int] = {}
    for row in dataset.truth.to_pylist():
        if row["radius_m"] is None:
            continue
        frame = row["frame_id"]
        number = detection[frame] = detection.get(frame, -1) + 1
        shape = np.array([row[f"ellipse_{n}"] for n in ("x_px", "y_px", "a_px", "b_px", "angle_deg")])
        moved = shape + noise_px * np.array([*rng.normal(size=4), 0.0])
        moved[2:4] = np.sort(moved[2:4])[::-1]
        camera = dataset.images.camera(index[frame])
        for label in intrinsics:
            used = used_camera(camera, label)
            poses = poses_from_conic(conic_of_ellipse(moved), used.K, row["radius_m"])
            for candidate in (0, 1):
                rows.append(
                    {
                        "frame_id": frame,
                        "detection_id": number,
                        "method": method,
                        "intrinsics": label,
                        "candidate": candidate,
                        "chosen": chosen and candidate == 0,
                        "probability": 0.5,
                        **{f"normal_{a}": float(v) for a, v in zip("xyz", poses.normal[candidate], strict=True)},
                        **{f"centre_{a}_m": float(v) for a, v in zip("xyz", poses.centre_m[candidate], strict=True)},
                        **{
                            f"ellipse_{n}": float(v)
                            for n, v in zip(("x_px", "y_px", "a_px", "b_px", "angle_deg"), moved, strict=True)
                        },
                        "fx_px": float(used.K[0, 0]),
                        "fy_px": float(used.K[1, 1]),
                        "skew_px": 0.0,
                        "cx_px": float(used.K[0, 2]),
                        "cy_px": float(used.K[1, 2]),
                        "distortion": list(used.distortion),
                        "distortion_model": used.distortion_model,
                        "status": "ok",
                        "reason": "",
                    }
                )
    return rows


def failed_row(frame_id: int, intrinsics: str, reason: str = "no circle found", method: str = "ml") -> dict[str, Any]:
    """The single row of a frame without detections."""
    return {
        "frame_id": frame_id,
        "detection_id": -1,
        "method": method,
        "intrinsics": intrinsics,
        "candidate": 0,
        "chosen": False,
        "status": "failed",
        "reason": reason,
    }


# Standard deviations of the centre (m) and of two angles of the normal (rad).
SIGMA = np.array([2e-4, 2e-4, 1e-3, 3e-4, 3e-4])


def stated_rows(dataset: Dataset, factor: float, method: str = "ml") -> list[dict[str, Any]]:
    """Poses drawn around the truth, with the covariance that they were drawn from, times a factor."""
    rng = np.random.default_rng(5)
    truth = {row["frame_id"]: row for row in dataset.truth.to_pylist()}
    rows = []
    for row in estimate_rows(dataset, ["true"], method=method, chosen=True):
        true = truth[row["frame_id"]]
        normal = np.array([true[f"normal_{a}"] for a in "xyz"])
        if row["candidate"] == 1:
            continue
        axes = minimal_rotation([0.0, 0.0, 1.0], normal)[:, :2]
        error = rng.normal(size=5) * SIGMA
        seen = normal + axes @ error[3:]
        seen /= np.linalg.norm(seen)
        own = minimal_rotation([0.0, 0.0, 1.0], seen)[:, :2]
        cov = np.zeros((6, 6))
        cov[:3, :3], cov[3:, 3:] = np.diag(SIGMA[:3] ** 2), own @ np.diag(SIGMA[3:] ** 2) @ own.T
        row |= {f"normal_{a}": float(v) for a, v in zip("xyz", seen, strict=True)}
        row |= {f"centre_{a}_m": true[f"centre_{a}_m"] + float(e) for a, e in zip("xyz", error, strict=False)}
        row |= {f"cov_{i}{j}": float(factor * cov[i, j]) for i in range(6) for j in range(i, 6)}
        rows.append(row)
    return rows


def write_estimates(path: Path, rows: list[dict[str, Any]], drop: tuple[str, ...] = ()) -> Path:
    """Write rows as a Parquet file with the columns that a validator needs, except those in `drop`."""
    number = ["probability", *[f"normal_{a}" for a in "xyz"], *[f"centre_{a}_m" for a in "xyz"]]
    number += [f"ellipse_{n}" for n in ("x_px", "y_px", "a_px", "b_px", "angle_deg")]
    number += [f"{n}_px" for n in ("fx", "fy", "skew", "cx", "cy")]
    if any("cov_00" in row for row in rows):
        number += [f"cov_{i}{j}" for i in range(6) for j in range(i, 6)]
    if any("confidence" in row for row in rows):
        number += ["confidence"]
    schema = pa.schema(
        [
            ("frame_id", pa.int64()),
            ("detection_id", pa.int64()),
            ("method", pa.string()),
            ("intrinsics", pa.string()),
            ("candidate", pa.int8()),
            ("chosen", pa.bool_()),
            *[(n, pa.float64()) for n in number],
            ("distortion", pa.list_(pa.float64())),
            ("distortion_model", pa.string()),
            ("status", pa.string()),
            ("reason", pa.string()),
        ]
    )
    table = pa.Table.from_pylist(rows, schema=schema).drop_columns(list(drop))
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(table, path)
    return path
