"""A dataset with its truth, for the validator (solvers use `datasets.layout.images`)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from roundel.datasets.layout import files
from roundel.datasets.layout.images import Images, open_images
from roundel.datasets.layout.manifest import read_manifest
from roundel.datasets.verify import Finding, verify_dataset
from roundel.scenes.camera.model import Camera
from roundel.scenes.errors import DataError


@dataclass(frozen=True)
class Dataset:
    """A finished dataset on disk."""

    path: Path
    images: Images
    truth: pa.Table
    manifest: dict[str, Any]

    def __len__(self) -> int:
        return len(self.images)

    @property
    def study(self) -> dict[str, Any]:
        """The resolved study."""
        return dict(self.manifest["study"])

    @property
    def cameras(self) -> list[Camera]:
        """The camera of each frame."""
        return [self.images.camera(i) for i in range(len(self.images))]

    def verify(self, full: bool = False) -> list[Finding]:
        """Problems with the files; an empty list if there are none. See `datasets.verify`."""
        return verify_dataset(self.path, full=full)


def open_dataset(path: str | Path) -> Dataset:
    """Open a finished dataset.

    Raises
    ------
    DataError
        If the folder is not a dataset, is not finished, or its tables are corrupt.
    """
    path = Path(path)
    images = open_images(path)
    manifest = read_manifest(path)
    file = path / files.TRUTH
    try:
        truth = pq.read_table(file)
    except (OSError, pa.ArrowException) as error:
        raise DataError(f"{file}: the truth is missing or corrupt; run `roundel render` again") from error
    missing = {"frame_id", "marker_id", "camera_from_marker_00"} - set(truth.column_names)
    if missing:
        raise DataError(f"{file}: has no column {', '.join(sorted(missing))}; is this a Roundel dataset?")
    return Dataset(path, images, truth, manifest)
