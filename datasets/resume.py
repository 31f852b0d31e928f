"""Resume a dataset: prepare the folder, find finished frames, record new ones."""

from __future__ import annotations

import json
from pathlib import Path

from roundel.datasets.finish import study_bytes
from roundel.datasets.layout import files, journal
from roundel.scenes.errors import DataError, RoundelError, UsageError
from roundel.scenes.study.study import Study, load_study


def prepare(study: Study, dataset: Path) -> dict[int, journal.Entry]:
    """Prepare the folder; return the journal's entries whose files exist.

    Raises
    ------
    UsageError
        If the folder holds another study's dataset, or something else.
    DataError
        If its study is corrupt.
    """
    if dataset.exists() and not dataset.is_dir():
        raise UsageError(f"{dataset}: is a file; name a folder for the dataset")
    held = dataset / files.STUDY
    if held.is_file():
        try:
            digest = load_study(held).digest()
        except RoundelError as error:
            raise DataError(f"{held}: corrupt ({error}); name another folder, or remove this one") from error
        if digest != study.digest():
            raise UsageError(
                f"{dataset}: holds frames of another study (dataset_id {digest[:12]}, not {study.digest()[:12]}); "
                "name another folder, remove this one, or restore the study"
            )
    elif dataset.is_dir() and any(dataset.iterdir()):
        raise UsageError(f"{dataset}: is not empty and not a dataset; name another folder")
    else:
        files.write_file(held, study_bytes(study))
    for folder in (dataset, dataset / "images", dataset / "radiance"):
        for leftover in folder.glob(".*.part"):
            leftover.unlink()
    return {i: entry for i, entry in journal.read(dataset).items() if journal.is_done(dataset, entry)}


def backend_of(entry: journal.Entry) -> str:
    """Backend that rendered a frame; lines without one are older than the choice."""
    return str(entry.get("backend", "llvm"))


def backend_to_resume(dataset: Path, entries: dict[int, journal.Entry], asked: str) -> str:
    """The backend of finished frames, with which a dataset is continued.

    Raises
    ------
    UsageError
        If another one is asked for: the manifest names one environment for all frames.
    """
    begun = backend_of(next(iter(entries.values())))
    if asked not in (begun, "auto"):
        raise UsageError(
            f"{dataset}: its frames were rendered with --backend {begun}; continue with that, "
            f"or render with --backend {asked} into another folder"
        )
    return begun


def reopen(dataset: Path, entries: dict[int, journal.Entry]) -> None:
    """Remove the manifest and journal lines of missing frames, before new frames change files that they list."""
    (dataset / files.MANIFEST).unlink(missing_ok=True)
    if len(entries) < len(journal.read(dataset)):
        journal.rewrite(dataset, entries)


def record(dataset: Path, entries: dict[int, journal.Entry], entry: journal.Entry, seconds: dict[str, float]) -> None:
    """Record a finished frame whose files are safely on disk: its journal line and its timings."""
    journal.append(dataset, entry)
    entries[entry["frame_id"]] = entry
    line = json.dumps({"frame_id": entry["frame_id"], **{k: round(v, 4) for k, v in seconds.items()}})
    files.append_line(dataset / files.TIMINGS, line)
