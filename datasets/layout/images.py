"""Images and cameras of a dataset: everything that a solver may open."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.datasets.layout import files
from roundel.scenes.camera.model import Camera, camera_from_json
from roundel.scenes.camera.response_curve import ResponseCurve, gamma_curve
from roundel.scenes.camera.row_time import RowTime, row_time_from_json
from roundel.scenes.errors import DataError, first_line


@dataclass(frozen=True)
class Images:
    """The frames of a dataset as a solver sees them; `i` counts positions, `frame_ids[i]` is the frame's id."""

    path: Path
    records: list[dict[str, Any]]
    _points: dict[int, dict[int, NDArray[np.float64]]] = field(default_factory=dict, repr=False)

    def __len__(self) -> int:
        return len(self.records)

    @property
    def frame_ids(self) -> list[int]:
        """Ids of the frames, in order."""
        return [int(r["frame_id"]) for r in self.records]

    @property
    def groups(self) -> list[str]:
        """Group of each frame."""
        return [str(r["group"]) for r in self.records]

    @property
    def dataset_id(self) -> str | None:
        """Identity of the dataset: a hash, the only thing read from its manifest."""
        try:
            return str(json.loads((self.path / files.MANIFEST).read_text(encoding="utf-8"))["dataset_id"])
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def saturation_dn(self, i: int) -> float | None:
        """Image-file level at which pixels saturate; None if no sensor is recorded."""
        sensor = self.records[i].get("sensor")
        return None if sensor is None else float(sensor["saturation_dn"])

    def mode(self, i: int) -> str:
        """`images` or `points`."""
        return str(self.records[i]["mode"])

    def camera(self, i: int) -> Camera:
        """The frame's camera, as read by `--intrinsics true` and `scaled`."""
        return camera_from_json(self.records[i])

    def row_time(self, i: int) -> RowTime | None:
        """What the frame's camera declares about its shutter; None if nothing."""
        return row_time_from_json(self.records[i])

    def markers(self, i: int) -> list[dict[str, Any]]:
        """The printed markers: marker_id, kind, diameter_m, layout. No pose."""
        return list(self.records[i]["markers"])

    def image_path(self, i: int) -> Path:
        """The image file."""
        return self.path / str(self.records[i]["image"])

    def curve(self, i: int) -> ResponseCurve | None:
        """Response curve of the delivered image; None if no sensor is recorded."""
        sensor = self.records[i].get("sensor")
        if sensor is None:
            return None
        basis = "the dataset's record of its sensor"
        if sensor["curve"] == "gamma":
            return gamma_curve(float(sensor["gamma"]), basis)
        return ResponseCurve(str(sensor["curve"]), basis=basis)

    def top_dn(self, i: int) -> float | None:
        """Image-file level that the response curve maps to 1; None if no sensor is recorded."""
        sensor = self.records[i].get("sensor")
        return None if sensor is None else float((2 ** sensor["bits"] - 1) << sensor["stored_shift"])

    def image(self, i: int) -> NDArray[Any]:
        """Image (H, W) or (H, W, 3), uint8 or uint16.

        Raises
        ------
        DataError
            If the file is missing, truncated, or differs in size from its camera.
        """
        path = self.image_path(i)
        image = read_image(path)
        expected = (self.records[i]["height_px"], self.records[i]["width_px"])
        if image.shape[:2] != expected:
            raise DataError(
                f"{path}: {image.shape[1]}x{image.shape[0]} px, but its camera has {expected[1]}x{expected[0]}"
            )
        return image

    def linear_image(self, i: int, delivered: NDArray[Any] | None = None) -> tuple[NDArray[Any], float | None]:
        """The linearised image, in the file's range, and the level at which its pixels saturate.

        An edge is a step of light. After a tone curve its middle is not the mean of its sides, and a circle found there
        is some tenths of a pixel too large or too small. The level is None if no sensor is recorded. `delivered` is
        the result of `image(i)`, if it was already read.
        """
        image = self.image(i) if delivered is None else delivered
        curve, top, saturation = self.curve(i), self.top_dn(i), self.saturation_dn(i)
        if curve is None or top is None or saturation is None:
            return image, None
        if curve.identity:
            return image, saturation
        linear = curve.light(np.arange(np.iinfo(image.dtype).max + 1) / top)
        return np.asarray(top * linear)[image], top * float(linear[round(saturation)])

    def points(self, i: int) -> dict[int, NDArray[np.float64]]:
        """Edge points {marker_id: (N, 2)} in image pixels, of a frame in points mode."""
        if not self._points:
            self._points.update(_read_points(self.path / files.POINTS))
        frame_id = int(self.records[i]["frame_id"])
        if frame_id not in self._points:
            raise DataError(f"{self.path / files.POINTS}: no points for frame {frame_id}; render the dataset again")
        return self._points[frame_id]

    def __iter__(self) -> Iterator[tuple[int, NDArray[Any]]]:
        """Pairs (frame_id, image) of the frames that have images."""
        for i, frame_id in enumerate(self.frame_ids):
            if self.mode(i) == "images":
                yield frame_id, self.image(i)


def read_image(path: str | Path) -> NDArray[Any]:
    """An image file as an array: (H, W) or (H, W, C), uint8 or uint16.

    Raises
    ------
    DataError
        If it cannot be read completely.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(path) as image:
            image.load()
            return np.asarray(image if image.mode in ("L", "I;16", "RGB", "RGBA") else image.convert("L"))
    except FileNotFoundError as error:
        raise DataError(f"{path}: this image is missing; render the dataset again") from error
    except (UnidentifiedImageError, OSError, SyntaxError, ValueError, EOFError) as error:
        reason = first_line(error)
        raise DataError(f"{path}: this image is truncated or corrupt ({reason}); render the dataset again") from error


def _read_points(path: Path) -> dict[int, dict[int, NDArray[np.float64]]]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table = pq.read_table(path)
        frame_id, marker_id, x, y = (table[c].to_numpy() for c in ("frame_id", "marker_id", "x_px", "y_px"))
    except (OSError, pa.ArrowException, KeyError) as error:
        raise DataError(f"{path}: points are missing or corrupt ({first_line(error)})") from error
    xy = np.stack([x, y], axis=-1)
    out: dict[int, dict[int, NDArray[np.float64]]] = {}
    # Rows of one marker are contiguous: split where either id changes.
    cuts = np.flatnonzero((np.diff(frame_id) != 0) | (np.diff(marker_id) != 0)) + 1
    for rows in np.split(np.arange(len(x)), cuts) if len(x) else []:
        out.setdefault(int(frame_id[rows[0]]), {})[int(marker_id[rows[0]])] = xy[rows]
    return out


def open_images(path: str | Path) -> Images:
    """Open the images and cameras of a dataset.

    Parameters
    ----------
    path : path
        The dataset's folder.

    Raises
    ------
    DataError
        If the folder is not a dataset, or is not finished.
    """
    path = Path(path)
    if not path.is_dir():
        what = "it is a file; a dataset is a folder" if path.exists() else "there is no such folder"
        raise DataError(f"{path}: not a dataset: {what}")
    if not (path / files.MANIFEST).is_file():
        unfinished = (path / files.JOURNAL).is_file() or (path / files.STUDY).is_file()
        hint = (
            "it is not finished: run the same `roundel render` or `develop` again"
            if unfinished
            else f"it has no {files.MANIFEST}"
        )
        raise DataError(f"{path}: not a readable dataset: {hint}")
    file = path / files.CAMERAS
    try:
        record = json.loads(file.read_text(encoding="utf-8"))
        frames = record["frames"]
        for frame in frames:
            missing = {"frame_id", "group", "mode", "markers", "width_px", "height_px", "K"} - set(frame)
            if missing:
                raise DataError(f"{file}: a frame has no {', '.join(sorted(missing))}; render the dataset again")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DataError(f"{file}: missing or corrupt; render the dataset again") from error
    return Images(path, frames)
