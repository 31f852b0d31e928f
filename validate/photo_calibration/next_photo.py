"""Which photograph of the board would make a camera most certain: predicted, not guessed.

Every candidate is a pose of the board: a place in the image, a distance, a tilt, and the side that is turned away. Its
corners, with the noise that those of the others show, carry an information about the camera, and added to what is
known it predicts the next covariance. Three parts of the camera are compared in one unit, the displacement in the image
that a standard deviation of theirs causes, in pixels: focal length (at the border of the image), principal point, and
lens distortion (at the corner). The candidate that reduces the largest of them most comes first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera, project, ray_direction
from roundel.scenes.camera.parameter_covariance import parameter_names
from roundel.validate.calibration.board_bundle import corner_information
from roundel.validate.photo_calibration.record import Board, Fitted

Array = NDArray[np.float64]

PARTS = ("focal length", "principal point", "lens distortion")

# Places in the image, in its width and height; the tilts, and how much of the image's width the board spans.
_PLACES = (0.2, 0.5, 0.8)
_TILTS_DEG = (0.0, 25.0, 40.0)
_SPANS = (0.35, 0.55)
_DIRECTIONS = 8
_BORDER_PX = 8.0  # between the board and the border of the image
# A photograph that reduces the largest uncertainty by less is not worth taking.
_LEAST_GAIN = 0.04
_ROWS, _COLUMNS = ("upper", "", "lower"), ("left", "", "right")
_SIDES = ("right side", "lower right corner", "lower side", "lower left corner",
          "left side", "upper left corner", "upper side", "upper right corner")  # fmt: skip


@dataclass(frozen=True, eq=False)
class Candidate:
    """A photograph that could be taken.

    Attributes
    ----------
    place : (int, int)
        Column and row of a grid of three by three.
    distance_m, tilt_deg : float
    away : int
        The side turned away from the camera, index of eight, clockwise from the right.
    camera_from_board : (4, 4) array
    """

    place: tuple[int, int]
    distance_m: float
    tilt_deg: float
    away: int
    camera_from_board: Array

    @property
    def text(self) -> str:
        """What to do, as an order."""
        column, row = _COLUMNS[self.place[0]], _ROWS[self.place[1]]
        where = " ".join(word for word in (row, column) if word)
        if row and column:
            where = f"near the {where} corner of the picture"
        elif where:
            where = f"near the {where} edge of the picture"
        else:
            where = "in the middle of the picture"
        distance = f"at about {self.distance_m:.2g} m"
        if not self.tilt_deg:
            return f"hold the board parallel to the picture, {where}, {distance}"
        return (
            f"tilt the board by {self.tilt_deg:.0f} degrees, its {_SIDES[self.away]} away from you, {where}, {distance}"
        )


@dataclass(frozen=True, eq=False)
class Advice:
    """A photograph to take next: its candidate, and the uncertainty (px) of each of `PARTS` before and after."""

    candidate: Candidate
    before_px: dict[str, float]
    after_px: dict[str, float]

    @property
    def weakest(self) -> str:
        """The part that is least certain before."""
        return max(self.before_px, key=lambda part: self.before_px[part])


def uncertainty_px(camera: Camera, covariance: Array) -> dict[str, float]:
    """Standard deviation of each of `PARTS` as a displacement in the image, px.

    Of the focal length at the border of the image, of the principal point itself, and of the lens at that corner of
    the image where it is largest, for a known focal length and principal point.
    """
    sigma = np.sqrt(np.diag(covariance))
    half = (camera.width_px / 2 / camera.K[0, 0], camera.height_px / 2 / camera.K[1, 1])
    found = [max(sigma[0] * half[0], sigma[1] * half[1]), max(sigma[2], sigma[3])]
    corners = np.array([[x, y] for x in (0, camera.width_px - 1) for y in (0, camera.height_px - 1)], dtype=np.float64)
    rays = ray_direction(camera, corners)
    rays = rays[np.isfinite(rays).all(axis=-1)]
    largest = 0.0
    if len(rays) and len(covariance) > 4:
        still, lens = np.zeros(3), np.array(camera.distortion)
        _, jacobian = cv2.projectPoints(np.ascontiguousarray(rays), still, still, camera.K, lens)
        by_lens = np.asarray(jacobian, dtype=np.float64)[:, 10 : 6 + len(covariance)].reshape(len(rays), 2, -1)
        spread = by_lens @ covariance[4:, 4:] @ np.swapaxes(by_lens, 1, 2)
        largest = float(np.sqrt(np.trace(spread, axis1=1, axis2=2).max()))
    return dict(zip(PARTS, [float(v) for v in (*found, largest)], strict=True))


def candidates(camera: Camera, board: Board) -> list[Candidate]:
    """Poses of a board that a photograph could show, whole in the image."""
    size = np.array([camera.width_px, camera.height_px], dtype=np.float64)
    half_x, half_y = board.half_size_m
    # The longer side of the board lies along that of the image.
    turn = 0.0 if (half_x >= half_y) == (size[0] >= size[1]) else 90.0
    longest = 2 * max(half_x, half_y)
    outline = np.array([[x, y, 0.0] for x in (-half_x, half_x) for y in (-half_y, half_y)])
    found = []
    for span in _SPANS:
        distance = float(camera.K[0, 0]) * longest / (span * size.max())
        for tilt in _TILTS_DEG:
            for away in range(_DIRECTIONS if tilt else 1):
                rotation = _rotation(tilt, 360.0 / _DIRECTIONS * away, turn)
                for row, y in enumerate(_PLACES):
                    for column, x in enumerate(_PLACES):
                        pose = _placed(camera, rotation, outline, np.array([x, y]) * size, distance)
                        if pose is not None:
                            found.append(Candidate((column, row), distance, tilt, away, pose))
    return found


def _rotation(tilt_deg: float, away_deg: float, roll_deg: float) -> Array:
    """Of a board that faces the camera, rolled, then tilted so that what lies toward `away_deg` (+x to +y) recedes."""
    away, roll = np.radians([away_deg, roll_deg])
    axis = np.array([np.sin(away), -np.cos(away), 0.0]) * np.radians(tilt_deg)
    facing = np.diag([1.0, -1.0, -1.0])
    return np.asarray(cv2.Rodrigues(axis)[0] @ cv2.Rodrigues(np.array([0.0, 0.0, roll]))[0] @ facing)


def _placed(camera: Camera, rotation: Array, outline: Array, target_px: Array, distance_m: float) -> Array | None:
    """The pose with the board's centre imaged near the target, moved inward until it is whole; None if it cannot be."""
    size = np.array([camera.width_px, camera.height_px], dtype=np.float64)
    target = target_px.copy()
    for _ in range(6):
        ray = ray_direction(camera, target)
        if not np.isfinite(ray).all():
            return None
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation, ray / np.linalg.norm(ray) * distance_m
        px = project(camera, outline @ rotation.T + pose[:3, 3])
        if not np.isfinite(px).all():
            return None
        low, high = _BORDER_PX - px.min(axis=0), px.max(axis=0) - (size - 1 - _BORDER_PX)
        if np.all(low <= 0) and np.all(high <= 0):
            return pose
        if np.any((low > 0) & (high > 0)):
            return None
        target += np.maximum(low, 0.0) - np.maximum(high, 0.0)
    return None


def next_photographs(fitted: Fitted, board: Board, count: int = 3) -> list[Advice]:
    """The photographs that would make the camera most certain, one after another; fewer if more change little."""
    camera, possible = fitted.camera, candidates(fitted.camera, board)
    informations = _informations(possible, camera, board, fitted.sigma_px)
    known, found = np.linalg.inv(fitted.covariance), []
    before = uncertainty_px(camera, fitted.covariance)
    for _ in range(count if len(possible) else 0):
        weakest = max(before, key=lambda part: before[part])
        after = [uncertainty_px(camera, np.asarray(np.linalg.inv(known + one))) for one in informations]
        best = min(range(len(after)), key=lambda i: after[i][weakest])
        if after[best][weakest] > (1 - _LEAST_GAIN) * before[weakest]:
            break
        found.append(Advice(possible[best], before, after[best]))
        known, before = known + informations[best], after[best]
    return found


def _informations(possible: Sequence[Candidate], camera: Camera, board: Board, sigma_px: float) -> list[Array]:
    count = len(parameter_names(camera))
    found = []
    for one in possible:
        information = corner_information(board.points_m, camera, one.camera_from_board, sigma_px)
        found.append(information[:count, :count])
    return found
