"""Reference poses of circles, from the boards beside them, with covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera, project, undistort_px
from roundel.scenes.errors import NotComparableError
from roundel.scenes.geometry.conic import circle_points_m
from roundel.scenes.markers.marker import Part
from roundel.scenes.truth.visibility import inside_image
from roundel.solver.pose.plane_pose import plane_points, plane_poses
from roundel.validate.calibration.board_bundle import POSE, BoardCorners, BoardFit, adjusted_camera, adjusted_poses

Array = NDArray[np.float64]

# Photographs from which a camera is calibrated: with fewer its covariance is a guess.
LEAST_PHOTOGRAPHS = 10

# A focal length known worse than this makes the linear covariance a fiction.
_UNDETERMINED = 0.05
# Photographs whose corners lie so much farther from the model than in the median one, and so far, show something else.
_OUTLIER, _OUTLIER_PX = 4.0, 0.5
# The two poses of a plane differ in chi-square by less: the image does not tell which is right.
_AMBIGUOUS = 16.0


@dataclass(frozen=True, eq=False)
class Measured:
    """A camera and the poses of boards.

    Attributes
    ----------
    fit : BoardFit
        Of the boards that are kept.
    kept : list of int
        Their positions.
    left_out : dict
        Why the others were left out, by position.
    """

    fit: BoardFit
    kept: list[int]
    left_out: dict[int, str]


def calibrated(
    boards: Sequence[BoardCorners],
    size_px: tuple[int, int],
    coefficients: int = 4,
    least: int = LEAST_PHOTOGRAPHS,
    instead: str = ", or give --camera FILE",
) -> Measured:
    """The camera and all poses, from the boards themselves.

    Parameters
    ----------
    boards : sequence of BoardCorners
        Of one camera.
    size_px : (int, int)
    coefficients : {4, 5}
        k1, k2, p1, p2, and k3 with five.
    least : int
        Photographs that are asked for.
    instead : str
        What the user can do instead of taking others, for the message.

    Raises
    ------
    NotComparableError
        If there are fewer than `least`, or they do not determine the camera.
    """
    kept, left_out = list(range(len(boards))), dict[int, str]()
    while True:
        if len(kept) < least:
            reasons = "; of others: " + "; ".join(sorted(set(left_out.values()))) if left_out else ""
            raise NotComparableError(
                f"{len(kept)} photographs with the board are too few to calibrate a camera: take "
                f"{LEAST_PHOTOGRAPHS} or more{instead}{reasons}"
            )
        camera = _first_camera([boards[i] for i in kept], size_px, coefficients)
        poses, unclear = _poses(boards, kept, camera)
        if unclear:
            left_out |= unclear
            kept = [i for i in kept if i not in unclear]
            continue
        fit = adjusted_camera([boards[i] for i in kept], camera, poses)
        far = _outliers(fit, kept)
        if not far:
            break
        left_out |= far
        kept = [i for i in kept if i not in far]
    _check_determined(fit, instead)
    return Measured(fit, kept, left_out)


def posed(boards: Sequence[BoardCorners], camera: Camera, covariance: Array) -> Measured:
    """The poses of boards for a given camera.

    Parameters
    ----------
    boards : sequence of BoardCorners
    camera : Camera
    covariance : (c, c) array
        Of its parameters, in the order of `parameter_names`.

    Raises
    ------
    NotComparableError
        If no board is left.
    """
    kept, left_out = list(range(len(boards))), dict[int, str]()
    poses, unclear = _poses(boards, kept, camera)
    left_out |= unclear
    kept = [i for i in kept if i not in unclear]
    if not kept:
        raise NotComparableError("no photograph shows a board from which a pose follows; take others")
    fit = adjusted_poses([boards[i] for i in kept], camera, poses, covariance)
    far = _outliers(fit, kept)
    if far:
        chosen = np.array([i not in far for i in kept])
        left_out |= far
        kept = [i for i in kept if i not in far]
        fit = adjusted_poses([boards[i] for i in kept], camera, fit.poses[chosen], covariance)
    return Measured(fit, kept, left_out)


def _first_camera(boards: Sequence[BoardCorners], size_px: tuple[int, int], coefficients: int) -> Camera:
    points = [board.points_m.astype(np.float32) for board in boards]
    pixels = [board.pixels.astype(np.float32) for board in boards]
    empty: Any = None
    # With several threads OpenCV 5 sums in the order in which they finish, so the last digits would vary between runs.
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        flags = 0 if coefficients == 5 else cv2.CALIB_FIX_K3
        _, k, lens, _, _ = cv2.calibrateCamera(points, pixels, size_px, empty, empty, flags=flags)
    finally:
        cv2.setNumThreads(threads)
    distortion = tuple(float(v) for v in np.ravel(lens)[:coefficients])
    return Camera(*size_px, np.asarray(k, dtype=np.float64), distortion)


def _poses(boards: Sequence[BoardCorners], which: list[int], camera: Camera) -> tuple[Array, dict[int, str]]:
    """The better pose of each board (n, 4, 4), and why others have none, by position."""
    found, unclear = [], dict[int, str]()
    for i in which:
        flat = undistort_px(camera, boards[i].pixels)
        if not np.isfinite(flat).all():
            unclear[i] = "a corner lies outside the field of the lens model"
            continue
        poses = plane_poses(plane_points(boards[i].points_m, flat, camera))
        if not poses:
            unclear[i] = "no pose of the board explains its corners"
            continue
        freedom = 2 * len(flat) - POSE
        # Chi-squares are for a noise of 1 px: in units of that of the better pose.
        if len(poses) == 2 and poses[1].chi2 - poses[0].chi2 < _AMBIGUOUS * poses[0].chi2 / freedom:
            unclear[i] = "the board is so small that two poses explain it; come nearer, or tilt it"
            continue
        found.append(poses[0].camera_from_marker)
    return np.array(found).reshape(-1, 4, 4), unclear


def _outliers(fit: BoardFit, which: list[int]) -> dict[int, str]:
    limit = max(_OUTLIER * float(np.median(fit.rms_px)), _OUTLIER_PX)
    return {
        i: f"its corners lie {rms:.2f} px (RMS) from those of a flat board; is the sheet bent, or the picture blurred?"
        for i, rms in zip(which, fit.rms_px.tolist(), strict=True)
        if rms > limit
    }


def _check_determined(fit: BoardFit, instead: str) -> None:
    sigma = float(np.sqrt(np.diag(fit.covariance)[:2]).max()) / float(fit.camera.K[0, 0])
    if not sigma < _UNDETERMINED:
        tilt = np.degrees(np.arccos(np.clip(np.abs(fit.poses[:, 2, 2]), 0.0, 1.0))).max()
        known = f"to {100 * sigma:.0f} %" if sigma < 1 else "not at all"
        raise NotComparableError(
            f"the photographs determine the focal length {known}: the board is tilted by {tilt:.0f} degrees at most; "
            f"tilt it by 20 to 45 degrees in several directions{instead}"
        )


def beside(poses: Array, covariance: Array, board: Part, part: Part) -> tuple[Array, Array]:
    """Poses of another part of the sheet, and their covariance.

    Parameters
    ----------
    poses : (V, 4, 4) array
        `camera_from_board`.
    covariance : (V, 6, 6) array
        Rotation about the camera's axes (rad), then the board's origin (m).
    board, part : Part

    Returns
    -------
    poses : (V, 4, 4) array
    covariance : (V, 6, 6) array
        The part's centre (m), then rotation about the camera's axes (rad).
    """
    away = poses[:, :3, :3] @ np.array([part.x_m - board.x_m, part.y_m - board.y_m, 0.0])
    moved = poses.copy()
    moved[:, :3, 3] += away
    # A turn w moves the part's centre by w x away.
    change = np.zeros((len(poses), POSE, POSE))
    change[:, :3, 3:] = change[:, 3:, :3] = np.eye(3)
    change[:, 0, 1], change[:, 0, 2], change[:, 1, 2] = away[:, 2], -away[:, 1], away[:, 0]
    change[:, 1, 0], change[:, 2, 0], change[:, 2, 1] = -away[:, 2], away[:, 1], -away[:, 0]
    return moved, np.asarray(change @ covariance @ np.swapaxes(change, 1, 2))


def whole_in_image(pose: Array, radius_m: float, camera: Camera) -> bool:
    """Whether a circle of a pose (4, 4) is imaged inside the image."""
    return bool(inside_image(camera, project(camera, circle_points_m(pose, radius_m, 64))).all())
