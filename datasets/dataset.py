"""A dataset with its truth, for the validator (solvers use `datasets.layout.images`)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from roundel.datasets.layout import files
from roundel.datasets.layout.camera_records import CameraRecords
from roundel.datasets.layout.contents import Contents, Part, joined_digest
from roundel.datasets.layout.images import Images, open_images
from roundel.datasets.layout.manifest import read_manifest
from roundel.datasets.layout.truth_table import TRUTH_SCHEMA
from roundel.datasets.store.addresses import Address
from roundel.datasets.store.folder import Folder
from roundel.datasets.verify import Finding, verify_dataset
from roundel.scenes.camera.model import Camera
from roundel.scenes.errors import DataError, first_line


@dataclass(frozen=True)
class Dataset:
    """A dataset.

    `manifest` is that of the whole; `truth_of` reads the truth of a shard, `truth` that of all.
    """

    images: Images
    manifest: dict[str, Any]
    kept_truth: pa.Table | None = None
    kept_truth_sha256: str | None = None

    def __len__(self) -> int:
        return len(self.images)

    @property
    def address(self) -> str:
        """Where it is: a folder, or a URL."""
        return self.images.address

    @property
    def path(self) -> Path:
        """Its folder, if it is on a disk of this machine.

        Raises
        ------
        DataError
            If it is elsewhere.
        """
        folder = self.contents.folder
        if not isinstance(folder, Folder):
            raise DataError(f"{folder}: is not on a disk; `roundel pull` copies it there")
        return folder.path

    @property
    def contents(self) -> Contents:
        """Its shards, and the checksums of their files."""
        return self.images.contents

    def of_part(self, number: int) -> Dataset:
        """One of its shards, as a dataset of these frames alone."""
        if len(self.contents.parts) == 1:
            return self
        contents = replace(self.contents, parts=(self.contents.parts[number],))
        return Dataset(Images(CameraRecords(contents), contents), self.manifest)

    @cached_property
    def truth(self) -> pa.Table:
        """The truth of all frames, sorted by (frame_id, marker_id)."""
        if self.kept_truth is not None:
            return self.kept_truth
        return pa.concat_tables(self.truths())

    def truths(self) -> Iterator[pa.Table]:
        """The truth, a shard at a time."""
        for part in self.contents.parts:
            yield self.truth_of(part)

    def truth_of(self, part: Part) -> pa.Table:
        """The truth of a shard, checked.

        Raises
        ------
        DataError
            If it is missing, was altered, or is not the truth of its frames.
        """
        place = self.contents.folder.place(part.shard.name(files.TRUTH))
        data = self.contents.read(part, files.TRUTH)
        return checked_truth(data, place)

    @property
    def truth_sha256(self) -> str:
        """One checksum over the truth of all frames."""
        if self.kept_truth_sha256 is not None:
            return self.kept_truth_sha256
        parts = self.contents.parts
        return joined_digest([(p.shard.folder, self.contents.files_of(p)[files.TRUTH].sha256) for p in parts])

    @property
    def study(self) -> dict[str, Any]:
        """The resolved study."""
        return dict(self.manifest["study"])

    @property
    def reference(self) -> dict[str, Any] | None:
        """Where the poses of imported photographs come from; None if the frames were rendered, and poses are truth."""
        found: dict[str, Any] | None = self.manifest.get("reference")
        return found

    @property
    def cameras(self) -> list[Camera]:
        """The camera of each frame."""
        return [self.images.camera(i) for i in range(len(self.images))]

    def verify(self, full: bool = False) -> list[Finding]:
        """Problems with the files; an empty list if there are none. See `datasets.verify`."""
        return verify_dataset(self.address, full=full)


def checked_truth(data: bytes, place: str) -> pa.Table:
    """A file of truth as a table; columns that an older version does not have are left out.

    Raises
    ------
    DataError
        If it is no Parquet, lacks its key, or a column has another type.
    """
    try:
        # Its threads may outlive a short command and abort it.
        truth = pq.ParquetFile(pa.BufferReader(data)).read(use_threads=False)
        truth.validate(full=True)
    except (OSError, ValueError, pa.ArrowException) as error:
        raise DataError(f"{place}: the truth is corrupt ({first_line(error)}); `roundel repair` mends it") from error
    missing = {"frame_id", "marker_id", "camera_from_marker_00"} - set(truth.column_names)
    if missing:
        raise DataError(f"{place}: has no column {', '.join(sorted(missing))}; is this a Roundel dataset?")
    for column in truth.schema:
        known = TRUTH_SCHEMA.field(column.name).type if column.name in TRUTH_SCHEMA.names else column.type
        if column.type != known:
            raise DataError(f"{place}: column {column.name} is {column.type}, not {known}; it is damaged")
    return truth


def open_dataset(path: Address) -> Dataset:
    """Open a dataset: its folder, or its address in an object store, such as s3://bucket/name.

    Raises
    ------
    DataError
        If the folder is not a dataset, is not finished, or its records are corrupt.
    """
    images = open_images(path)
    manifest, _ = read_manifest(images.contents.folder)
    dataset = Dataset(images, manifest)
    if len(images.contents.parts) == 1:
        _ = dataset.truth  # of a small one, say what is wrong now
    return dataset


def read_truth(path: Address) -> pa.Table:
    """The truth of a dataset as one table: a row for each marker in each frame, sorted by (frame_id, marker_id).

    The columns are those of `truth.parquet`; `to_pandas` makes a data frame where pandas is installed.

    Raises
    ------
    DataError
        As `open_dataset`.
    """
    return open_dataset(path).truth
