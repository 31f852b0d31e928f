"""The rolling shutter of a camera of which nothing is declared: a phone held still by a hand.

Readout: phones read a frame in some 10 to 30 ms (31 and 32 ms for the iPhone 3GS and 4, measured by Ringaby and
Forssen 2012; an action camera of 2013 reads in 15 ms). A twist and a readout enter an image only by their product, so a
readout that is uncertain is equivalent to its RMS: 20.8 ms for one uniform between 10 and 30 ms.

Rotation: the photographer's reciprocal rule says that a hand-held exposure of 1 / F seconds at F mm (35-mm equivalent)
is just sharp: a circle of confusion of 0.03 mm, which is 0.03 mm / F in 1 / F s: 0.03 rad/s, 1.7 degrees a second,
whatever F. The prior is 3 degrees a second about each axis, so that twice the rule is still likely.

Velocity: that rotation about an elbow 0.5 m from the camera moves the camera at 0.03 m/s.
"""

from __future__ import annotations

from dataclasses import replace

from roundel.scenes.camera.row_time import RowTime

HELD_BY_HAND = RowTime(readout_s=0.0208, velocity_sigma_m_s=0.03, rate_sigma_deg_s=3.0)
_HELD_UPRIGHT = replace(HELD_BY_HAND, along_x=True)


def assumed_shutter(declared: RowTime | None, camera_is_assumed: bool, width_px: int, height_px: int) -> RowTime | None:
    """The shutter to estimate with; None for a global one, unless the camera's motion is declared.

    Parameters
    ----------
    declared : RowTime or None
        What the camera's record declares; None if nothing.
    camera_is_assumed : bool
        Whether the camera itself is assumed (a default phone, EXIF): a rolling shutter is then assumed, too, if
        nothing is declared. A camera that was given is taken as exact, with a global shutter.
    width_px, height_px : int
        An image that is higher than wide was turned upright: the rows of the sensor are its columns.
    """
    if declared is not None:
        return declared if declared.moves else None
    if not camera_is_assumed:
        return None
    return _HELD_UPRIGHT if height_px > width_px else HELD_BY_HAND


def is_assumed(row_time: RowTime) -> bool:
    """Whether a shutter is that of an unknown phone."""
    return row_time in (HELD_BY_HAND, _HELD_UPRIGHT)
