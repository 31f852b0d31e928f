"""A camera from the corners of boards in photographs: of a chessboard or a ChArUco board."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from roundel.scenes.camera.model import project
from roundel.scenes.errors import NotComparableError
from roundel.validate.calibration.board_bundle import BoardCorners
from roundel.validate.ingest.reference import calibrated
from roundel.validate.photo_calibration.coverage import ENOUGH_PHOTOGRAPHS
from roundel.validate.photo_calibration.record import Board, BoardPhoto, Fitted, PhotoCalibration

# With fewer even the noise of the corners is a guess.
LEAST_PHOTOGRAPHS = 5


def calibrated_from_corners(
    board: Board, size_px: tuple[int, int], photos: Sequence[BoardPhoto], coefficients: int = 4
) -> PhotoCalibration:
    """Calibrate from the corners that photographs show; those that contradict the others are left out, with the reason.

    Parameters
    ----------
    board : Board
    size_px : (int, int)
        Of the photographs that count; all that have no `reason` are of this size.
    photos : sequence of BoardPhoto
    coefficients : {4, 5}
        k1, k2, p1, p2, and k3 with five.
    """
    out = list(photos)
    which = [i for i, photo in enumerate(photos) if not photo.reason]
    if len(which) < LEAST_PHOTOGRAPHS:
        return PhotoCalibration(board, size_px, out, None, too_few(board, len(which), len(photos)))
    corners = [BoardCorners(photos[i].points_m, photos[i].pixels) for i in which]
    try:
        measured = calibrated(corners, size_px, coefficients, LEAST_PHOTOGRAPHS, "")
    except NotComparableError as error:
        return PhotoCalibration(board, size_px, out, None, str(error))
    for i, reason in measured.left_out.items():
        out[which[i]] = replace(out[which[i]], reason=reason)
    fit = measured.fit
    for i, pose in zip(measured.kept, fit.poses, strict=True):
        photo = photos[which[i]]
        predicted = project(fit.camera, photo.points_m @ pose[:3, :3].T + pose[:3, 3])
        out[which[i]] = replace(photo, residual_px=photo.pixels - predicted, camera_from_board=pose)
    fitted = Fitted(fit.camera, fit.covariance, fit.widened, float(np.median(fit.sigma_px)))
    return PhotoCalibration(board, size_px, out, fitted)


def too_few(board: Board, found: int, looked: int) -> str:
    """Why a number of photographs does not make a camera."""
    if not found:
        return f"the {board.title}, is in none of the {looked} photographs: are its kind and counts right?"
    return (
        f"the board counts in {found} of {looked} photographs, which is too few: take {ENOUGH_PHOTOGRAPHS} or more, "
        "from different places, with the board tilted by 20 to 45 degrees in several directions"
    )
