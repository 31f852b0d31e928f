"""The stream that every export is written from: frames with their image, camera, poses, masks, boxes and keypoints.

Image coordinates are Roundel's: the centre of the first pixel is (0, 0). `CORNER_PX` takes them to formats that count
from its corner.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.datasets.dataset import Dataset
from roundel.datasets.layout.masks import masks_of
from roundel.datasets.layout.radiance import Planes
from roundel.datasets.stream.masks import Outline, covered_window, outline_of
from roundel.scenes.camera.model import Camera, project
from roundel.scenes.errors import NotComparableError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# What is added to Roundel's image coordinates for a format that counts from the corner of the first pixel.
CORNER_PX = 0.5

# A pixel belongs to a mask if at least this fraction of its area does.
THRESHOLD = 0.5

# Kinds of prints that look the same however they are turned.
_SYMMETRIC = ("disc", "ring", "rings", "ring_code")

# The keypoints of a circle: its centre, and its rim on the axes of the marker.
KEYPOINTS = ("centre", "rim +X", "rim +Y", "rim -X", "rim -Y")
_ON_AXES = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])


@dataclass(frozen=True)
class Marker:
    """A circular marker of a frame.

    Attributes
    ----------
    marker_id : int
    kind : str
        Of the print: `disc`, `ring` and so on.
    category : str
        Kind and diameter: `disc 80 mm`.
    is_symmetric : bool
        Whether a turn about its normal changes nothing.
    diameter_m : float
        Outer diameter.
    camera_from_marker : (4, 4) array
        Metres.
    camera : Camera
    truth : dict
        The row of truth.parquet.
    coverage : (H, W) array or None
        Fraction of each pixel in which the marker is seen; None if the dataset keeps none.
    """

    marker_id: int
    kind: str
    category: str
    is_symmetric: bool
    diameter_m: float
    camera_from_marker: Array
    camera: Camera
    truth: dict[str, Any]
    coverage: NDArray[np.float32] | None = field(repr=False)

    @cached_property
    def outline_px(self) -> Outline:
        """(n, 2) the outline without occluders and without the image's border, distorted; only finite points."""
        return outline_of(self.truth, self.camera_from_marker, self.diameter_m, self.camera)

    @cached_property
    def _areas(self) -> tuple[int, int, Array]:
        return covered_window(self.outline_px, self.camera.width_px, self.camera.height_px)

    @property
    def full_window(self) -> tuple[int, int, Mask]:
        """First column, first row and mask of the pixels of which the sharp outline covers half or more.

        Whatever hides the marker; beyond the image, too, as far as its own size on each side, as in BOP's toolkit.
        """
        x0, y0, area = self._areas
        return x0, y0, area >= THRESHOLD

    @cached_property
    def area(self) -> Array:
        """(H, W) fraction of each pixel that the sharp outline at the pose of record covers, whatever hides it."""
        x0, y0, area = self._areas
        out = np.zeros((self.camera.height_px, self.camera.width_px))
        rows, columns = (
            slice(max(first, 0), max(min(first + size, limit), 0))
            for first, size, limit in zip((y0, x0), area.shape, out.shape, strict=True)
        )
        out[rows, columns] = area[rows.start - y0 : rows.stop - y0, columns.start - x0 : columns.stop - x0]
        return out

    @property
    def full_mask(self) -> Mask:
        """(H, W) pixels of which the marker covers half or more, whatever hides it."""
        return self.area >= THRESHOLD

    @cached_property
    def visible_mask(self) -> Mask:
        """(H, W) pixels of the full mask in which half of the marker's own area, or more, is seen.

        Raises
        ------
        NotComparableError
            If something hides it, and the dataset keeps no coverage.
        """
        if self.coverage is not None:
            # Of its own area: an edge pixel is not hidden because the samples of its coverage are few.
            return self.full_mask & (self.coverage >= THRESHOLD * self.area)
        if set(filter(None, (self.truth.get("hidden_by") or "").split(", "))) <= {"image border"}:
            return self.full_mask
        raise NotComparableError(
            f"frame {self.truth['frame_id']}: {self.truth['hidden_by']} hides a part of marker {self.marker_id}, and "
            "the dataset keeps no coverage; render it with `render: {radiance: true}` or `render: {masks: true}`"
        )

    @property
    def box_px(self) -> tuple[float, float, float, float] | None:
        """Left, top, right, bottom of the outline within the image; None if it lies outside.

        The image reaches from -0.5 to `width_px` - 0.5.
        """
        if not len(self.outline_px):
            return None
        end = np.array([self.camera.width_px, self.camera.height_px]) - 0.5
        low, high = (np.clip(f(self.outline_px, axis=0), -0.5, end) for f in (np.min, np.max))
        if np.any(high <= low):
            return None
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])

    @cached_property
    def keypoints_px(self) -> Array:
        """(5, 2) image of `KEYPOINTS`, distorted; NaN where the lens does not reach."""
        on_marker = np.column_stack([_ON_AXES * self.diameter_m / 2, np.zeros(len(_ON_AXES))])
        pose = self.camera_from_marker
        return project(self.camera, on_marker @ pose[:3, :3].T + pose[:3, 3])

    @cached_property
    def keypoints_in_image(self) -> Mask:
        """(5,) which of them lie in the image."""
        end = np.array([self.camera.width_px, self.camera.height_px]) - 0.5
        inside = (self.keypoints_px >= -0.5) & (self.keypoints_px < end)
        return np.asarray(inside.all(axis=1))

    @cached_property
    def keypoints_visible(self) -> Mask:
        """(5,) which of them are seen: the rim by `contour_visible` of the truth, the centre by the visible mask."""
        seen = np.zeros(len(KEYPOINTS), dtype=bool)
        contour = self.truth.get("contour_visible")
        if contour:
            # The contour begins on the marker's +X and turns toward +Y.
            seen[1:] = np.array(contour, dtype=bool)[:: len(contour) // 4][:4]
        x, y = self.keypoints_px[0]
        if self.keypoints_in_image[0]:
            seen[0] = self.visible_mask[int(np.floor(y + 0.5)), int(np.floor(x + 0.5))]
        return np.asarray(seen & self.keypoints_in_image)


@dataclass(frozen=True)
class Frame:
    """A frame of an export.

    Attributes
    ----------
    frame_id : int
    group, split : str
    camera : Camera
    record : dict
        What cameras.json says of it.
    markers : list of Marker
        In the order of their ids.
    """

    frame_id: int
    group: str
    split: str
    camera: Camera
    record: dict[str, Any]
    markers: list[Marker]
    _dataset: Dataset = field(repr=False)
    _index: int = field(repr=False)
    _planes: Planes | None = field(repr=False)

    @property
    def suffix(self) -> str:
        """Of the image file: `.png` or `.jpg`."""
        return PurePosixPath(self.record["image"]).suffix

    @property
    def image_bytes(self) -> bytes:
        """The image file, as it is in the dataset."""
        return self._dataset.images.image_bytes(self._index)

    @property
    def image(self) -> NDArray[Any]:
        """(H, W) or (H, W, 3) levels."""
        return self._dataset.images.image(self._index)

    @property
    def depth_m(self) -> NDArray[np.float32] | None:
        """(H, W) depth along the optical axis, 0 where there is none; None if the dataset keeps none."""
        return None if self._planes is None else self._planes.get("Z")


def frame_source(
    dataset: Dataset, split_of: Callable[[int], str], masks: bool = False, depth: bool = True
) -> Callable[[int], Frame]:
    """A function that gives the frame at a position, with its circular markers; boards and tags are left out.

    Memory holds the truth of one shard: positions are best asked for in their order.

    Parameters
    ----------
    dataset : Dataset
    split_of : callable
        Gives the split of a frame by its position.
    masks, depth : bool
        Whether coverage and depth are read, where the dataset has them.
    """

    @lru_cache(maxsize=1)
    def truth_of(number: int) -> dict[int, list[dict[str, Any]]]:
        rows: dict[int, list[dict[str, Any]]] = {}
        for row in dataset.of_part(number).truth.to_pylist():
            rows.setdefault(row["frame_id"], []).append(row)
        return rows

    def frame(index: int) -> Frame:
        number = dataset.contents.place_of(index)[0]
        record, camera = dataset.images.records[index], dataset.images.camera(index)
        frame_id = int(record["frame_id"])
        planes = masks_of(dataset.contents, dataset.contents.parts[number], frame_id) if masks else None
        if planes is not None and not depth:
            planes = {name: plane for name, plane in planes.items() if name != "Z"}
        printed = {int(m["marker_id"]): m for m in record["markers"] if m["diameter_m"] is not None}
        rows = [row for row in truth_of(number).get(frame_id, []) if row["marker_id"] in printed]
        markers = [_marker(row, printed[row["marker_id"]], camera, planes) for row in rows]
        return Frame(frame_id, str(record["group"]), split_of(index), camera, record, markers, dataset, index, planes)

    return frame


def _marker(row: dict[str, Any], printed: dict[str, Any], camera: Camera, planes: Planes | None) -> Marker:
    pose = np.array([row[f"camera_from_marker_{i}{j}"] for i in range(4) for j in range(4)], dtype=np.float64).reshape(
        4, 4
    )
    diameter = printed["diameter_m"]
    coverage = None if planes is None else planes.get(f"coverage.{row['marker_id']}")
    kind, layout = str(printed["kind"]), printed["layout"]
    symmetric = kind in _SYMMETRIC and "tick_width_m" not in layout
    category = f"{kind}{'' if symmetric or kind not in _SYMMETRIC else ' with tick'} {1000 * diameter:.6g} mm"
    return Marker(int(row["marker_id"]), kind, category, symmetric, diameter, pose, camera, row, coverage)
