"""Depth of a frame: in each pixel that of one surface, the first that the ray through the pixel's centre meets.

A mean over a pixel's rays is no surface's depth along an edge, and their nearest hit lets near things grow by half a
pixel. The ray through the centre mixes nothing, and its geometry is that of the camera of record: Z and the pixel give
the point back.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.render.rays.rays import Optics, central_ray
from roundel.scenes.world.frame import Frame

# From unit rays: the distance to the first surface, metres; 0 where there is none.
Distance = Callable[[Any], Any]

# Rays traced at once: about 50 MB per million.
_CHUNK = 4_000_000


def depth_plane(dr: Any, mi: Any, frame: Frame, optics: Optics, distance: Distance) -> NDArray[np.float32]:
    """Z along the optical axis, at mid-exposure of the pixel's row.

    Returns
    -------
    (H, W) array of float32
        Metres; 0 where nothing is hit, negative where a fisheye sees what is beside and behind it.
    """
    width, count = frame.camera.width_px, frame.camera.width_px * frame.camera.height_px
    across = dr.opaque(mi.UInt32, width)
    planes = []
    for start in range(0, count, _CHUNK):
        pixel = dr.arange(mi.UInt32, min(_CHUNK, count - start)) + dr.opaque(mi.UInt32, start)
        row = pixel // across
        ray, axial = central_ray(dr, mi, optics, pixel - row * across, row)
        planes.append(np.array(distance(ray) * axial, dtype=np.float32))
    return np.concatenate(planes).reshape(frame.camera.height_px, width)
