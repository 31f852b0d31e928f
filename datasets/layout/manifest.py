"""The manifest of a dataset, read and checked; that of each shard, where there are several."""

from __future__ import annotations

import json
from typing import Any

from roundel.datasets.layout import files
from roundel.datasets.layout.schema import ManifestRecord, OldManifestRecord, ShardRecord, checked
from roundel.datasets.layout.shards import Shard
from roundel.datasets.store.records import KEY, record_of_document
from roundel.datasets.store.store import Listed, MissingFile, Store
from roundel.datasets.store.writing import sha256
from roundel.scenes.errors import DataError, first_line

_REPAIR = "`roundel repair` mends it"


def read_manifest(folder: Store) -> tuple[dict[str, Any], ManifestRecord]:
    """The manifest of a dataset: as a mapping, and checked.

    Raises
    ------
    DataError
        If it is missing, damaged, or not a manifest.
    """
    place = folder.place(files.MANIFEST)
    try:
        data = folder.read(files.MANIFEST)
    except MissingFile as error:
        raise MissingFile(f"{place}: the manifest is missing; finish the dataset with `roundel render`") from error
    try:
        try:
            manifest = record_of_document(data)
        except ValueError:
            # Version 1 has no checksum of its own.
            manifest = json.loads(data)
            if KEY in manifest or manifest["schema"] != 1:
                raise
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise DataError(f"{place}: the manifest is corrupt ({first_line(error)}); {_REPAIR}") from error
    if "dataset_id" not in manifest:
        raise DataError(f"{place}: not the manifest of a Roundel dataset")
    version = manifest.get("schema")
    if version not in (1, 2):
        raise DataError(f"{place}: schema {version!r:.40} is not supported by this version; use a newer Roundel")
    return manifest, checked(OldManifestRecord if version == 1 else ManifestRecord, manifest, place)


def read_shard(folder: Store, shard: Shard, listed: Listed | None) -> tuple[dict[str, Any], ShardRecord, Listed] | None:
    """The record of a shard: as a mapping, checked, and its size and checksum; None if there is none.

    Parameters
    ----------
    folder : Store
        The dataset.
    shard : Shard
    listed : Listed or None
        What the manifest says of it; None if there is no manifest yet.

    Raises
    ------
    DataError
        If it is damaged, or not the one that the manifest lists.
    """
    name = shard.name(files.SHARD)
    try:
        data = folder.read(name) if listed is None else folder.read_checked(name, listed, _REPAIR)
    except MissingFile:
        if listed is not None:
            raise
        return None
    try:
        record = record_of_document(data)
    except ValueError as error:
        raise DataError(f"{folder.place(name)}: the record of a shard is corrupt ({error}); {_REPAIR}") from error
    return record, checked(ShardRecord, record, folder.place(name)), Listed(len(data), sha256(data))
