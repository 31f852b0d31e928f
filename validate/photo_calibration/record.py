"""A calibration from photographs of a board, as its camera file and its page need it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera, camera_to_json
from roundel.scenes.camera.parameter_covariance import parameter_names
from roundel.scenes.camera.quarter_turns import turned_camera

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BoardPhoto:
    """A photograph, and the board in it.

    Attributes
    ----------
    name : str
    size_px : (int, int)
        (0, 0) if it could not be read.
    reason : str
        Why it was not used; empty if it was.
    pixels : (N, 2) array
        Corners of the board, or centres of its dots, in the image; (0, 2) if it was not found.
    points_m : (N, 3) array
        In the board's frame.
    residual_px : (N, 2) array
        Measured minus predicted; (0, 2) if it was not used.
    camera_from_board : (4, 4) array or None
        None if it was not used.
    picture : (h, w, 3) uint8 array or None
        The photograph, small.
    """

    name: str
    size_px: tuple[int, int] = (0, 0)
    reason: str = ""
    pixels: Array = field(default_factory=lambda: np.empty((0, 2)))
    points_m: Array = field(default_factory=lambda: np.empty((0, 3)))
    residual_px: Array = field(default_factory=lambda: np.empty((0, 2)))
    camera_from_board: Array | None = None
    picture: NDArray[np.uint8] | None = None

    @property
    def used(self) -> bool:
        """Whether the camera was calibrated from it."""
        return self.camera_from_board is not None

    @property
    def rms_px(self) -> float:
        """Root mean square distance of its points from the model."""
        return float(np.sqrt(np.mean(np.sum(self.residual_px**2, axis=-1)))) if len(self.residual_px) else np.nan

    @property
    def tilt_deg(self) -> float:
        """Angle between the board's normal and the optical axis."""
        assert self.camera_from_board is not None
        return float(np.degrees(np.arccos(np.clip(abs(self.camera_from_board[2, 2]), 0.0, 1.0))))


@dataclass(frozen=True, eq=False)
class Board:
    """The board that was photographed.

    Attributes
    ----------
    kind : str
        chessboard, charuco or circle_grid.
    title : str
        With its counts and sizes, for the reader.
    points_m : (N, 3) array
        All its corners, or centres of dots.
    half_size_m : (float, float)
        Half the width and height of the print.
    whole : bool
        Whether it is found only where all of it is in the picture.
    """

    kind: str
    title: str
    points_m: Array
    half_size_m: tuple[float, float]
    whole: bool


@dataclass(frozen=True, eq=False)
class Fitted:
    """A calibrated camera.

    Attributes
    ----------
    camera : Camera
    covariance : (c, c) array
        Of `parameter_names(camera)`, widened.
    widened : float
        Factor on the standard deviations, because the photographs contradict each other by more than their noise.
    sigma_px : float
        Noise of a coordinate of a point in the typical photograph, with `widened`.
    about : dict
        Further keys of the camera file.
    notes : tuple of str
        For the reader.
    """

    camera: Camera
    covariance: Array
    widened: float
    sigma_px: float
    about: dict[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def sigmas(self) -> dict[str, float]:
        """Standard deviation of each parameter."""
        return dict(zip(parameter_names(self.camera), np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    @property
    def values(self) -> dict[str, float]:
        """Value of each parameter."""
        k = self.camera.K
        numbers = (k[0, 0], k[1, 1], k[0, 2], k[1, 2], *self.camera.distortion)
        return {name: float(v) for name, v in zip(parameter_names(self.camera), numbers, strict=True)}


@dataclass(frozen=True, eq=False)
class PhotoCalibration:
    """A calibration from photographs, or why there is none.

    Attributes
    ----------
    board : Board
    size_px : (int, int)
        Of the photographs that count.
    photos : list of BoardPhoto
        All that were looked at, in the order given.
    fitted : Fitted or None
    problem : str
        Why no camera follows; empty if one does.
    orientation : int
        EXIF orientation of the photographs that the camera is for, upright.
    """

    board: Board
    size_px: tuple[int, int]
    photos: list[BoardPhoto]
    fitted: Fitted | None
    problem: str = ""
    orientation: int = 1

    @property
    def used(self) -> list[BoardPhoto]:
        """The photographs that the camera was calibrated from."""
        return [photo for photo in self.photos if photo.used]

    @property
    def shown(self) -> list[BoardPhoto]:
        """The photographs of this camera that show the board, whether or not a camera follows."""
        return [photo for photo in self.photos if photo.used or (len(photo.pixels) and photo.size_px == self.size_px)]

    @property
    def rms_px(self) -> float:
        """Root mean square distance of all points from the model."""
        squared = [np.sum(photo.residual_px**2, axis=-1) for photo in self.used]
        return float(np.sqrt(np.mean(np.concatenate(squared)))) if squared else np.nan

    def turned(self, turns: int, orientation: int) -> PhotoCalibration:
        """The same of the images turned clockwise by quarter turns; `orientation` is the one they then stand for."""
        if not turns % 4:
            return replace(self, orientation=orientation)
        fitted = self.fitted
        if fitted is not None:
            camera, covariance = turned_camera(fitted.camera, fitted.covariance, turns)
            assert covariance is not None
            fitted = replace(fitted, camera=camera, covariance=covariance)
        photos, size = self.photos, self.size_px
        for _ in range(turns % 4):
            photos, size = [_turned(photo) for photo in photos], size[::-1]
        return replace(self, fitted=fitted, photos=photos, size_px=size, orientation=orientation)

    def camera_file(self) -> dict[str, Any]:
        """The content of the camera file."""
        assert self.fitted is not None
        fit = self.fitted
        return {
            **camera_to_json(fit.camera),
            "calibration": {
                "board": self.board.kind,
                "print": self.board.title,
                "rms_px": self.rms_px,
                "views": len(self.used),
                "missed_views": len(self.photos) - len(self.used),
                "photographs": [photo.name for photo in self.used],
                "exif_orientation": self.orientation,
                "group": None,
                "dataset_id": None,
                "opencv": cv2.__version__,
                **fit.about,
                "widened": fit.widened,
                "parameters": list(fit.sigmas),
                "sigma": fit.sigmas,
                "covariance": fit.covariance.tolist(),
            },
        }


_QUARTER = np.array([[0.0, -1.0], [1.0, 0.0]])


def _turned(photo: BoardPhoto) -> BoardPhoto:
    width, height = photo.size_px
    pose = photo.camera_from_board
    if pose is not None:
        turn = np.eye(4)
        turn[:2, :2] = _QUARTER
        pose = turn @ pose
    return replace(
        photo,
        size_px=(height, width),
        pixels=photo.pixels @ _QUARTER.T + np.array([height - 1.0, 0.0]),
        residual_px=photo.residual_px @ _QUARTER.T,
        camera_from_board=pose,
        picture=None if photo.picture is None else np.rot90(photo.picture, -1),
    )
