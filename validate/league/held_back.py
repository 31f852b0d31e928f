"""A held-back part of the league: images anyone may solve, whose truth stays with the organiser.

The frames of a dataset follow from its study and seed, so that the public part has neither, nor the dataset_id, which
is a hash of them. What ties its truth down is a salted checksum, sha256(salt + truth.parquet): it tells nothing before
the truth and the salt are shown, and nobody can exchange the truth afterwards.
"""

from __future__ import annotations

import copy
import hashlib
import json
import secrets
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from roundel.datasets.dataset import Dataset, checked_truth, open_dataset
from roundel.datasets.layout import files
from roundel.datasets.layout.contents import images_digest
from roundel.datasets.layout.images import open_images
from roundel.datasets.layout.manifest import read_manifest
from roundel.datasets.layout.truth_table import parquet_bytes
from roundel.datasets.store.addresses import Address, store_at
from roundel.datasets.store.folder import Folder
from roundel.datasets.store.records import document_of
from roundel.datasets.store.writing import sha256, write_file
from roundel.scenes.errors import DataError, NotComparableError, UsageError
from roundel.validate.league.outcomes import frames_of_league
from roundel.validate.scores.readings import IDENTITIES

SALT, COMMITMENT = "salt.txt", "truth_salted_sha256"
_IDENTITY = "identity.json"
# Keys of a layout that tell the identity, also as what is printed.
_TELLING = (*IDENTITIES, "radii", "code")


@dataclass(frozen=True)
class HeldBack:
    """Folders of both parts: what is published, and what the organiser keeps."""

    public: Path
    kept: Path


def hold_back(dataset_path: Address, public: str | Path, kept: str | Path) -> HeldBack:
    """Split a dataset into images without truth, and the truth with its salt.

    Parameters
    ----------
    dataset_path : path
        A dataset of the study `league`, rendered with a seed that nobody else knows.
    public, kept : path
        Folders to write: images, cameras and the salted checksum; truth, salt and study.

    Raises
    ------
    UsageError
        If one of the folders is there already.
    NotComparableError
        If it has no groups `CONDITION.VARIANT`, with which nothing could be scored, or frames without images.
    DataError
        If the dataset is not finished or corrupt.
    """
    dataset, out = open_dataset(dataset_path), HeldBack(Path(public), Path(kept))
    if not frames_of_league(dataset):
        raise NotComparableError(
            f"{dataset.address}: no group is named CONDITION.VARIANT; give a dataset of the league"
        )
    if any("image" not in record for record in dataset.images.records):
        raise NotComparableError(f"{dataset.address}: has frames of points, without images; nobody could solve them")
    for folder in (out.public, out.kept):
        if folder.exists():
            raise UsageError(f"{folder}: is there already; name a new folder")
    salt = secrets.token_hex(32)
    truth = parquet_bytes(dataset.truth)
    records = copy.deepcopy(list(dataset.images.records))
    identities = [_taken(record["markers"]) for record in records]
    target, listed = Folder(out.public), dict[str, Any]()
    for i, record in enumerate(records):
        name, data = str(record["image"]), dataset.images.image_bytes(i)
        target.write(name, data)
        listed[name] = _listed(data)
    cameras = _json({"schema": 1, "frames": records})
    listed[files.CAMERAS] = _listed(cameras)
    manifest = {
        "schema": 2,
        "tool": "roundel",
        "dataset_id": salted(salt, str(dataset.manifest["dataset_id"]).encode()),
        "study": {"name": f"{dataset.study['name']}, held back", "solve": {}},
        "files": listed,
        "images_sha256": images_digest(listed),
        "counts": {"frames": len(records)},
        COMMITMENT: salted(salt, truth),
    }
    write_file(out.kept / files.TRUTH, truth)
    write_file(out.kept / SALT, f"{salt}\n".encode())
    write_file(out.kept / _IDENTITY, _json(identities))
    write_file(out.kept / files.STUDY, dataset.contents.folder.read(files.STUDY))
    target.write(files.CAMERAS, cameras)
    target.write(files.MANIFEST, document_of(manifest))
    return out


def open_held_back(public: str | Path, kept: str | Path) -> Dataset:
    """The public images with the truth that was kept, which has to be the one that was committed to.

    Raises
    ------
    DataError
        If a file is missing or corrupt.
    NotComparableError
        If the truth is not that of the images.
    """
    public, kept = Path(public), Path(kept)
    images, (manifest, _) = open_images(public), read_manifest(store_at(public))
    if COMMITMENT not in manifest:
        raise NotComparableError(f"{public}: nothing is held back of this dataset; leave out --truth")
    try:
        salt = (kept / SALT).read_text(encoding="utf-8").strip()
        data = (kept / files.TRUTH).read_bytes()
        identities = json.loads((kept / _IDENTITY).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DataError(f"{kept}: the truth that was held back is missing or corrupt") from error
    if salted(salt, data) != manifest[COMMITMENT]:
        raise NotComparableError(f"{kept}: this is not the truth that {public} was published with")
    truth = checked_truth(data, str(kept / files.TRUTH))
    records = list(images.records)
    for record, told in zip(records, identities, strict=True):
        for marker, own in zip(record["markers"], told, strict=True):
            marker["layout"].update(own)
    return Dataset(replace(images, records=records), manifest, truth, sha256(data))


def _listed(data: bytes) -> dict[str, Any]:
    return {"sha256": sha256(data), "bytes": len(data)}


def salted(salt: str, data: bytes) -> str:
    """Hexadecimal sha256 of the salt's bytes followed by the data."""
    return hashlib.sha256(bytes.fromhex(salt) + data).hexdigest()


def _taken(markers: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Take the identities out of the printed markers of a frame, and return them."""
    return [{key: m["layout"].pop(key) for key in _TELLING if key in m["layout"]} for m in markers]


def _json(value: Any) -> bytes:
    return (json.dumps(value, indent=1, sort_keys=True) + "\n").encode()
