"""Integrity of a dataset: presence, size, checksum and readability of every file. Never writes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from roundel.datasets.layout import files, journal
from roundel.datasets.layout.camera_records import CameraRecords
from roundel.datasets.layout.contents import Contents, Part, read_contents
from roundel.datasets.layout.images import read_image
from roundel.datasets.layout.manifest import read_manifest
from roundel.datasets.layout.masks import decode_masks
from roundel.datasets.layout.radiance import decode_radiance
from roundel.datasets.numbers import other_numbers
from roundel.datasets.resume import held_study
from roundel.datasets.store.addresses import Address, store_at
from roundel.datasets.store.store import LOG, Listed, Store
from roundel.datasets.store.writing import sha256
from roundel.scenes.errors import DataError, RoundelError
from roundel.scenes.study.identity import SAMPLING_VERSION
from roundel.scenes.study.study import Study

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Finding:
    """One problem: the file, what is wrong, and what to do."""

    name: str
    what: str

    def __str__(self) -> str:
        return f"{self.name}: {self.what}"


def verify_dataset(path: Address, full: bool = False, progress: Progress | None = None) -> list[Finding]:
    """Compare a dataset with its manifest.

    Parameters
    ----------
    path : path
    full : bool
        Also compute every sha256, decode every image and draw every frame's values again; otherwise sizes only.
    progress : callable, optional
        Called with (frames done, total frames).

    Returns
    -------
    list of Finding
        Empty if there are no problems.

    Raises
    ------
    DataError
        If there is no readable manifest.
    """
    folder = store_at(path)
    contents = read_contents(folder)
    findings: list[Finding] = []
    for name, listed in contents.own.items():
        if contents.parts[0].listed is not None or name == files.STUDY:
            findings += _checked_file(folder, name, listed, full)
    study = _study_to_draw(folder) if full else None
    total, done = sum(part.frames for part in contents.parts), 0
    for part in contents.parts:
        try:
            findings += _checked_part(contents, part, full, study)
        except DataError as error:
            findings.append(Finding(part.shard.name(files.SHARD), _without_place(error, folder)))
        done += part.frames
        if progress:
            progress(done, total)
    return findings


def _study_to_draw(folder: Store) -> Study | None:
    """The study, if this version draws its frames; None otherwise, or if it is damaged, which is found elsewhere."""
    _, manifest = read_manifest(folder)
    try:
        return held_study(folder) if manifest.sampling_version == SAMPLING_VERSION else None
    except RoundelError:
        return None


def _checked_part(contents: Contents, part: Part, full: bool, study: Study | None) -> Iterator[Finding]:
    folder, shard = contents.folder, part.shard
    recorded = contents.files_of(part)
    sizes = _sizes(contents, part) if full else {}
    for name, listed in recorded.items():
        if name != files.STUDY:
            yield from _checked_file(folder, shard.name(name), listed, full, sizes.get(name))
    here = folder.sub(shard.folder)
    if contents.complete:
        for sub in files.OF_FRAMES:
            for extra in here.names(sub):
                if f"{sub}/{extra}" not in recorded:
                    yield Finding(shard.name(f"{sub}/{extra}"), "not in the manifest; `roundel repair` removes it")
        for extra in here.names(LOG):
            yield Finding(shard.name(f"{LOG}/{extra}"), "is left of an interrupted run; `roundel repair` removes it")
    for sub in ("", *files.OF_FRAMES):
        for temporary in here.leftovers(sub):
            yield Finding(shard.name(f"{sub}/{temporary}" if sub else temporary), "is left of a write")
    yield from _checked_journal(contents, part, recorded, study)


def _checked_journal(
    contents: Contents, part: Part, recorded: dict[str, Listed], study: Study | None
) -> Iterator[Finding]:
    name = part.shard.name(files.JOURNAL)
    if files.JOURNAL not in recorded:
        return
    try:
        entries = journal.entries_of(contents.folder.read(name), contents.folder.place(name))[0]
    except DataError as error:
        yield Finding(name, _without_place(error, contents.folder, name))
        return
    listed = {file for entry in entries.values() for file in entry["files"]}
    for file in sorted(n for n in recorded if files.is_of_a_frame(n) and n not in listed):
        yield Finding(part.shard.name(file), "listed in the manifest but not in the journal; `roundel repair` mends it")
    if study is not None:
        for what in other_numbers(study, entries):
            yield Finding(name, what)


def _sizes(contents: Contents, part: Part) -> dict[str, tuple[int, int]]:
    """Width and height of the images by name, as far as the cameras can be read."""
    try:
        number = contents.parts.index(part)
        records: list[dict[str, Any]] = CameraRecords(contents).of_part(number)
    except DataError:
        return {}
    return {str(r["image"]): (r["width_px"], r["height_px"]) for r in records if "image" in r}


def _checked_file(
    folder: Store, name: str, listed: Listed, full: bool, size_px: tuple[int, int] | None = None
) -> Iterator[Finding]:
    size = folder.size(name)
    if size is None:
        parent, _, own = name.rpartition("/")
        what = "is no regular file" if own in folder.names(parent) else "missing"
        yield Finding(name, f"{what}; `roundel repair` restores it")
    elif size != listed.bytes:
        yield Finding(name, f"{size} bytes, but {listed.bytes} are recorded; `roundel repair` restores it")
    elif full:
        try:
            data = folder.read(name)
            if sha256(data) != listed.sha256:
                yield Finding(name, "its sha256 is not the recorded one; `roundel repair` restores it")
            elif name.endswith(".exr"):
                decode = decode_masks if files.MASKS in name.split("/") else decode_radiance
                decode(data, folder.place(name))
            elif name.endswith((".png", ".jpg")) and size_px is not None:
                read_image(data, folder.place(name), size_px)
        except DataError as error:
            yield Finding(name, _without_place(error, folder, name))


def _without_place(error: DataError, folder: Store, name: str = "") -> str:
    place = folder.place(name) if name else str(folder)
    return str(error).removeprefix(f"{place}: ").removeprefix(f"{place}/")
