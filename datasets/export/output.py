"""The folder of an export: it appears complete or not at all, with the checksum of each file and a manifest."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, cast

from roundel.datasets.layout.files import check_no_dataset
from roundel.datasets.store.records import document_of
from roundel.datasets.store.writing import write_failure
from roundel.scenes.errors import UsageError

MANIFEST, CHECKSUMS = "export.json", "checksums.sha256"


class _Hashed:
    """A file that is written once, with its checksum and size."""

    def __init__(self, file: BinaryIO) -> None:
        self._file, self.digest, self.size = file, hashlib.sha256(), 0

    def write(self, data: bytes) -> int:
        """Write, as a file does."""
        self.digest.update(data)
        self.size += len(data)
        return self._file.write(data)

    def flush(self) -> None:
        """Does nothing: libraries call it."""

    def tell(self) -> int:
        """Bytes written."""
        return self.size

    @property
    def closed(self) -> bool:
        """Whether the file is closed."""
        return self._file.closed


class Output:
    """A new folder that is filled under another name, and gets its own when the block ends without an error.

    Files are written once, in a fixed order, so that the same export has the same bytes.

    Parameters
    ----------
    folder : Path
        Must not exist, or be empty.

    Raises
    ------
    UsageError
        If there is something already, or it is a dataset.
    DataError
        If a file cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        check_no_dataset(folder)
        if folder.is_dir() and any(folder.iterdir()):
            what = "is an export" if (folder / MANIFEST).exists() else "are files"
            raise UsageError(f"{folder}: there {what} already; give a new folder")
        if folder.exists() and not folder.is_dir():
            raise UsageError(f"{folder}: is a file; give a new folder")
        self.folder = folder
        self._here = folder.with_name(f".{folder.name}.partial")

    def __enter__(self) -> Output:
        # What an interrupted export left: it is made anew.
        shutil.rmtree(self._here, ignore_errors=True)
        try:
            self._here.mkdir(parents=True)
            self._checksums = (self._here / CHECKSUMS).open("w", encoding="utf-8", newline="\n")
        except OSError as error:
            raise write_failure(self._here, error) from error
        self._listed = hashlib.sha256()
        self.files = 0
        self._large: dict[str, tuple[str, int]] = {}
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._checksums.close()
        if kind is not None:
            shutil.rmtree(self._here, ignore_errors=True)

    @contextmanager
    def open(self, name: str) -> Iterator[BinaryIO]:
        """A file to write in steps."""
        path = self._here / name
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("xb") as file:
                hashed = _Hashed(file)
                yield cast(BinaryIO, hashed)
            line = f"{hashed.digest.hexdigest()}  {name}\n"
            self._checksums.write(line)
            self._listed.update(line.encode())
            self.files += 1
            # Of shards and tables; not of each image.
            if name.endswith((".tar", ".parquet")):
                self._large[name] = hashed.digest.hexdigest(), hashed.size
        except OSError as error:
            raise write_failure(self.folder / name, error) from error

    def write(self, name: str, data: bytes) -> None:
        """A file with these bytes."""
        with self.open(name) as file:
            file.write(data)

    def listed(self, name: str) -> tuple[str, int]:
        """Checksum and size of a tar or Parquet file that was written."""
        return self._large[name]

    def finish(self, record: dict[str, Any]) -> None:
        """Write the manifest, and give the folder its name."""
        self._checksums.close()
        listed = {"files": self.files, "checksums_sha256": self._listed.hexdigest()}
        try:
            (self._here / MANIFEST).write_bytes(document_of({**record, **listed}))
            if self.folder.is_dir():
                self.folder.rmdir()
            os.replace(self._here, self.folder)
        except OSError as error:
            raise write_failure(self.folder, error) from error


def json_bytes(value: Any) -> bytes:
    """A value as JSON on one line, with its keys in their order."""
    return json.dumps(value, allow_nan=False, separators=(", ", ": ")).encode()
