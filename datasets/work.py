"""Work through the frames of a dataset, shard by shard, beside others that do the same; finish what is complete."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

from roundel.datasets.environment import Environment, check_one_environment
from roundel.datasets.index import (
    finish_dataset,
    finish_frames,
    finished_record,
    finishing,
    image_ids,
    is_whole,
    progress_of,
)
from roundel.datasets.layout import files
from roundel.datasets.layout.developed import Developed
from roundel.datasets.layout.shards import Shard, shards_of
from roundel.datasets.numbers import check_resumable
from roundel.datasets.progress import ShardProgress
from roundel.datasets.store.store import Store
from roundel.datasets.worker_pool import Lost
from roundel.scenes.errors import DataError
from roundel.scenes.study.study import Study
from roundel.scenes.world.frame import total_frames


@dataclass(frozen=True)
class Task:
    """Frames of a shard to make; without frames, the tables and record of the shard, whose frames are done."""

    shard: Shard
    frame_ids: tuple[int, ...] = ()

    def __str__(self) -> str:
        return f"frame {self.frame_ids[0]}" if self.frame_ids else f"shard {self.shard.folder}"


# Takes tasks as they come and yields, in whatever order, each with how much of it was done: not the frames that
# somebody else has claimed; or what is left of one whose processes died.
Make = Callable[[Iterable[Task]], Iterator[tuple[Task, int] | Lost[Task]]]

# Several workers get frames for about so many seconds at a time: what handing them out costs is then little.
_TASK_S = 2.0
_MOST_FRAMES = 16


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
    developed : Developed, optional
        See `finish_shard`.
    together : bool
        Whether frames of the next shard are made while those of one are still under way, by several workers.
    """

    study: Study
    folder: Store
    wanted: range
    own: Environment
    mix: bool = False
    progress: Callable[[int, int], None] | None = None
    on_warning: Callable[[str], None] | None = None
    developed: Developed | None = None
    together: bool = False
    done: int = 0
    total: int = 0
    finished: list[Shard] = field(default_factory=list)
    lost: list[Lost[Task]] = field(default_factory=list)
    _ended: tuple[int, int] | None = None

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


def work_through(work: Work, make: Make) -> bool:
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
    work.total = sum(_wanted(work, shard) for shard in shards)
    work.say()
    for batch in [shards] if work.together else ([shard] for shard in shards):
        _Batch(work, batch, make).work()
    work.say()
    return not work.lost and _finish_dataset(work)


def _wanted(work: Work, shard: Shard) -> int:
    """How many frames of a shard are wanted."""
    return len(range(max(shard.frames.start, work.wanted.start), min(shard.frames.stop, work.wanted.stop)))


class _Batch:
    """Shards that are worked through together: tasks are found as they are asked for."""

    def __init__(self, work: Work, shards: list[Shard], make: Make) -> None:
        self.job, self.make = work, make
        self.waiting = list(shards)
        self.states: dict[Shard, ShardProgress] = {}
        self.counted: dict[Shard, int] = {}
        self.given: dict[Shard, int] = {}
        self.ready: deque[Shard] = deque()
        self.set_aside: set[int] = set()
        self.single: set[int] = set()
        self.frame_s: float | None = None
        self.made = 0

    def work(self) -> None:
        """Make frames until all are done, by whomever, and finish shards of which none is missing."""
        while self.waiting:
            self.made = 0
            self._take(self._tasks())
            while self.ready:
                self._take(self._finishes())
            if self.waiting and not self.made:
                time.sleep(self.job.folder.poll_s)
                self._read_again()

    def _read_again(self) -> None:
        """The state of shards that somebody else has finished: what their logs said is only in their journals now."""
        for shard, state in self.states.items():
            if state.is_outdated():
                self.states[shard] = progress_of(self.job.folder, shard, self.job.study)

    def _take(self, tasks: Iterator[Task]) -> None:
        for outcome in self.make(tasks):
            task, done = (outcome.item, 0) if isinstance(outcome, Lost) else outcome
            if isinstance(outcome, Lost):
                self._lose(outcome)
            self.made += done
            if not task.frame_ids:
                if done:
                    self.job.finished.append(task.shard)
                continue
            self.counted[task.shard] += done
            self.job.say(done)
            self.given[task.shard] -= 1
            if not self.given[task.shard]:
                self._close(task.shard)

    def _lose(self, lost: Lost[Task]) -> None:
        """Set a frame aside of which processes died; of several frames, find out of which."""
        if len(lost.item.frame_ids) > 1:
            self.single |= set(lost.item.frame_ids)
            self.made += 1  # what was found out is progress
        else:
            self.job.lost.append(lost)
            self.set_aside |= set(lost.item.frame_ids)

    def _finishes(self) -> Iterator[Task]:
        while self.ready:
            yield Task(self.ready.popleft())

    def _tasks(self) -> Iterator[Task]:
        for shard in list(self.waiting):
            yield from self._finishes()
            if shard not in self.states:
                if _is_finished(self.job, shard):
                    self.job.finished.append(shard)
                    self.job.say(_wanted(self.job, shard))
                    self.waiting.remove(shard)
                    continue
                self.states[shard] = _opened(self.job, shard)
                self.counted[shard] = 0
            free = [i for i in self._missing(shard) if not self.states[shard].is_claimed(i)]
            # One more than are given, so that it is not closed before the last is known to be the last.
            self.given[shard] = 1
            while free:
                # Few at the end, so that no worker waits long for another.
                size = max(1, min(self._block(shard), len(free) // _MOST_FRAMES))
                size = 1 if self.single.intersection(free[:size]) else size
                self.given[shard] += 1
                yield Task(shard, tuple(free[:size]))
                free = free[size:]
                yield from self._finishes()
            self.given[shard] -= 1
            if not self.given[shard]:
                self._close(shard)

    def _block(self, shard: Shard) -> int:
        """How many frames to hand out at once."""
        if not self.job.together:
            return 1
        if self.frame_s is None:
            self.states[shard].refresh()
            known = [sum(seconds.values()) for seconds in self.states[shard].seconds.values()]
            self.frame_s = sum(known) / len(known) if known else None
        return 1 if self.frame_s is None else min(_MOST_FRAMES, round(_TASK_S / max(self.frame_s, 1e-3)))

    def _missing(self, shard: Shard) -> list[int]:
        """Wanted frames of a shard that nobody has finished; those that others have finished since are counted."""
        state = self.states[shard]
        state.refresh()
        ids = [i for i in image_ids(self.job.study, shard) if i in self.job.wanted]
        missing = [i for i in ids if i not in state.entries and i not in self.set_aside]
        news = len(ids) - len(missing) - self.counted[shard] - len(self.set_aside.intersection(ids))
        self.counted[shard] += max(news, 0)
        self.job.say(max(news, 0))
        return missing

    def _close(self, shard: Shard) -> None:
        """After the tasks of a shard: wait for it no more if all wanted frames are done; finish it if all are."""
        # What is recorded is there: of a store that lost a file the frame is made again.
        if self._missing(shard) or self.states[shard].drop_incomplete():
            return
        self.waiting.remove(shard)
        state = self.states.pop(shard)
        # Frames in points mode are made with the tables.
        ids = image_ids(self.job.study, shard)
        self.job.say(_wanted(self.job, shard) - sum(i in self.job.wanted for i in ids))
        if not set(ids) - set(state.entries):
            self.ready.append(shard)


def refuse_lost(work: Work) -> None:
    """Name what was set aside.

    Raises
    ------
    DataError
        If processes of a frame or shard died.
    """
    if work.lost:
        first, *more = work.lost
        what = "it is" if not more else f"this and {len(more)} more are"
        raise DataError(
            f"{work.folder}: {first.item}: {first}; {what} set aside, all other frames are done; run the command again "
            "to try once more"
        )


def finish_what_is_complete(work: Work) -> bool:
    """Finish the shards in which no frame is missing, and the dataset if none is; returns whether it is.

    Raises
    ------
    DataError
        As `work_through`.
    """
    for shard in shards_within(total_frames(work.study), work.wanted):
        if not _is_finished(work, shard):
            finish(work, shard)
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


def finish(work: Work, shard: Shard) -> bool:
    """Write the tables and record of a complete shard, unless somebody else has; returns whether it is complete.

    Raises
    ------
    DataError
        As `finish_frames`.
    """
    with finishing(work.folder.sub(shard.folder)):
        if shard.folder and finished_record(work.folder, shard, work.study.digest()) is not None:
            return True
        if not shard.folder and is_whole(work.folder, [shard]):
            return True
        state = progress_of(work.folder, shard, work.study)
        if set(image_ids(work.study, shard)) - set(state.entries):
            return False
        record = finish_frames(work.study, work.folder, state, work.own, work.mix, work.developed)
        if not shard.folder:
            finish_dataset(work.study, work.folder, [(shard, record)], work.own, work.mix)
    return True


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
