"""Folders of photographs of a printed sheet, as a person would make them, with the frames that they show."""

import io
import struct
from pathlib import Path

import numpy as np
from helpers_reports import sheet_image
from numpy.typing import NDArray
from PIL import Image

from roundel.scenes.camera.model import Camera, project
from roundel.scenes.geometry.pose import camera_from_marker_of, normal_of, transform_points
from roundel.scenes.study.study import Study, load_study
from roundel.scenes.world.frame import Frame, frames_of
from roundel.solver.detect.chessboard_corners import BoardLayout, board_points_m
from roundel.validate.calibration.board_bundle import BoardCorners

Array = NDArray[np.float64]

SHEET = """\
schema: 1
name: sheet
seed: 11
camera: {width_px: 640, height_px: 480, focal_px: 560, principal_point_x_px: 323, principal_point_y_px: 236,
         distortion: [-0.08, 0.05, 0.0006, -0.0004]}
marker: {kind: disc_with_chessboard, diameter_m: 0.06, gap_m: 0.015, chessboard: {columns: 5, rows: 4, square_m: 0.02}}
pose:
  distance_m: {uniform: [0.30, 0.42]}
  tilt_deg: {uniform: [8, 40]}
  azimuth_deg: {uniform: [-180, 180]}
  roll_deg: {uniform: [-15, 15]}
  offset_x_px: {uniform: [-190, -110]}
  offset_y_px: {uniform: [-50, 50]}
frames: 12
"""

CAMERA = Camera(640, 480, np.array([[560.0, 0, 323], [0, 560, 236], [0, 0, 1]]), (-0.08, 0.05, 0.0006, -0.0004))


def sheet_study(folder: Path, *edits: tuple[str, str]) -> Study:
    """SHEET with some of its text replaced, in a file."""
    text = SHEET
    for old, new in edits:
        assert old in text, old
        text = text.replace(old, new, 1)
    path = folder / "sheet.yaml"
    path.write_text(text)
    return load_study(path)


def with_exif(jpeg: bytes, focal_35mm_mm: int, orientation: int = 1) -> bytes:
    """A JPEG with a phone's tags; its pixels are not encoded again."""
    exif = Image.Exif()
    exif[0x010F], exif[0x0112] = "Maker", orientation
    exif.get_ifd(0x8769)[0xA405] = focal_35mm_mm
    block = exif.tobytes()
    return jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(block) + 2) + block + jpeg[2:]


def jpeg_of(image: NDArray[np.uint8], noise_dn: float = 1.0, seed: int = 0) -> bytes:
    """A picture with noise, as a JPEG."""
    noise = noise_dn * np.random.default_rng(seed).standard_normal(image.shape)
    sink = io.BytesIO()
    Image.fromarray(np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)).save(sink, format="JPEG", quality=95)
    return sink.getvalue()


def make_album(folder: Path, study: Study, focal_35mm_mm: int = 30) -> list[Frame]:
    """Photographs of the frames of a study: IMG_0001.jpg, IMG_0002.jpg..., every third held upright."""
    folder.mkdir()
    frames = list(frames_of(study))
    for i, frame in enumerate(frames):
        jpeg = jpeg_of(sheet_image(frame, 4), seed=i)
        (folder / f"IMG_{i + 1:04d}.jpg").write_bytes(with_exif(jpeg, focal_35mm_mm, 6 if i % 3 == 2 else 1))
    return frames


def noisy_boards(
    rng: np.random.Generator, count: int, sigma_px: tuple[float, float]
) -> tuple[list[BoardCorners], Array]:
    """Corners of boards seen by CAMERA, with noise of a size drawn for each view; and the true poses (V, 4, 4)."""
    points, boards, poses = board_points_m(BoardLayout(6, 5, 0.02)), [], []
    for _ in range(count):
        normal = normal_of(rng.uniform(8, 42), rng.uniform(-180, 180))
        z = rng.uniform(0.3, 0.5)
        pose = camera_from_marker_of(normal, [z * rng.uniform(-0.3, 0.3), z * rng.uniform(-0.2, 0.2), z])
        px = project(CAMERA, transform_points(pose, points))
        boards.append(BoardCorners(points, px + rng.uniform(*sigma_px) * rng.standard_normal(px.shape)))
        poses.append(pose)
    return boards, np.array(poses)


def pose_error(estimate: Array, truth: Array) -> Array:
    """Centre (m) and rotation about the camera's axes (rad) of an estimate minus the truth, (6,)."""
    import cv2

    turn = cv2.Rodrigues(estimate[:3, :3] @ truth[:3, :3].T)[0].ravel()
    return np.concatenate([estimate[:3, 3] - truth[:3, 3], turn])


def chi_square(error: Array, covariance: Array) -> float:
    """Squared Mahalanobis distance."""
    return float(error @ np.linalg.solve(covariance, error))
