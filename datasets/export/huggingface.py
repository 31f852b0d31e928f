"""Hugging Face: Parquet with an image feature, and a card (README.md).

Source: https://huggingface.co/docs/datasets and the card's keys at https://huggingface.co/docs/hub/datasets-cards.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import yaml

from roundel.datasets.export.output import Output
from roundel.datasets.export.reading import ReadFrame
from roundel.datasets.export.sample import CONVENTION, read_sample, sample_of
from roundel.datasets.stream.frames import Frame
from roundel.scenes.errors import DataError

_ROWS = 100  # of a row group: readers hold one in memory
_FILE_FRAMES = 2000
_SIZES = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"))

_F, _I, _T = pa.float64(), pa.int64(), pa.string()
_MARKER = pa.struct(
    [
        ("marker_id", _I),
        ("kind", _T),
        ("category", _T),
        ("diameter_m", _F),
        ("camera_from_marker", pa.list_(pa.list_(_F))),
        ("box_px", pa.list_(_F)),
        ("ellipse", pa.list_(_F)),
        ("keypoints_px", pa.list_(pa.list_(_F))),
        ("mask", pa.list_(_I)),
        ("full_mask", pa.list_(_I)),
        *[(name, _F) for name in ("distance_m", "distance_D", "tilt_deg", "azimuth_deg", "visible_fraction")],
        ("hidden_by", _T),
    ]
)
_SCHEMA = pa.schema(
    [
        ("image", pa.struct([("bytes", pa.binary()), ("path", _T)])),
        ("frame_id", _I),
        ("group", _T),
        ("width_px", _I),
        ("height_px", _I),
        ("K", pa.list_(pa.list_(_F))),
        ("distortion_model", _T),
        ("distortion", pa.list_(_F)),
        ("markers", pa.list_(_MARKER)),
    ]
)


def _feature(kind: pa.DataType) -> Any:
    """A type as the library's features have it."""
    if pa.types.is_list(kind):
        return {"feature": _feature(kind.value_type), "_type": "List"}
    if pa.types.is_struct(kind):
        return {kind.field(i).name: _feature(kind.field(i).type) for i in range(kind.num_fields)}
    return {"dtype": {"double": "float64"}.get(str(kind), str(kind)), "_type": "Value"}


def _schema() -> pa.Schema:
    features = {f.name: {"_type": "Image"} if f.name == "image" else _feature(f.type) for f in _SCHEMA}
    return _SCHEMA.with_metadata({"huggingface": json.dumps({"info": {"features": features}})})


class _Files:
    """The Parquet files of a split, whose number their names tell; the last ends with the block."""

    def __init__(self, out: Output, split: str, frames: int) -> None:
        self._out, self._split, self._of = out, split, max(1, -(-frames // _FILE_FRAMES))
        self._rows: list[dict[str, Any]] = []
        self._written, self._frames = 0, 0
        self._stack = ExitStack()
        self._writer: pq.ParquetWriter | None = None

    def __enter__(self) -> _Files:
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: Any) -> None:
        if kind is None:
            self._end()
        else:
            self._stack.__exit__(kind, *error)

    def add(self, row: dict[str, Any]) -> None:
        """Add a frame."""
        if self._writer is None:
            name = f"data/{self._split}-{self._written:05d}-of-{self._of:05d}.parquet"
            file = self._stack.enter_context(self._out.open(name))
            self._writer = self._stack.enter_context(pq.ParquetWriter(file, _schema(), compression="zstd"))
        self._rows.append(row)
        self._frames += 1
        if len(self._rows) == _ROWS:
            self._flush()
        if self._frames % _FILE_FRAMES == 0:
            self._end()

    def _flush(self) -> None:
        if self._rows and self._writer is not None:
            self._writer.write_table(pa.Table.from_pylist(self._rows, schema=_schema()))
            self._rows = []

    def _end(self) -> None:
        if self._writer is not None:
            self._flush()
            self._stack.close()
            self._writer = None
            self._written += 1


def write_huggingface(frames: Iterator[Frame], out: Output, counts: dict[str, int], about: dict[str, Any]) -> None:
    """Write frames as Parquet.

    Parameters
    ----------
    frames : iterator of Frame
    out : Output
    counts : dict
        Number of frames of each split.
    about : dict
        Of the dataset; see `export.about_dataset`.
    """
    with ExitStack() as stack:
        files = {split: stack.enter_context(_Files(out, split, count)) for split, count in counts.items()}
        for frame in frames:
            image = {"bytes": frame.image_bytes, "path": f"{frame.frame_id:06d}{frame.suffix}"}
            files[frame.split].add({"image": image, **sample_of(frame)})
    out.write("README.md", _card(counts, about))


def _card(counts: dict[str, int], about: dict[str, Any]) -> bytes:
    total = sum(counts.values())
    head = {
        "license": about["licence"].lower(),
        "pretty_name": about["name"],
        "size_categories": [next((text for most, text in _SIZES if total < most), "n>1M")],
        "task_categories": ["keypoint-detection", "object-detection"],
        "tags": ["synthetic", "fiducial-marker", "pose-estimation"],
        "configs": [
            {
                "config_name": "default",
                "data_files": [{"split": s, "path": f"data/{s}-*.parquet"} for s, n in counts.items() if n],
            }
        ],
    }
    text = (
        f"---\n{yaml.safe_dump(head, sort_keys=False)}---\n\n{about['card']}\n{CONVENTION} `mask` and `full_mask` are"
    )
    text += " COCO's run lengths (down the columns, beginning with zeros) of what is seen and of the whole marker.\n"
    return text.encode()


def read_huggingface(folder: Path) -> Iterator[ReadFrame]:
    """The frames of an export's Parquet files.

    Raises
    ------
    DataError
        If a file is damaged, or not as the export writes it.
    """
    for path in sorted((folder / "data").glob("*.parquet")):
        split = path.name.partition("-")[0]
        try:
            with pq.ParquetFile(path) as file:
                if not file.schema_arrow.equals(_SCHEMA):
                    raise DataError(f"{path}: has other columns than an export")
                for group in range(file.num_row_groups):
                    for row in file.read_row_group(group, use_threads=False).to_pylist():
                        yield read_sample(row, split, row["image"]["bytes"])
        except (OSError, pa.ArrowException, KeyError, ValueError, TypeError) as error:
            raise DataError(f"{path}: cannot be read: {' '.join(str(error).split())[:160]}") from error
