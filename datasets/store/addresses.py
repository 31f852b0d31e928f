"""Addresses of datasets: a folder, or a URL such as s3://bucket/name."""

from __future__ import annotations

from pathlib import Path

from roundel.datasets.store.folder import Folder
from roundel.datasets.store.store import Store

Address = str | Path


def is_url(address: Address) -> bool:
    """Whether an address is that of an object store or server."""
    return isinstance(address, str) and "://" in address


def store_at(address: Address) -> Store:
    """What is at an address; nothing is read yet.

    Raises
    ------
    UsageError
        If nothing is known of such addresses, or the package for them is not installed.
    """
    if is_url(address):
        from roundel.datasets.store.bucket import Bucket

        return Bucket.at(str(address))
    return Folder(Path(address))
