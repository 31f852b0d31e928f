"""A camera with its uncertainty: the best guess, its standard deviations, and their basis."""

from __future__ import annotations

from dataclasses import dataclass

from roundel.scenes.camera.model import Camera
from roundel.scenes.camera.row_time import RowTime


@dataclass(frozen=True)
class UncertainCamera:
    """A camera to estimate with, and its uncertainty.

    Attributes
    ----------
    camera : Camera
        The best guess.
    focal_sigma : float
        Standard deviation of the focal length, as a fraction of it; 0 if it is taken as exact.
    principal_sigma_px : float
        Standard deviation of each coordinate of the principal point; 0 if it is taken as exact.
    basis : str
        The basis of the numbers, for the user.
    row_time : RowTime or None
        Readout of a rolling shutter, with the prior of the twist; None for a global shutter.
    """

    camera: Camera
    focal_sigma: float = 0.0
    principal_sigma_px: float = 0.0
    basis: str = "the camera that was given"
    row_time: RowTime | None = None
