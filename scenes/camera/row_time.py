"""When rows are read, and what is known of the motion meanwhile: what a camera declares about its rolling shutter.

Row v is exposed (v - v0) readout_s / height_px seconds after row v0. The pose of record of a marker is that at
mid-exposure of the row v0 that images the circle's centre. The twist of the camera, in the camera's own frame, is
unknown: its six components are independent, normal, with mean zero.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.errors import DataError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RowTime:
    """The readout of a rolling shutter, and the prior of the twist.

    Attributes
    ----------
    readout_s : float
        Rows of the image times the delay from one row to the next, s; 0 is a global shutter.
    velocity_sigma_m_s : float
        Standard deviation of each component of the camera's velocity relative to the marker, m/s.
    rate_sigma_deg_s : float
        Standard deviation of each component of its rate of rotation, degrees/s.
    along_x : bool
        Whether the sensor's rows are columns of the image: a phone held upright, its photograph turned by EXIF.
    """

    readout_s: float
    velocity_sigma_m_s: float
    rate_sigma_deg_s: float
    along_x: bool = False

    def row_s(self, width_px: int, height_px: int) -> float:
        """Delay from one row to the next, s."""
        return self.readout_s / (width_px if self.along_x else height_px)

    def time_s(self, px: ArrayLike, centre_px: ArrayLike, width_px: int, height_px: int) -> Array:
        """Mid-exposure (...) of image points (..., 2) relative to that of the point `centre_px` (2,), s."""
        axis = 0 if self.along_x else 1
        apart = np.asarray(px, dtype=np.float64)[..., axis] - np.asarray(centre_px, dtype=np.float64)[axis]
        return np.asarray(apart * self.row_s(width_px, height_px), dtype=np.float64)

    @property
    def moves(self) -> bool:
        """Whether the camera may move; it then blurs the image even if all rows are exposed at once."""
        return self.velocity_sigma_m_s > 0 or self.rate_sigma_deg_s > 0

    @property
    def twist_sigma(self) -> Array:
        """(6,) standard deviations of the camera's twist: velocity (m/s), rate of rotation (rad/s)."""
        return np.repeat([self.velocity_sigma_m_s, math.radians(self.rate_sigma_deg_s)], 3)


GLOBAL_SHUTTER = RowTime(0.0, 0.0, 0.0)

# A camera of whose motion nothing is declared, such as one frame of a hand-held video: turned on purpose at some tens
# of degrees a second at most, and carried at less than walking pace.
MOVING_VELOCITY_SIGMA_M_S, MOVING_RATE_SIGMA_DEG_S = 0.2, 12.0


def row_time_to_json(readout_s: float, exposure_s: float, twist_prior: tuple[float, float] | None) -> dict[str, Any]:
    """Keys of `cameras.json` for a shutter; `twist_prior` is velocity (m/s) and rate (degrees/s), if it is declared."""
    record: dict[str, Any] = {"exposure_s": float(exposure_s), "readout_s": float(readout_s)}
    if twist_prior is not None:
        velocity, rate = twist_prior
        record["twist_prior"] = {"rate_sigma_deg_s": float(rate), "velocity_sigma_m_s": float(velocity)}
    return record


def row_time_from_json(record: dict[str, Any]) -> RowTime | None:
    """What a camera record declares about its shutter.

    Parameters
    ----------
    record : dict
        A frame of `cameras.json`, or a camera file: `readout_s`, and optionally `twist_prior`, an object of
        `velocity_sigma_m_s` and `rate_sigma_deg_s`. Without it, a rolling shutter's camera moves, and nothing is known
        of one with a global shutter.

    Returns
    -------
    RowTime or None
        None if there is no `readout_s`: nothing is declared.

    Raises
    ------
    DataError
        If a value is not a number, is negative or not finite.
    """
    if record.get("readout_s") is None:
        return None
    prior = record.get("twist_prior")
    if prior is None and record["readout_s"] == 0:
        return GLOBAL_SHUTTER
    if prior is None:
        prior = {"velocity_sigma_m_s": MOVING_VELOCITY_SIGMA_M_S, "rate_sigma_deg_s": MOVING_RATE_SIGMA_DEG_S}
    try:
        numbers = (record["readout_s"], prior["velocity_sigma_m_s"], prior["rate_sigma_deg_s"])
        readout, velocity, rate = (float(v) for v in numbers)
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(
            "camera record: readout_s is a number of seconds, and twist_prior has velocity_sigma_m_s and "
            f"rate_sigma_deg_s ({type(error).__name__} at {error})"
        ) from error
    if not all(math.isfinite(v) and v >= 0 for v in (readout, velocity, rate)):
        raise DataError("camera record: readout_s and the numbers of twist_prior must be finite and not negative")
    return RowTime(readout, velocity, rate)
