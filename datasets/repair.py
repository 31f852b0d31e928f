"""Find the damage of a dataset and take it away, so that rendering again restores it: litter, altered files, records.

What is right stays. A frame is right if its journal line is whole and its files have the recorded checksums; all other
records follow from the study and these lines.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from roundel.datasets.index import image_ids, progress_of
from roundel.datasets.layout import files
from roundel.datasets.layout.contents import read_contents
from roundel.datasets.layout.manifest import read_manifest, read_shard
from roundel.datasets.layout.shards import Shard, shards_of
from roundel.datasets.records import study_bytes
from roundel.datasets.resume import held_study, refuse_imported
from roundel.datasets.store.store import LOG, Listed, Store
from roundel.scenes.errors import DataError, RoundelError, UsageError
from roundel.scenes.study.study import Study, load_study
from roundel.scenes.world.frame import total_frames

Progress = Callable[[int, int], None]


@dataclass
class Damage:
    """What was found and taken away: frames to render, shards whose records are written anew, files left over."""

    frames: list[int] = field(default_factory=list)
    records: list[str] = field(default_factory=list)
    litter: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    developed: bool = False


def study_to_repair(folder: Store, source: str | Path | None) -> Study:
    """The study of a damaged dataset: as given, from its own file, or from its manifest; its file is restored.

    Raises
    ------
    DataError
        If neither can be read.
    UsageError
        If the given study is another one, or the dataset holds imported photographs.
    """
    refuse_imported(folder)
    study = _own_study(folder) if source is None else load_study(source)
    # Frames of another study would be taken for damage, and removed.
    known = _identities(folder)
    if known and study.digest() not in known:
        raise UsageError(
            f"{source or folder}: is not the study of this dataset; give the one that it was rendered from"
        )
    if folder.size(files.STUDY) is None or folder.read(files.STUDY) != study_bytes(study):
        folder.write(files.STUDY, study_bytes(study))
    return study


def _identities(folder: Store) -> list[str]:
    """The dataset_id as the manifest and the study of the dataset have it, as far as they can be read."""
    found = []
    with suppress(RoundelError):
        found.append(read_manifest(folder)[1].dataset_id)
    with suppress(RoundelError):
        found.append(held_study(folder).digest())
    return found


def _own_study(folder: Store) -> Study:
    """The study of a dataset that agrees with its manifest."""
    identity = None
    try:
        manifest, record = read_manifest(folder)
        identity = record.dataset_id
    except DataError:
        manifest = None
    try:
        study = held_study(folder)
        if identity is None or study.digest() == identity:
            return study
    except RoundelError:
        pass
    if manifest is None:
        raise DataError(
            f"{folder}: neither {files.STUDY} nor {files.MANIFEST} can be trusted; give the study with --study"
        )
    # Keys of a manifest are sorted, but the order of the groups counts.
    resolved, known = dict(manifest["study"]), manifest["study"].get("groups")
    if isinstance(known, dict):
        order = [name for name in manifest.get("groups") or () if name in known]
        resolved["groups"] = {name: known[name] for name in (*order, *known)}
    return _from_manifest(folder, resolved, str(identity))


def _from_manifest(folder: Store, resolved: dict[str, object], identity: str) -> Study:
    """The study as the manifest has it."""
    import yaml

    data = yaml.safe_dump(resolved, sort_keys=False, width=120).encode()
    try:
        with folder.on_disk(files.STUDY, data) as path:
            study = load_study(path)
    except RoundelError as error:
        raise DataError(
            f"{folder}: the study in its manifest cannot be read ({error}); give it with --study"
        ) from error
    if study.digest() != identity:
        raise DataError(f"{folder}: the study in its manifest is another one; give the study with --study")
    return study


def take_away_damage(folder: Store, study: Study, progress: Progress | None = None) -> Damage:
    """Remove altered files, records and litter of a dataset at which nobody else works.

    Parameters
    ----------
    folder : Store
    study : Study
    progress : callable, optional
        Called with (frames checked, total frames).

    Raises
    ------
    DataError
        If a file cannot be removed.
    """
    found = Damage()
    try:
        found.developed = read_manifest(folder)[1].developed_from is not None
    except DataError as error:
        found.notes.append(str(error))
        folder.remove(files.MANIFEST)
    total = total_frames(study)
    for shard in shards_of(total):
        _clean_shard(folder, shard, study, found)
        if progress:
            progress(shard.frames.stop, total)
    _remove(folder, folder.leftovers(), found)
    return found


def _clean_shard(folder: Store, shard: Shard, study: Study, found: Damage) -> None:
    here = folder.sub(shard.folder)
    state = progress_of(folder, shard, study)
    found.notes += state.notes
    own = set(image_ids(study, shard))
    for unknown in set(state.entries) - own:
        del state.entries[unknown]
    state.drop_damaged()
    missing = sorted(own - set(state.entries))
    found.frames += missing
    listed = {name for entry in state.entries.values() for name in entry["files"]}
    for sub in files.OF_FRAMES:
        extra = [f"{sub}/{name}" for name in here.names(sub) if f"{sub}/{name}" not in listed]
        _remove(here, extra + [f"{sub}/{name}" for name in here.leftovers(sub)], found)
    if missing or _altered(folder, shard):
        # Written anew once its frames are there.
        folder.remove(*(n for n in (files.MANIFEST, shard.name(files.SHARD)) if folder.size(n) is not None))
        found.records.append(str(here))
    else:
        _remove(here, [f"{LOG}/{name}" for name in here.names(LOG)], found)
        here.logs().remove([])
    _remove(here, here.leftovers(), found)


def _altered(folder: Store, shard: Shard) -> bool:
    """Whether the record of a shard is missing or damaged, or a table is not the one that it lists."""
    try:
        if shard.folder:
            found = read_shard(folder, shard, None)
            if found is None or not found[1].complete:
                return True
            listed = {name: Listed(record.bytes, record.sha256) for name, record in found[1].files.items()}
        else:
            contents = read_contents(folder)
            if not contents.complete:
                return True
            listed = contents.own
        for name, its in listed.items():
            if not files.is_of_a_frame(name):
                folder.read_checked(shard.name(name), its, "")
    except DataError:
        return True
    return False


def _remove(folder: Store, names: list[str], found: Damage) -> None:
    for name in names:
        found.litter.append(folder.place(name))
    folder.discard(*names)
