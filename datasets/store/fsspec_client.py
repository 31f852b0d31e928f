"""Any other file system that fsspec knows, with the calls that `Bucket` makes of obstore's client.

A file is written under a temporary name and renamed: on file systems that rename, it appears completely or not at all.
They have no conditional puts; whoever begins a dataset at the same moment with another study is found by its checksum.
"""

from __future__ import annotations

import secrets
from dataclasses import dataclass
from typing import Any

from roundel.scenes.errors import UsageError

# Addresses that fsspec knows, and that are no place for a dataset: a folder has a name, the others are views of files.
_NOT = ("file", "local", "data", "reference", "blockcache", "filecache", "simplecache", "tar", "zip", "libarchive")


@dataclass(frozen=True)
class _Got:
    meta: dict[str, int]
    data: bytes

    def bytes(self) -> bytes:
        return self.data


class FsspecClient:
    """A folder of a file system of fsspec.

    Raises
    ------
    UsageError
        If fsspec knows no such address, or a package for it is not installed.
    """

    def __init__(self, address: str) -> None:
        scheme = address.partition("://")[0]
        try:
            import fsspec
            from fsspec.registry import known_implementations
        except ImportError as error:
            raise UsageError(f"{address}: needs the package fsspec: pip install fsspec") from error
        if scheme in _NOT or scheme not in known_implementations:
            raise UsageError(
                f"{address}: no store is known for {scheme}://; give s3, gs, az, https, or what fsspec knows"
            )
        try:
            self._files, root = fsspec.core.url_to_fs(address)
        except ImportError as error:
            raise UsageError(f"{address}: {error}") from error
        self._root = str(root).rstrip("/")

    def _path(self, key: str | None) -> str:
        return f"{self._root}/{key}" if key else self._root

    def get(self, key: str) -> _Got:
        """A file and its size."""
        return _Got(self.head(key), bytes(self._files.cat_file(self._path(key))))

    def head(self, key: str) -> dict[str, int]:
        """The size of a file."""
        self._files.invalidate_cache()
        about = self._files.info(self._path(key))
        if about["type"] != "file":
            raise FileNotFoundError(key)
        return {"size": int(about["size"])}

    def put(self, key: str, data: bytes, use_multipart: bool = False, mode: str = "overwrite") -> None:
        """Write a file; with the mode `create` only where there is none."""
        path = self._path(key)
        parent, _, name = path.rpartition("/")
        if mode == "create" and self._files.exists(path):
            raise FileExistsError(key)
        self._files.makedirs(parent, exist_ok=True)
        temporary = f"{parent}/.{name}.{secrets.token_hex(8)}.part"
        self._files.pipe_file(temporary, data)
        self._files.mv(temporary, path)

    def delete(self, key: str) -> None:
        """Remove a file."""
        self._files.rm_file(self._path(key))

    def list_with_delimiter(self, prefix: str | None) -> dict[str, list[Any]]:
        """Files and folders of a folder; temporary files are left out."""
        self._files.invalidate_cache()
        found = self._files.ls(self._path(prefix), detail=True)
        named = [(str(its["name"]).rstrip("/").rpartition("/")[2], its) for its in found]
        named = [(f"{prefix}/{name}" if prefix else name, its) for name, its in named if not name.startswith(".")]
        return {
            "objects": [{"path": path, "size": its["size"]} for path, its in named if its["type"] == "file"],
            "common_prefixes": [path for path, its in named if its["type"] == "directory"],
        }
