"""A frame at the size of a thumbnail: the same scene with fewer and larger pixels, and few rays.

A larger pixel collects the electrons of all pixels that it replaces, as if they were binned: noise looks as it does in
a full frame that is reduced. Processing in pixels (sharpening, noise reduction) is that of the small image.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.render.backend import start, variant_of
from roundel.render.scene.textures import coarse_textures
from roundel.render.sensor.develop import develop
from roundel.scenes.world.frame import Frame

# Longer side of a small frame; its rays are those of a study's smooth pixels, and a few more at the print's edges.
SIDE_PX = 320
_SAMPLES, _BAND_SAMPLES = 8, 32
# Making textures is half the time of a world; these take a quarter of it.
_TEXTURE_PX = 256


def small_frame(frame: Frame, side_px: int = SIDE_PX) -> Frame:
    """The frame with an image of at most `side_px` on its longer side; smaller images are kept.

    Parameters
    ----------
    frame : Frame
    side_px : int
    """
    camera = frame.camera
    factor = min(1.0, side_px / max(camera.width_px, camera.height_px))
    width, height = (max(8, round(factor * n)) for n in (camera.width_px, camera.height_px))
    x, y = width / camera.width_px, height / camera.height_px
    # A pixel's centre has whole coordinates: its corner, half a pixel away, is what scales.
    smaller = np.array([[x, 0.0, (x - 1) / 2], [0.0, y, (y - 1) / 2], [0.0, 0.0, 1.0]])
    motion = replace(
        frame.motion,
        row_s=frame.motion.row_s / y,
        centre_row_px=(frame.motion.centre_row_px + 0.5) * y - 0.5,
    )
    rays = {"samples": _SAMPLES, "band_samples": _BAND_SAMPLES, "target_error": 0.0, "radiance": False, "masks": False}
    settings = frame.settings.model_copy(
        update={
            "render": frame.settings.render.model_copy(update=rays),
            "sensor": frame.settings.sensor.model_copy(update=_binned(frame.settings.sensor, 1 / (x * y))),
            "camera": frame.settings.camera.model_copy(update={"halo_px": frame.settings.camera.halo_px * x}),
        }
    )
    camera = replace(camera, width_px=width, height_px=height, K=smaller @ camera.K)
    return replace(frame, camera=camera, motion=motion, settings=settings)


def _binned(sensor: Any, pixels: float) -> dict[str, float]:
    """Keys of a sensor each of whose pixels is so many: signals add, and so do variances of the noise."""
    sums = ("full_well_e", "dark_current_e_s", "exposure_e", "exposure_ph")
    found = {name: getattr(sensor, name) * pixels for name in sums if getattr(sensor, name) is not None}
    found |= {name: getattr(sensor, name) * pixels**0.5 for name in ("read_noise_e", "dsnu_e")}
    if sensor.gain_dn_per_e is not None:
        found["gain_dn_per_e"] = sensor.gain_dn_per_e / pixels
    return {**found, "prnu": sensor.prnu / pixels**0.5}


def render_small(frame: Frame) -> NDArray[np.uint8]:
    """The developed picture of a small frame, (h, w, 3), 8 bits, with the levels of its file.

    Raises
    ------
    BackendError
        If the renderer cannot start.
    """
    from roundel.render.radiance import render_radiance

    small = small_frame(frame)
    with coarse_textures(_TEXTURE_PX):
        developed = develop(small, render_radiance(start(variant_of(small)), small).mean)
    image, sheet = developed.image, developed.sheet
    if image.dtype != np.uint8:
        image = (image >> (sheet.stored_shift + sheet.bits - 8)).clip(0, 255).astype(np.uint8)
    return np.ascontiguousarray(image if image.ndim == 3 else np.repeat(image[..., None], 3, axis=2))
