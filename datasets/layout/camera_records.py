"""The camera records of a dataset's frames, a shard at a time: memory does not grow with their number."""

from __future__ import annotations

import json
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from roundel.datasets.layout import files
from roundel.datasets.layout.contents import Contents, Part
from roundel.datasets.layout.schema import CamerasRecord, checked
from roundel.scenes.errors import DataError, first_line

Record = dict[str, Any]

# Shards whose records or points are kept: the one that is read, and the one before.
_KEPT = 2


class CameraRecords(Sequence[Record]):
    """What cameras.json says of each frame, in order; a sequence that reads its shards when they are needed."""

    def __init__(self, contents: Contents) -> None:
        self.contents = contents
        self._cameras: OrderedDict[int, list[Record]] = OrderedDict()
        self._points: OrderedDict[int, dict[int, dict[int, NDArray[np.float64]]]] = OrderedDict()

    def __len__(self) -> int:
        return self.contents.frames

    @overload
    def __getitem__(self, index: int) -> Record: ...
    @overload
    def __getitem__(self, index: slice) -> list[Record]: ...
    def __getitem__(self, index: int | slice) -> Record | list[Record]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        number, offset = self.contents.place_of(index + len(self) if index < 0 else index)
        return self.of_part(number)[offset]

    def __iter__(self) -> Iterator[Record]:
        for number in range(len(self.contents.parts)):
            yield from self.of_part(number)

    def of_part(self, number: int) -> list[Record]:
        """The records of a shard, read and checked."""
        if number not in self._cameras:
            self._cameras[number] = _cameras(self.contents, self.contents.parts[number])
            while len(self._cameras) > _KEPT:
                self._cameras.popitem(last=False)
        return self._cameras[number]

    def points_of(self, index: int) -> dict[int, dict[int, NDArray[np.float64]]]:
        """Edge points by frame and marker, of the shard of the frame at a position."""
        number, _ = self.contents.place_of(index)
        if number not in self._points:
            self._points[number] = _points(self.contents, self.contents.parts[number])
            while len(self._points) > _KEPT:
                self._points.popitem(last=False)
        return self._points[number]


def _cameras(contents: Contents, part: Part) -> list[Record]:
    place = contents.folder.place(part.shard.name(files.CAMERAS))
    try:
        record = json.loads(contents.read(part, files.CAMERAS))
    except (ValueError, RecursionError) as error:
        raise DataError(f"{place}: is no JSON ({first_line(error)}); `roundel repair` mends it") from error
    checked(CamerasRecord, record, place)
    frames: list[Record] = record["frames"]
    ids = [frame["frame_id"] for frame in frames]
    if len(frames) != part.frames or any(a >= b for a, b in pairwise(ids)):
        raise DataError(f"{place}: does not have the {part.frames} frames of the manifest, each once and in order")
    return frames


def _points(contents: Contents, part: Part) -> dict[int, dict[int, NDArray[np.float64]]]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    place = contents.folder.place(part.shard.name(files.POINTS))
    data = contents.read(part, files.POINTS)
    try:
        table = pq.ParquetFile(pa.BufferReader(data)).read(use_threads=False)
        frame_id, marker_id, x, y = (table[c].to_numpy() for c in ("frame_id", "marker_id", "x_px", "y_px"))
        xy = np.stack([x, y], axis=-1).astype(np.float64)
        frame_id, marker_id = frame_id.astype(np.int64), marker_id.astype(np.int64)
    except (OSError, ValueError, TypeError, pa.ArrowException, KeyError) as error:
        raise DataError(f"{place}: points are missing or corrupt ({first_line(error)})") from error
    out: dict[int, dict[int, NDArray[np.float64]]] = {}
    # Rows of one marker are contiguous: split where either id changes.
    cuts = np.flatnonzero((np.diff(frame_id) != 0) | (np.diff(marker_id) != 0)) + 1
    for rows in np.split(np.arange(len(x)), cuts) if len(x) else []:
        out.setdefault(int(frame_id[rows[0]]), {})[int(marker_id[rows[0]])] = xy[rows]
    return out
