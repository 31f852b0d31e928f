"""A place of an object store: S3, Google, Azure, a web server that is only read, or what fsspec knows.

A store has no rename: an object appears when all of it has arrived, and later never changes by itself. A request that
fails is repeated, within limits; what was read is held against the length that the store says it has.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from datetime import timedelta
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import urlsplit

from roundel.datasets.store.fsspec_client import FsspecClient
from roundel.datasets.store.log_objects import LogObjects
from roundel.datasets.store.object_failures import failure, is_final, is_taken
from roundel.datasets.store.store import MOST_BYTES, Listed, LogFiles, MissingFile, Store
from roundel.scenes.errors import DataError, UsageError

T = TypeVar("T")

# The client repeats a request that the store refuses for the moment; a result that is not whole is asked for again.
_RETRIES = {"max_retries": 4, "retry_timeout": timedelta(seconds=60)}
_LIMITS = {"connect_timeout": "10s", "read_timeout": "60s", "timeout": "600s"}
_TRIES = 4
_PAUSE_S = 0.2

_SCHEMES = ("s3", "s3a", "gs", "az", "azure", "abfs", "abfss", "http", "https")


@dataclass(frozen=True)
class Bucket(Store):
    """A folder in an object store: `root` is the address that was given, `within` the path below it."""

    root: str
    within: str = ""

    decays = False
    poll_s = 1.0

    @staticmethod
    def at(address: str) -> Bucket:
        """The place of an address.

        Raises
        ------
        UsageError
            If nothing is known of such addresses, or the package for them is not installed.
        """
        parts = urlsplit(address)
        # Elsewhere a name is no credential: sftp://me@host, abfss://container@account.
        named = parts.username and parts.scheme in ("s3", "s3a", "gs", "http", "https")
        if named or parts.password or parts.query or parts.fragment:
            raise UsageError(f"{parts.scheme}://{parts.hostname}: leave credentials, ? and # out of the address")
        bucket = Bucket(address.rstrip("/"))
        client_of(bucket.root)
        return bucket

    def __str__(self) -> str:
        return f"{self.root}/{self.within}" if self.within else self.root

    def address(self) -> str:
        """The address for other processes."""
        return str(self)

    def sub(self, name: str) -> Bucket:
        """A folder within this one; the empty name is this one."""
        return Bucket(self.root, self._key(name)) if name else self

    def _key(self, name: str) -> str:
        checked = self.checked_name(name)
        return f"{self.within}/{checked}" if self.within else checked

    def _ask(self, name: str, request: Callable[[Any], T]) -> T:
        """The answer to a request, which may be repeated."""
        place = self.place(name) if name else str(self)
        for left in range(_TRIES - 1, -1, -1):
            try:
                return request(client_of(self.root))
            except FileNotFoundError as error:
                raise MissingFile(f"{place}: is missing") from error
            except Exception as error:  # obstore has many, with a class of their own in each version
                if not left or is_final(error):
                    raise failure(place, error) from error
            time.sleep(_PAUSE_S * 2.0 ** (_TRIES - 1 - left))
        raise AssertionError("the last try returns or raises")

    def absence(self) -> str:
        """What is there instead of a folder, in words; empty if it is there."""
        if not self._lists():
            return ""
        listed = self._listed("")
        return "" if listed["objects"] or listed["common_prefixes"] else "there is nothing at this address"

    def is_occupied(self) -> bool:
        """Whether anything is there."""
        return self._lists() and self.absence() == ""

    def _check_writable(self) -> None:
        if not self._lists():
            raise UsageError(f"{self}: a web server can only be read; name a folder, or an address of an object store")

    def _lists(self) -> bool:
        """Whether the store can tell what it has: a web server cannot."""
        return type(client_of(self.root)).__name__ != "HTTPStore"

    def size(self, name: str) -> int | None:
        """Bytes of an object; None if there is none."""
        key = self._key(name)
        try:
            return int(self._ask(name, lambda client: client.head(key))["size"])
        except MissingFile:
            return None

    def _listed(self, folder: str) -> Any:
        prefix = self._key(folder) if folder else self.within
        try:
            return self._ask(folder, lambda client: client.list_with_delimiter(prefix or None))
        except MissingFile:
            return {"objects": [], "common_prefixes": []}

    def sizes(self, folder: str = "") -> dict[str, int]:
        """Bytes of the objects of a folder, by name within it; empty where the store cannot list."""
        if not self._lists():
            return {}
        return {o["path"].rpartition("/")[2]: int(o["size"]) for o in self._listed(folder)["objects"]}

    def names(self, folder: str = "") -> list[str]:
        """Names of everything in a folder, sorted; empty where the store cannot list."""
        if not self._lists():
            return []
        listed = self._listed(folder)
        paths = [*(o["path"] for o in listed["objects"]), *listed["common_prefixes"]]
        return sorted(path.rstrip("/").rpartition("/")[2] for path in paths)

    def read(self, name: str, most: int = MOST_BYTES) -> bytes:
        """The bytes of an object.

        Raises
        ------
        MissingFile
            If there is none.
        DataError
            If it is larger than `most`, or cannot be read.
        """
        key, place = self._key(name), self.place(name)

        def whole(client: Any) -> bytes:
            found = client.get(key)
            size = int(found.meta["size"])
            if size > most:
                raise DataError(f"{place}: {size} bytes are more than this file may have ({most}); damaged")
            data = bytes(found.bytes())
            if len(data) != size:
                raise OSError(f"only {len(data)} of {size} bytes came")
            return data

        return self._ask(name, whole)

    def read_checked(self, name: str, listed: Listed, remedy: str) -> bytes:
        """The bytes of an object that a record lists; those that are not right are asked for once more.

        Raises
        ------
        DataError
            If they are not those that were recorded; `remedy` is what to do.
        """
        try:
            return super().read_checked(name, listed, remedy)
        except MissingFile:
            raise
        except DataError:
            return super().read_checked(name, listed, remedy)

    def write(self, name: str, data: bytes) -> None:
        """Write an object; it is there completely or not at all.

        Raises
        ------
        DataError
            If it cannot be written.
        """
        self._check_writable()
        key = self._key(name)
        # In one request: parts that were sent and never joined would be kept, and paid for, unseen.
        self._ask(name, lambda client: client.put(key, data, use_multipart=False))

    def write_new(self, name: str, data: bytes) -> bool:
        """Likewise, unless somebody else has written another one: False.

        Raises
        ------
        DataError
            If it cannot be written.
        """
        self._check_writable()
        key = self._key(name)
        try:
            self._ask(name, lambda client: client.put(key, data, use_multipart=False, mode="create"))
        except DataError as error:
            if not is_taken(error.__cause__):
                raise
            # The store may have done what was asked before its answer was lost.
            return self.read(name) == data
        return True

    def remove(self, *names: str) -> None:
        """Remove objects; those that are not there are left out.

        Raises
        ------
        DataError
            If one cannot be removed.
        """
        self._check_writable()
        for name in names:
            with suppress(MissingFile):
                self._ask(name, partial(_delete, self._key(name)))

    def discard(self, *names: str) -> None:
        """Remove objects that the listing gave, whatever their names."""
        for name in names:
            with suppress(MissingFile):
                self._ask("", partial(_delete, f"{self.within}/{name}" if self.within else name))

    def take(self, name: str, source: Store, theirs: str) -> None:
        """Copy a file of another store.

        Raises
        ------
        DataError
            If it cannot be read or written.
        """
        self.write(name, source.read(theirs))

    def leftovers(self, folder: str = "") -> list[str]:
        """None: what has not arrived completely is not there."""
        return []

    def clear_leftovers(self, *folders: str) -> None:
        """Nothing to clear."""

    def alone(self) -> nullcontext[None]:
        """A block that several may be in: whoever writes tables and records of the same frames writes the same."""
        return nullcontext()

    def logs(self) -> LogFiles:
        """The logs in this folder."""
        return LogObjects(self)

    @contextmanager
    def on_disk(self, name: str, data: bytes) -> Iterator[Path]:
        """A temporary file with these bytes."""
        with tempfile.TemporaryDirectory(prefix="roundel-") as folder:
            path = Path(folder, Path(name).name)
            path.write_bytes(data)
            yield path


def _delete(key: str, client: Any) -> None:
    client.delete(key)


@lru_cache(maxsize=16)
def client_of(root: str) -> Any:
    """The client of an address: obstore's, with the limits and credentials of this process."""
    if urlsplit(root).scheme not in _SCHEMES:
        return FsspecClient(root)
    try:
        import obstore.store
    except ImportError as error:
        raise UsageError(f"{root}: needs the package obstore: pip install 'roundel[cloud]'") from error
    # Without encryption only where the user has said so, in the address or in that of the endpoint.
    plain = any(
        url.startswith("http://")
        for url in (root, os.environ.get("AWS_ENDPOINT_URL", ""), os.environ.get("AWS_ENDPOINT_URL_S3", ""))
    )
    limits = {**_LIMITS, "allow_http": plain}
    from_url: Any = obstore.store.from_url  # its types know the options of each store apart
    try:
        return from_url(root, client_options=limits, retry_config=_RETRIES)
    except Exception as error:  # obstore has many, with a class of their own in each version
        raise failure(root, error) from error
