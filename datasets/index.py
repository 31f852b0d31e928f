"""The index of a dataset: tables, records and manifest over the frames that there are, all of them or some."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import AbstractContextManager, nullcontext
from typing import Any

from roundel.datasets.environment import UNKNOWN, Environment, check_one_environment, key_of
from roundel.datasets.finish import Frames, finish_shard
from roundel.datasets.layout import files
from roundel.datasets.layout.contents import read_contents
from roundel.datasets.layout.developed import Developed
from roundel.datasets.layout.manifest import read_shard
from roundel.datasets.layout.shards import Shard, shards_of
from roundel.datasets.progress import ShardProgress
from roundel.datasets.records import slim, write_manifest
from roundel.datasets.resume import held_study, recorded_environments
from roundel.datasets.store.addresses import Address, store_at
from roundel.datasets.store.store import Store
from roundel.scenes.errors import DataError
from roundel.scenes.study.study import Study
from roundel.scenes.world.frame import group_ranges, total_frames

Records = list[tuple[Shard, dict[str, Any]]]


def finishing(folder: Store) -> AbstractContextManager[None]:
    """A block in which one process at a time writes tables and records of a shard, or the manifest; the others wait."""
    return folder.alone()


def progress_of(folder: Store, shard: Shard, study: Study) -> ShardProgress:
    """The state of a shard of a study's dataset."""
    return ShardProgress(folder, shard, study.digest(), recorded_environments(folder, shard))


def image_ids(study: Study, shard: Shard) -> list[int]:
    """Frames of a shard that have images, in order."""
    return [
        i
        for name, ids in group_ranges(study).items()
        if study.groups[name].mode == "images"
        for i in range(max(ids.start, shard.frames.start), min(ids.stop, shard.frames.stop))
    ]


def finished_record(folder: Store, shard: Shard, dataset_id: str) -> dict[str, Any] | None:
    """The record of a shard that is complete, `slim`; None if it is not, or its record is damaged."""
    if not shard.folder:
        return None
    try:
        found = read_shard(folder, shard, None)
    except DataError:
        return None
    if found is None or not found[1].complete or found[1].dataset_id != dataset_id:
        return None
    return slim(found[0], found[2])


def finish_frames(
    study: Study,
    folder: Store,
    state: ShardProgress,
    own: Environment,
    mix: bool,
    developed: Developed | None = None,
) -> dict[str, Any]:
    """Write tables and record of a shard over the frames that are done.

    Raises
    ------
    DataError
        If its frames are of several environments, and nobody said that they may be.
    """
    keys = [(i, entry.get("environment")) for i, entry in state.entries.items()]
    if not (mix or state.mixed) and len({key for _, key in keys}) > 1:
        check_one_environment(str(folder), keys, own, state.environments)
    # Those of frames whose record was lost are known by their key alone.
    unknown = {str(key): UNKNOWN for _, key in keys if key is not None}
    known = {**unknown, key_of(own): own, **state.environments}
    return finish_shard(study, folder, state.shard, Frames(state.entries, state.seconds, known), developed)


def finish_dataset(study: Study, folder: Store, records: Records, own: Environment, mix: bool) -> dict[str, Any]:
    """Write the manifest over shards that are finished.

    Raises
    ------
    DataError
        If they are of several environments, and nobody said that they may be.
    """
    keys: list[tuple[int, str | None]] = []
    known: dict[str, Environment] = {}
    for shard, record in records:
        known |= record["environments"]
        keys += [(shard.frames.start, key) for key in record["environments"]]
    alone = all(len(record["environments"]) < 2 for _, record in records)
    if not mix and alone and len({key for _, key in keys}) > 1:
        check_one_environment(str(folder), keys, own, known)
    return write_manifest(study, folder, records, own)


def is_whole(folder: Store, shards: Iterable[Shard]) -> bool:
    """Whether a dataset is finished, and the files of these shards have their recorded sizes."""
    try:
        contents = read_contents(folder)
        if not contents.complete:
            return False
        wanted = {shard.folder for shard in shards}
        for part in contents.parts:
            if part.shard.folder in wanted:
                here = folder.sub(part.shard.folder)
                subs = ("", *files.OF_FRAMES)
                sizes = {f"{sub}/{n}".lstrip("/"): size for sub in subs for n, size in here.sizes(sub).items()}
                if any(sizes.get(name) != listed.bytes for name, listed in contents.files_of(part).items()):
                    return False
    except DataError:
        return False
    return True


def tidy(folder: Store, shards: Iterable[Shard], study: Study) -> None:
    """Remove the logs of finished shards, but for those of living processes, and what killed ones left."""
    folder.clear_leftovers()
    for shard in shards:
        here = folder.sub(shard.folder)
        if here.names("log"):
            progress_of(folder, shard, study).remove_logs()
        here.clear_leftovers("", *files.OF_FRAMES)


def index_frames(path: Address, own: Environment) -> tuple[int, int]:
    """Index an unfinished dataset over the frames that are done, so that it can be read; others may go on rendering.

    Returns
    -------
    done, total : int
        Frames that are indexed, and all of the study.

    Raises
    ------
    DataError
        If no frame is done, or a file cannot be written.
    """
    folder = store_at(path)
    study = held_study(folder)
    with finishing(folder):
        # Until the new manifest is there, nobody reads new tables by the old one.
        folder.remove(files.MANIFEST)
        records: Records = []
        for shard in shards_of(total_frames(study)):
            record = finished_record(folder, shard, study.digest())
            if record is None:
                with finishing(folder.sub(shard.folder)) if shard.folder else nullcontext():
                    state = progress_of(folder, shard, study)
                    if not state.entries and image_ids(study, shard):
                        continue
                    record = finished_record(folder, shard, study.digest())
                    record = record or finish_frames(study, folder, state, own, mix=True)
            records.append((shard, record))
        if not records:
            raise DataError(f"{path}: no frame is done yet; run `roundel render` again")
        manifest = write_manifest(study, folder, records, own)
    return manifest["counts"]["frames"], total_frames(study)
