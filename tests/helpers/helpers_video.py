"""Sequences of drawn discs with their poses, and videos of them."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera
from roundel.scenes.camera.srgb import linear_to_srgb
from roundel.scenes.geometry.conic import Ellipse, conic_of_circle, ellipse_of_conic
from roundel.scenes.geometry.pose import camera_from_marker_of

Array = NDArray[np.float64]

# FFmpeg reads it once, and the writers of these tests come before the first reader, which sets it for users.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

WIDTH, HEIGHT = 320, 240
DIAMETER_M = 0.08
CAMERA = Camera(WIDTH, HEIGHT, np.array([[300.0, 0.0, 159.5], [0.0, 300.0, 119.5], [0.0, 0.0, 1.0]]))


def pose(centre_m: Sequence[float], tilt_deg: float, azimuth_deg: float) -> Array:
    tilt, azimuth = np.radians(tilt_deg), np.radians(azimuth_deg)
    normal = [np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), -np.cos(tilt)]
    return camera_from_marker_of(normal, centre_m)


def image_of(poses: Iterable[Array], seed: int = 0, noise_dn: float = 1.0) -> NDArray[np.uint8]:
    """Discs at poses, the last one in front, linear in light: the edge is a ramp of one pixel along the normal."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)
    image = np.full((HEIGHT, WIDTH), 200.0)
    for one in poses:
        e = Ellipse.from_array(ellipse_of_conic(conic_of_circle(one, DIAMETER_M / 2, CAMERA.K)))
        c, s = np.cos(np.radians(e.angle_deg)), np.sin(np.radians(e.angle_deg))
        u, v = c * (x - e.x_px) + s * (y - e.y_px), c * (y - e.y_px) - s * (x - e.x_px)
        radius = np.hypot(u / e.a_px, v / e.b_px)
        slope = np.hypot(u / e.a_px**2, v / e.b_px**2) / np.maximum(radius, 1e-9)
        inside = np.clip(0.5 - (radius - 1.0) / np.maximum(slope, 1e-9), 0.0, 1.0)
        image += (40.0 - image) * inside
    image += np.random.default_rng(seed).normal(0.0, noise_dn, image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def encoded(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A frame as a camera delivers it: BGR, sRGB."""
    return np.repeat(np.rint(255 * linear_to_srgb(image / 255.0)).astype(np.uint8)[..., None], 3, axis=2)


def write_video(path: Path, frames: Iterable[NDArray[np.uint8]], codec: str = "MJPG") -> Path:
    writer = None
    for frame in frames:
        if writer is None:
            size = frame.shape[1], frame.shape[0]
            writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), 30.0, size)
            assert writer.isOpened()
        writer.write(frame)
    if writer is not None:
        writer.release()
    return path
