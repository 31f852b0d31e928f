"""Images and cameras of a dataset: everything that a solver may open."""

from __future__ import annotations

import io
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.datasets.layout import files
from roundel.datasets.layout.camera_records import CameraRecords
from roundel.datasets.layout.contents import Contents, Part, read_contents
from roundel.datasets.store.addresses import Address, store_at
from roundel.scenes.camera.model import Camera, camera_from_json
from roundel.scenes.camera.response_curve import ResponseCurve, gamma_curve
from roundel.scenes.camera.row_time import RowTime, row_time_from_json
from roundel.scenes.errors import DataError, first_line


@dataclass(frozen=True)
class Images:
    """The frames of a dataset as a solver sees them; `i` counts positions, `frame_ids[i]` is the frame's id."""

    records: Sequence[dict[str, Any]]
    contents: Contents

    def __len__(self) -> int:
        return len(self.records)

    @property
    def frame_ids(self) -> list[int]:
        """Ids of the frames, in order."""
        return list(self._ids_and_groups[0])

    @property
    def groups(self) -> list[str]:
        """Group of each frame."""
        return list(self._ids_and_groups[1])

    @cached_property
    def _ids_and_groups(self) -> tuple[list[int], list[str]]:
        ids: list[int] = []
        groups: list[str] = []
        for record in self.records:
            ids.append(int(record["frame_id"]))
            groups.append(sys.intern(str(record["group"])))
        return ids, groups

    @property
    def group_names(self) -> list[str]:
        """Names of the groups, sorted."""
        return sorted(self.contents.groups or set(self.groups))

    @property
    def address(self) -> str:
        """Where the dataset is: a folder, or a URL."""
        return str(self.contents.folder)

    @property
    def dataset_id(self) -> str:
        """Identity of the dataset: a hash."""
        return self.contents.dataset_id

    @property
    def images_sha256(self) -> str:
        """One checksum over those of all images, or of the points."""
        return self.contents.images_sha256

    @property
    def complete(self) -> bool:
        """Whether all frames of the study are there."""
        return self.contents.complete

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

    def image_bytes(self, i: int) -> bytes:
        """The bytes of the image file, held against the checksum of the manifest.

        Raises
        ------
        DataError
            If the file is missing, is no regular file, or was altered.
        """
        return self.contents.read(self._part(i), str(self.records[i]["image"]))

    def _part(self, i: int) -> Part:
        return self.contents.parts[self.contents.place_of(i)[0]]

    def is_jpeg(self, i: int) -> bool:
        """Whether the image file is a JPEG."""
        return str(self.records[i].get("image", "")).endswith(".jpg")

    def image_place(self, i: int) -> str:
        """Address of the image file, for messages."""
        return self.contents.folder.place(self._part(i).shard.name(str(self.records[i]["image"])))

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
            If the file is missing, was altered, or differs in size from its camera.
        """
        height, width = self.records[i]["height_px"], self.records[i]["width_px"]
        image = read_image(self.image_bytes(i), self.image_place(i), (width, height))
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
        assert isinstance(self.records, CameraRecords), "only a dataset on disk has points"
        frame_id = int(self.records[i]["frame_id"])
        found = self.records.points_of(i)
        if frame_id not in found:
            raise DataError(
                f"{self.contents.folder.place(files.POINTS)}: no points for frame {frame_id}; render the dataset again"
            )
        return found[frame_id]

    def __iter__(self) -> Iterator[tuple[int, NDArray[Any]]]:
        """Pairs (frame_id, image) of the frames that have images."""
        for i, frame_id in enumerate(self.frame_ids):
            if self.mode(i) == "images":
                yield frame_id, self.image(i)


def read_image(data: bytes, place: str, size_px: tuple[int, int]) -> NDArray[Any]:
    """An image file as an array: (H, W) or (H, W, C), uint8 or uint16.

    Parameters
    ----------
    data : bytes
    place : str
        The file's address, for messages.
    size_px : tuple of int
        Width and height that it must have; compared before a pixel is decoded.

    Raises
    ------
    DataError
        If it cannot be read completely, or has another size.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(io.BytesIO(data)) as image:
            if image.size != size_px:
                raise DataError(
                    f"{place}: {image.width}x{image.height} px, but its camera has {size_px[0]}x{size_px[1]}"
                )
            image.load()
            return np.asarray(image if image.mode in ("L", "I;16", "RGB", "RGBA") else image.convert("L"))
    except (UnidentifiedImageError, OSError, SyntaxError, ValueError, EOFError, Image.DecompressionBombError) as error:
        reason = first_line(error)
        raise DataError(f"{place}: this image is truncated or corrupt ({reason}); render the dataset again") from error


def open_images(path: Address) -> Images:
    """Open the images and cameras of a dataset.

    Parameters
    ----------
    path : path or str
        The dataset's folder, or its address in an object store, such as s3://bucket/name.

    Raises
    ------
    DataError
        If the folder is not a dataset, or is not finished.
    """
    folder = store_at(path)
    absence = folder.absence()
    if absence:
        raise DataError(f"{folder}: not a dataset: {absence}")
    if folder.size(files.MANIFEST) is None:
        unfinished = folder.size(files.JOURNAL) is not None or folder.size(files.STUDY) is not None
        hint = (
            "it is not finished: run the same `roundel render` or `develop` again"
            if unfinished
            else f"it has no {files.MANIFEST}"
        )
        raise DataError(f"{folder}: not a readable dataset: {hint}")
    contents = read_contents(folder)
    return Images(CameraRecords(contents), contents)
