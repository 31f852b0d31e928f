"""Work through the frames of a dataset, shard by shard, beside others that do the same; finish what is complete."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

from roundel.datasets.environment import Environment, check_one_environment
from roundel.datasets.index import (
    finish_dataset,
    finish_frames,
    finished_record,
    finishing,
    image_ids,
    progress_of,
)
from roundel.datasets.layout import files
from roundel.datasets.layout.contents import read_contents
from roundel.datasets.layout.shards import Shard, shards_of
from roundel.datasets.numbers import check_resumable
from roundel.datasets.progress import ShardProgress
from roundel.datasets.store.store import Store
from roundel.datasets.worker_pool import Lost
from roundel.scenes.errors import DataError
from roundel.scenes.study.study import Study
from roundel.scenes.world.frame import total_frames

# Takes frames of a shard and yields the id of each that is done and recorded, None for one that somebody else has
# claimed, or what is left of one whose processes died.
MakeFrames = Callable[[Shard, list[int]], Iterator[int | Lost[tuple[Shard, int]] | None]]

_POLL_S = 0.2


@dataclass
class Work:
    """What is to be done: frames of a study's dataset, by this process and its workers.

    Attributes
    ----------
    study : Study
    folder : Store
    wanted : range
        Frame ids.
    own : dict
        The environment of this process.
    mix : bool
        Whether frames of other environments may stay.
    progress : callable, optional
        Called with (done, total).
    on_warning : callable, optional
        Called with one line.
    developed_from : str, optional
        See `finish_shard`.
    """

    study: Study
    folder: Store
    wanted: range
    own: Environment
    mix: bool = False
    progress: Callable[[int, int], None] | None = None
    on_warning: Callable[[str], None] | None = None
    developed_from: str | None = None
    done: int = 0
    total: int = 0
    finished: list[Shard] = field(default_factory=list)
    _ended: tuple[int, int] | None = None
    lost: list[Lost[tuple[Shard, int]]] = field(default_factory=list)

    def say(self, more: int = 0) -> None:
        """Show the progress, after `more` frames."""
        self.done += more
        # The end is said once, at the end.
        if self.progress and (self.done < self.total or not more) and (self.done, self.total) != self._ended:
            self.progress(self.done, self.total)
            self._ended = (self.done, self.total) if self.done == self.total else None


class Participant:
    """A process that makes frames of a dataset, in one shard at a time, with a log of its own there."""

    def __init__(self, study: Study, folder: Store, environment: Environment, mix: bool) -> None:
        self.study, self.folder = study, folder
        self._about = environment, mix
        self._state: ShardProgress | None = None

    def enter(self, shard: Shard) -> ShardProgress:
        """The state of a shard, with a log of this process; the log in another shard is closed."""
        if self._state is None or self._state.shard != shard:
            self.leave()
            self._state = progress_of(self.folder, shard, self.study)
            self._state.start(*self._about)
        return self._state

    def leave(self) -> None:
        """Close the log of this process."""
        if self._state is not None:
            self._state.close()
            self._state = None


def shards_within(total: int, wanted: range) -> list[Shard]:
    """The shards that have some of these frames."""
    return [s for s in shards_of(total) if s.frames.start < wanted.stop and s.frames.stop > wanted.start]


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
                subs = ("", files.IMAGES, files.RADIANCE)
                sizes = {f"{sub}/{n}".lstrip("/"): size for sub in subs for n, size in here.sizes(sub).items()}
                if any(sizes.get(name) != listed.bytes for name, listed in contents.files_of(part).items()):
                    return False
    except DataError:
        return False
    return True


def tidy(folder: Store, shards: Iterable[Shard], study: Study) -> None:
    """Remove the logs of finished shards, but for those of living processes, and what killed ones left."""
    folder.clear_leftovers()
    with finishing(folder):
        pass  # the lock of a killed process goes at the end of the block
    for shard in shards:
        here = folder.sub(shard.folder)
        if here.names("log"):
            progress_of(folder, shard, study).remove_logs()
        here.clear_leftovers("", files.IMAGES, files.RADIANCE)


def work_through(work: Work, make: MakeFrames) -> bool:
    """Make the wanted frames, finish their shards and, if no frame is missing, the dataset.

    Returns
    -------
    bool
        Whether the dataset is finished.

    Raises
    ------
    DataError
        As `render_study`.
    """
    shards = shards_within(total_frames(work.study), work.wanted)
    ids = {shard: [i for i in image_ids(work.study, shard) if i in work.wanted] for shard in shards}
    counts = {shard: len(range(*_overlap(shard.frames, work.wanted))) for shard in shards}
    work.total = sum(counts.values())
    work.say()
    for shard in shards:
        if _is_finished(work, shard):
            work.finished.append(shard)
            work.say(counts[shard])
            continue
        state = _opened(work, shard)
        _make_all(work, state, ids[shard], make)
        if not set(image_ids(work.study, shard)) - set(state.entries):
            _finish_shard(work, shard)
            work.finished.append(shard)
        # Frames in points mode are made with the tables.
        work.say(counts[shard] - len(ids[shard]))
    work.say()
    if work.lost:
        return False
    return _finish_dataset(work)


def _overlap(a: range, b: range) -> tuple[int, int]:
    return max(a.start, b.start), min(a.stop, b.stop)


def finish_what_is_complete(work: Work) -> bool:
    """Finish the shards in which no frame is missing, and the dataset if none is; returns whether it is.

    Raises
    ------
    DataError
        As `work_through`.
    """
    for shard in shards_within(total_frames(work.study), work.wanted):
        if not _is_finished(work, shard):
            state = progress_of(work.folder, shard, work.study)
            if not set(image_ids(work.study, shard)) - set(state.entries):
                _finish_shard(work, shard)
    return _finish_dataset(work)


def _is_finished(work: Work, shard: Shard) -> bool:
    """Whether a shard of several is complete, with the sizes that its record has."""
    if not shard.folder or finished_record(work.folder, shard, work.study.digest()) is None:
        return False
    state = progress_of(work.folder, shard, work.study)
    sizes = state.sizes()
    return all(
        sizes.get(name) == listed["bytes"]
        for entry in state.entries.values()
        for name, listed in entry["files"].items()
    )


def _opened(work: Work, shard: Shard) -> ShardProgress:
    """The state of a shard to go on with: what is damaged is forgotten, what does not belong there is refused."""
    state = progress_of(work.folder, shard, work.study)
    state.clear_leftovers()
    if work.on_warning:
        for note in state.notes:
            work.on_warning(note)
    check_resumable(str(work.folder), work.study, state.entries)
    if not (work.mix or state.mixed):
        keys = [(i, entry.get("environment")) for i, entry in state.entries.items()]
        check_one_environment(str(work.folder), keys, work.own, state.environments)
    dropped = state.drop_damaged()
    if dropped:
        # What they list is no more.
        work.folder.remove(*(n for n in (files.MANIFEST, shard.name(files.SHARD)) if work.folder.size(n) is not None))
        if work.on_warning:
            more = f" and {len(dropped) - 1} more" if len(dropped) > 1 else ""
            work.on_warning(f"{work.folder}: frame {dropped[0]}{more}: files are missing or altered; made again")
    return state


def _make_all(work: Work, state: ShardProgress, ids: list[int], make: MakeFrames) -> None:
    """Make frames until all are done, by whomever."""
    counted = sum(i in state.entries for i in ids)
    work.say(counted)
    set_aside: set[int] = set()
    while True:
        state.refresh()
        missing = [i for i in ids if i not in state.entries and i not in set_aside]
        news = len(ids) - len(missing) - len(set_aside) - counted
        if news > 0:
            counted += news
        work.say(max(news, 0))
        if not missing:
            # What is recorded is there: of a store that lost a file its frame is made again.
            if not state.drop_incomplete():
                return
            continue
        free = [i for i in missing if not state.is_claimed(i)]
        made = 0
        for result in make(state.shard, free):
            if isinstance(result, Lost):
                work.lost.append(result)
                set_aside.add(result.item[1])
            elif result is not None:
                counted += 1
                made += 1
                work.say(1)
        if not made:
            time.sleep(_POLL_S)


def _finish_shard(work: Work, shard: Shard) -> None:
    """Write the tables and record of a complete shard, unless somebody else has."""
    with finishing(work.folder):
        if shard.folder:
            if finished_record(work.folder, shard, work.study.digest()) is None:
                state = progress_of(work.folder, shard, work.study)
                finish_frames(work.study, work.folder, state, work.own, work.mix, work.developed_from)
        elif not is_whole(work.folder, [shard]):
            state = progress_of(work.folder, shard, work.study)
            record = finish_frames(work.study, work.folder, state, work.own, work.mix, work.developed_from)
            finish_dataset(work.study, work.folder, [(shard, record)], work.own, work.mix)


def _finish_dataset(work: Work) -> bool:
    """Write the manifest, if all shards are complete."""
    shards = shards_of(total_frames(work.study))
    if not shards[0].folder:
        return is_whole(work.folder, ())
    if any(work.folder.size(shard.name(files.SHARD)) is None for shard in shards):
        return False
    with finishing(work.folder):
        if is_whole(work.folder, ()):
            return True
        records = []
        for shard in shards:
            record = finished_record(work.folder, shard, work.study.digest())
            if record is None:
                return False
            records.append((shard, record))
        finish_dataset(work.study, work.folder, records, work.own, work.mix)
    return True
