"""Write imported photographs as a dataset: all of it, or nothing."""

from __future__ import annotations

import glob
import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from roundel.datasets.environment import environment_of
from roundel.datasets.finish import json_bytes
from roundel.datasets.ingest.photographs import GROUP, Photograph, camera_entry
from roundel.datasets.ingest.reference_table import reference_table, sigma_record
from roundel.datasets.layout import files
from roundel.datasets.layout.contents import images_digest
from roundel.datasets.layout.schema import ManifestRecord, checked
from roundel.datasets.layout.shards import SHARD_FRAMES
from roundel.datasets.layout.truth_table import csv_bytes, parquet_bytes, truth_table
from roundel.datasets.records import identity_of, study_bytes
from roundel.datasets.store.folder import Folder
from roundel.datasets.store.owner import is_gone, own_name
from roundel.datasets.store.records import document_of
from roundel.datasets.store.writing import make_folder, sha256, sync_folder, write_failure
from roundel.scenes.camera.model import Camera
from roundel.scenes.errors import UsageError
from roundel.scenes.markers.marker import Sheet
from roundel.scenes.study.study import Study
from roundel.scenes.truth.measured import measured_row

NOT_RENDERED = "photographs: nothing was rendered"

# Of the folder in which a dataset grows.
_PART = ".import"


@dataclass(frozen=True, eq=False)
class Import:
    """What is written.

    Attributes
    ----------
    study : Study
        From `sheet.study_of_photographs`.
    sheet : Sheet
    camera : Camera
    camera_file : dict
        The camera as a camera file.
    board : str
        Kind of the board.
    calibrated : bool
        Whether the camera is from the photographs themselves.
    photographs : sequence of Photograph
        A frame each, in this order.
    left_out : dict
        Why other photographs have no frame, by name.
    """

    study: Study
    sheet: Sheet
    camera: Camera
    camera_file: dict[str, Any]
    board: str
    calibrated: bool
    photographs: Sequence[Photograph]
    left_out: dict[str, str]


def check_free(out: Path) -> None:
    """Refuse a folder in which there is something.

    Raises
    ------
    UsageError
    """
    if out.is_symlink() or (out.exists() and not out.is_dir()):
        raise UsageError(f"{out}: is there already, and no folder; name a new folder for the dataset")
    if out.is_dir() and any(out.iterdir()):
        raise UsageError(f"{out}: is not empty; name a new folder for the dataset")


def write_import(out: str | Path, what: Import) -> dict[str, Any]:
    """Write a dataset of imported photographs, and return its manifest.

    The same photographs give the same bytes, with the same versions. The dataset is written under a temporary name in
    the same folder, and renamed when it is whole.

    Raises
    ------
    UsageError
        If `out` is there already, or there are more photographs than a shard holds.
    DataError
        If a photograph changed meanwhile, or a file cannot be written.
    """
    out = Path(out)
    check_free(out)
    if len(what.photographs) > SHARD_FRAMES:
        raise UsageError(f"{len(what.photographs)} photographs are too many: import at most {SHARD_FRAMES:,} at a time")
    target = out.absolute()
    temporary = target.with_name(f".{target.name}.{own_name()}{_PART}")
    try:
        _clear_leftovers(target)
        make_folder(temporary)
        manifest = _write(Folder(temporary), what)
        os.replace(temporary, target)
        sync_folder(target.parent)
    except OSError as error:
        raise write_failure(out, error) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return manifest


def _clear_leftovers(target: Path) -> None:
    """Remove what killed processes left of the same dataset."""
    for old in target.parent.glob(f".{glob.escape(target.name)}.*{_PART}"):
        if is_gone(old.name.removesuffix(_PART).rpartition(".")[2]):
            shutil.rmtree(old, ignore_errors=True)


def _write(folder: Folder, what: Import) -> dict[str, Any]:
    rows, cameras, listed = [], [], dict[str, dict[str, Any]]()

    def write(name: str, data: bytes) -> None:
        folder.write(name, data)
        listed[name] = {"sha256": sha256(data), "bytes": len(data)}

    for frame_id, photo in enumerate(what.photographs):
        entry = camera_entry(frame_id, photo, what.camera, what.sheet)
        write(str(entry["image"]), photo.load())
        cameras.append(entry)
        for part, pose in zip(what.sheet.parts, photo.camera_from_part, strict=True):
            rows.append(measured_row(frame_id, GROUP, what.camera, what.sheet, part, pose))
    table, study = truth_table(rows), study_bytes(what.study)
    write(files.STUDY, study)
    write(files.TRUTH, parquet_bytes(table))
    write(files.TRUTH_CSV, csv_bytes(table))
    write(files.REFERENCE, parquet_bytes(reference_table(what.photographs, what.sheet)))
    write(files.CAMERAS, json_bytes({"schema": 1, "frames": cameras}))
    write(files.CAMERA, json_bytes(what.camera_file))
    manifest = _manifest(what, study, listed, len(rows))
    checked(ManifestRecord, manifest, files.MANIFEST)
    folder.write(files.MANIFEST, document_of(manifest))
    return manifest


def _manifest(what: Import, study: bytes, listed: dict[str, dict[str, Any]], markers: int) -> dict[str, Any]:
    count, images = len(what.photographs), images_digest(listed)
    identity = identity_of(what.study, study)
    # Nothing is drawn, and other photographs of the same sheet are another dataset.
    del identity["sampling_version"]
    identity["dataset_id"] = sha256(f"{what.study.digest()} {images}".encode())
    return {
        "schema": 2,
        **identity,
        **environment_of({"variant": None}),
        "counts": {"frames": count, "images": count, "markers": markers, "groups": {GROUP: count}, "flags": {}},
        "complete": True,
        "fidelity": {"circles": 0, "reason": NOT_RENDERED, "unmeasured": {}},
        "files": dict(sorted(listed.items())),
        "images_sha256": images,
        "reference": {
            "kind": "board",
            "board": what.board,
            "camera": "photographs" if what.calibrated else "file",
            "sigma": sigma_record(what.photographs, what.sheet),
            "photographs": [photo.name for photo in what.photographs],
            "left_out": what.left_out,
        },
    }
