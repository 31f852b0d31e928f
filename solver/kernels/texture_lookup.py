"""Bilinear reflectance of a printed texture at points of the image: 100,000 points for each pose and rotation."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from roundel.solver.kernels.compiled import compiled

Array = NDArray[np.float64]


@compiled
def reflectance_at(texture: Array, homography: Array, places: Array, turn: float) -> Array:
    """Bilinear reflectance of the print at points of the image, with the marker rotated about its normal.

    Parameters
    ----------
    texture : (n, n) array
        See `Pattern`.
    homography : (3, 3) array
        From undistorted pixels to the marker's plane in outer radii. Beyond the texture its border goes on.
    places : (N, 2) array
        Undistorted pixels.
    turn : float
        From X toward Y, radians.

    Returns
    -------
    (N,) array
    """
    c, s = math.cos(turn), math.sin(turn)
    size = texture.shape[0]
    most = size - 1.001
    h = homography
    out = np.empty(len(places))
    for k in range(len(places)):
        u, v = places[k, 0], places[k, 1]
        w = h[2, 0] * u + h[2, 1] * v + h[2, 2]
        if w == 0.0:  # on the vanishing line
            w = 1e-300
        a, b = (h[0, 0] * u + h[0, 1] * v + h[0, 2]) / w, (h[1, 0] * u + h[1, 1] * v + h[1, 2]) / w
        x = min(max((c * a + s * b + 1.0) * (size / 2.0) - 0.5, 0.0), most)
        y = min(max((1.0 + s * a - c * b) * (size / 2.0) - 0.5, 0.0), most)
        i, j = int(x), int(y)
        x -= i
        y -= j
        top = texture[j, i] * (1.0 - x) + texture[j, i + 1] * x
        low = texture[j + 1, i] * (1.0 - x) + texture[j + 1, i + 1] * x
        out[k] = top * (1.0 - y) + low * y
    return out
