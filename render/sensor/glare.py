"""Veiling glare and halo: light that the lens scatters over the image, in linear radiance before exposure.

Of the light of a pixel, the fraction `veiling_glare` is spread evenly over the frame and `halo` around it. A black
patch in a white frame then has that fraction of the radiance of white: the veiling glare index of ISO 9358. Light from
outside the frame is not known here and adds nothing.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.render.sensor.demosaic import filters
from roundel.scenes.study.camera_section import CameraSection


def with_glare(radiance: NDArray[Any], camera: CameraSection, mosaic: str) -> NDArray[Any]:
    """Radiance (H, W) as it reaches the sensor; the same array if the lens scatters nothing.

    Each colour of a mosaic is spread over the pixels of its own filter.
    """
    veil, halo = float(camera.veiling_glare), float(camera.halo)
    if veil == 0 and halo == 0:
        return radiance
    scene = np.asarray(radiance, dtype=np.float64)
    light = (1 - veil - halo) * scene
    colour = (
        np.zeros(scene.shape, dtype=np.intp) if mosaic == "none" else filters(mosaic, (scene.shape[0], scene.shape[1]))
    )
    for channel in np.unique(colour):
        own = colour == channel
        light[own] += veil * scene[own].mean()
    if halo > 0:
        light += halo * _spread(scene, camera.halo_px, 1 if mosaic == "none" else 2)
    return light.astype(radiance.dtype)


def _spread(scene: NDArray[np.float64], sigma_px: float, step: int) -> NDArray[np.float64]:
    """Gaussian blur of each phase of the mosaic by itself; mirrored at the border, so that no light is lost."""
    from scipy.ndimage import gaussian_filter

    out = np.empty_like(scene)
    for i in range(step):
        for j in range(step):
            out[i::step, j::step] = gaussian_filter(scene[i::step, j::step], sigma_px / step, mode="reflect")
    return out
