"""Join datasets that hold parts of the same study, made on machines without a shared disk."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from roundel.datasets.environment import UNKNOWN, Environment, check_one_environment, environment_of
from roundel.datasets.index import image_ids, is_whole, progress_of, tidy
from roundel.datasets.layout import files, journal
from roundel.datasets.layout.developed import Developed, developed_of
from roundel.datasets.layout.manifest import read_manifest
from roundel.datasets.layout.shards import Shard, shards_of
from roundel.datasets.progress import ShardProgress
from roundel.datasets.resume import held_study, prepare
from roundel.datasets.store.addresses import Address, store_at
from roundel.datasets.store.store import Listed, Store
from roundel.datasets.work import Participant, Work, finish_what_is_complete
from roundel.scenes.errors import DataError, NotComparableError
from roundel.scenes.study.study import Study
from roundel.scenes.world.frame import total_frames

Progress = Callable[[int, int], None]


def merge_datasets(
    parts: Sequence[Address], out: Address, mix_environments: bool = False, progress: Progress | None = None
) -> tuple[int, int]:
    """Copy the finished frames of several datasets of a study into one, and finish what is complete.

    Each file is held against its checksum as it is copied. What the target has stays.

    Parameters
    ----------
    parts : sequence of path or str
        Datasets, finished or not; they are not changed.
    out : path or str
        A new or empty folder, or a dataset of the same study.
    mix_environments : bool
        Join frames of several versions or machines, whose last bits may differ.
    progress : callable, optional
        Called with (frames done, total frames).

    Returns
    -------
    missing, total : int
        Frames with images that are still missing, and all of them.

    Raises
    ------
    NotComparableError
        If the parts are of several studies.
    UsageError
        If `out` holds something else.
    DataError
        If a file is damaged or cannot be written, or the environments differ.
    """
    study, folders = _one_study(parts)
    target = prepare(study, out)
    shards = shards_of(total_frames(study))
    total = sum(len(image_ids(study, shard)) for shard in shards)
    missing = done = 0
    if is_whole(target, shards):
        tidy(target, shards, study)
        return 0, total
    own: Environment = environment_of({"variant": None})
    for shard in shards:
        wanted = image_ids(study, shard)
        states = [progress_of(folder, shard, study) for folder in folders]
        there = progress_of(target, shard, study)
        if not mix_environments:
            own = _one_environment(target, [there, *states], own)
        have = set(there.entries)
        for state in states:
            have |= _copy(study, target, shard, state, set(wanted) - have, mix_environments)
        missing += len(set(wanted) - have)
        done += len(wanted)
        if progress:
            progress(done, total)
    work = Work(study, target, range(total_frames(study)), own, mix_environments, developed=_origin(folders))
    if finish_what_is_complete(work):
        tidy(target, shards, study)
    elif not missing:
        raise DataError(f"{target}: all frames are there, but a record cannot be read; run the command again")
    return missing, total


def _one_study(parts: Sequence[Address]) -> tuple[Study, list[Store]]:
    folders = [store_at(part) for part in parts]
    studies = [held_study(folder) for folder in folders]
    for folder, study in zip(folders, studies, strict=True):
        if study.digest() != studies[0].digest():
            raise NotComparableError(
                f"{folder}: is of another study than {folders[0]} (dataset_id {study.digest()[:12]}, not "
                f"{studies[0].digest()[:12]}); give parts of one study"
            )
    return studies[0], folders


def _origin(folders: list[Store]) -> Developed | None:
    """Whose radiance the parts have, if one of them was developed and finished."""
    found: list[Developed] = []
    for folder in folders:
        if folder.size(files.MANIFEST) is not None:
            developed = developed_of(read_manifest(folder)[1].model_dump(exclude_none=True))
            found += [] if developed is None else [developed]
    return min(found, key=lambda one: one.dataset_id, default=None)


def _one_environment(target: Store, states: list[ShardProgress], own: Environment) -> Environment:
    """The environment of all frames of a shard: that of the first frame there is."""
    known: dict[str, Environment] = {}
    keys: list[tuple[int, str | None]] = []
    for state in states:
        known |= state.environments
        keys += [(i, entry.get("environment")) for i, entry in state.entries.items()]
    first = next((known[key] for _, key in sorted(keys) if key in known), own)
    check_one_environment(str(target), keys, first, known)
    return first


def _copy(study: Study, target: Store, shard: Shard, source: ShardProgress, wanted: set[int], mix: bool) -> set[int]:
    """Copy frames of a shard; returns their ids."""
    copied: set[int] = set()
    by_environment: dict[str, list[journal.Entry]] = {}
    for frame_id in sorted(wanted & source.entries.keys()):
        entry = source.entries[frame_id]
        by_environment.setdefault(str(entry.get("environment")), []).append(entry)
    for key, entries in by_environment.items():
        # A log tells what made its frames.
        mine = Participant(study, target, source.environments.get(key, UNKNOWN), mix)
        try:
            state = mine.enter(shard)
            for entry in entries:
                for name, listed in entry["files"].items():
                    remedy = "`roundel repair` mends that part"
                    data = source.here.read_checked(name, Listed(listed["bytes"], listed["sha256"]), remedy)
                    state.here.write(name, data)
                bare = {name: value for name, value in entry.items() if name != "environment"}
                state.record(bare, source.seconds.get(entry["frame_id"], {}))
                copied.add(entry["frame_id"])
        finally:
            mine.leave()
    return copied
