"""The sheet as a world sees it: where it is, how large it is, and what of it must be seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.markers.surfaces import Curve

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SheetPlace:
    """The sheet in the camera frame: its pose, the corners of the paper, and points that must be seen.

    `thickness_m` is that of the paper; `seen` (n, 3) are points of the markers' outlines. Of a bent sheet, `corners`
    are points all along its border.
    """

    camera_from_sheet: Array
    corners: Array
    seen: Array
    thickness_m: float
    curve: Curve | None = None

    @property
    def normal(self) -> Array:
        """Out of the printed face."""
        return self.camera_from_sheet[:3, 2]

    @property
    def centre(self) -> Array:
        """The middle of the paper."""
        return np.asarray(self.corners.mean(axis=0))

    @property
    def size_m(self) -> float:
        """The longest extent of the paper from its middle."""
        return float(np.linalg.norm(self.corners - self.centre, axis=1).max())
