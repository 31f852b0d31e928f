"""`roundel render`: render a study to a dataset on disk; resumable, losing at most the current frame if killed.

Any number of processes may render into the same folder: each takes frames that nobody else does, and whoever is last
finishes the shard and the dataset.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

from roundel.datasets.cluster import ClusterPool, pool_of, threads_of_worker
from roundel.datasets.dataset import Dataset, open_dataset
from roundel.datasets.environment import Environment, environment_of
from roundel.datasets.index import image_ids, is_whole, progress_of, tidy
from roundel.datasets.layout.shards import shards_of
from roundel.datasets.resume import backend_to_resume, held_study, prepare
from roundel.datasets.store.addresses import Address, store_at
from roundel.datasets.work import Make, Task, Work, finish, refuse_lost, shards_within, work_through
from roundel.datasets.worker_pool import Lost, WorkerPool
from roundel.render.backend import DEFAULT_BACKEND, choose_backend, environment, start
from roundel.render.own_files import check_files
from roundel.render.shard_work import Renderer
from roundel.scenes.errors import UsageError
from roundel.scenes.study.study import Study, load_study
from roundel.scenes.world.frame import frame_of, total_frames

Progress = Callable[[int, int], None]

# Frames are placed before the first is rendered, evenly spread, until all are or this time is over: an impossible
# study is refused now.
_CHECK_S = 1.0


def render_study(
    study: Study | str | Path,
    dataset: Address,
    *,
    jobs: int = 1,
    threads: int | None = None,
    scheduler: str | None = None,
    frames: range | None = None,
    backend: str = DEFAULT_BACKEND,
    mix_environments: bool = False,
    progress: Progress | None = None,
    check_progress: Progress | None = None,
    on_warning: Callable[[str], None] | None = None,
) -> Dataset | None:
    """Render a study to a dataset on disk; existing frames are kept.

    Parameters
    ----------
    study : Study or path
    dataset : path or str
        A new or empty folder, or one that holds this study; or an address in an object store, such as
        s3://bucket/name. Others may render into it at the same time.
    jobs : int
        Number of processes; a single process already uses all cores.
    threads : int, optional
        Threads of each process. The bytes do not depend on jobs or threads.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers render instead of processes of this machine. They share the disk.
    frames : range, optional
        Only these frame ids; the dataset is finished once no frame is missing.
    backend : str
        `llvm`: the processor; `cuda`: an NVIDIA GPU; `auto`: the backend of the frames that exist, else `cuda` where a
        GPU is usable, else `llvm`. The bytes depend on it.
    mix_environments : bool
        Go on with frames that another version or machine rendered, whose last bits may differ.
    progress : callable, optional
        Called with (done, total) as frames are rendered.
    check_progress : callable, optional
        Called with (done, total) before that, while frames are placed.
    on_warning : callable, optional
        Called with one line for each damaged log or journal whose frames are rendered again.

    Returns
    -------
    Dataset or None
        None if frames are still missing.

    Raises
    ------
    StudyError
        If a frame is impossible; as far as possible before anything is rendered.
    UsageError
        If the folder holds something else, or frames of another backend.
    BackendError
        If the backend cannot start on this machine.
    DataError
        If a file cannot be written (finished frames are kept), if finished frames were drawn differently or are of
        another environment, or if the processes of a frame died: the other frames are rendered first.
    """
    if not isinstance(study, Study):
        study = load_study(study)
    total = total_frames(study)
    wanted = range(total) if frames is None else range(min(frames.start, total), min(frames.stop, total))
    shards = shards_within(total, wanted)
    has_images = any(image_ids(study, shard) for shard in shards)
    # Before the frames are placed, which may take long.
    chosen = choose_backend(backend) if has_images else backend
    place_some(study, wanted, chosen, check_progress, _CHECK_S)
    folder = prepare(study, dataset)
    if is_whole(folder, shards):
        tidy(folder, shards, study)
        return open_dataset(dataset)
    entries = next((e for e in (progress_of(folder, s, study).entries for s in shards[:1]) if e), {})
    if entries:
        chosen = choose_backend(backend_to_resume(str(folder), entries.values(), backend))
    own = environment_of(environment(chosen) if has_images else {"variant": None})
    together = jobs > 1 or scheduler is not None
    work = Work(study, folder, wanted, own, mix_environments, progress, on_warning, together=together)
    with ExitStack() as stack:
        if together:
            backend_here = chosen if has_images else None
            maker = _workers(work, jobs, threads, scheduler, backend_here, stack)
        else:
            maker = _here(work, threads, chosen, stack)
        finished = work_through(work, maker)
    refuse_lost(work)
    tidy(folder, shards_of(total) if finished else work.finished, study)
    return open_dataset(dataset) if finished else None


def place_some(study: Study, wanted: range, backend: str, progress: Progress | None, seconds: float) -> tuple[int, int]:
    """Place frames, evenly spread, until all are or the time is over; returns how many were, and of how many.

    Raises
    ------
    StudyError
        If one of them is impossible.
    """
    until, count = time.monotonic() + seconds, len(wanted)
    for done, i in enumerate(_spread(count), start=1):
        frame = frame_of(study, wanted[i])
        if frame.settings.mode == "images":
            check_files(study, frame, backend)
        if progress:
            progress(done, count)
        if time.monotonic() > until:
            return done, count
    return count, count


def _spread(count: int) -> Iterator[int]:
    """Numbers below `count`, each once: the ends first, then such that any beginning is evenly spread."""
    yield from (0, count - 1)[: min(count, 2)]
    bits = max(count - 1, 0).bit_length()
    for i in range(1, 1 << bits):
        # Bit reversal, as in van der Corput's sequence.
        at = int(f"{i:0{bits}b}"[::-1], 2)
        if at < count - 1:
            yield at


def _here(work: Work, threads: int | None, backend: str, stack: ExitStack) -> Make:
    """What renders frames in this process, which starts with the first."""
    mine: list[Renderer] = []

    def make(tasks: Iterable[Task]) -> Iterator[tuple[Task, int]]:
        for (shard, has_frames), group in groupby(tasks, key=lambda task: (task.shard, bool(task.frame_ids))):
            if not has_frames:
                yield from ((task, finish(work, shard)) for task in group)
                continue
            if not mine:
                start(f"{backend}_ad_mono", threads)
                mine.append(Renderer(work.study, work.folder, backend, work.own, work.mix))
                stack.callback(mine[0].leave)
            ids = (i for task in group for i in task.frame_ids)
            yield from ((Task(shard, (i,)), done) for i, done in mine[0].render(shard, ids))

    return make


def _workers(
    work: Work, jobs: int, threads: int | None, scheduler: str | None, backend: str | None, stack: ExitStack
) -> Make:
    """What renders frames in other processes, which start with the first and end with `stack`."""
    pools: list[WorkerPool | ClusterPool] = []

    def make(tasks: Iterable[Task]) -> Iterator[tuple[Task, int] | Lost[Task]]:
        if not pools:
            # Start here first: an error is then known before any process is started.
            if backend is not None:
                start(f"{backend}_ad_mono")
            about = Shared(
                str(work.study.path.resolve()), work.study.digest(), work.folder.address(), work.own, work.mix
            )
            cores = threads if threads is not None or scheduler is not None else max(1, (os.cpu_count() or 1) // jobs)
            arguments = about, backend, cores
            died = "the rendering processes died as they started; free some memory, or use fewer --jobs"
            pools.append(pool_of(jobs, scheduler, _work, _start_worker, arguments, died, _stop_worker))
            stack.enter_context(pools[0])
        return pools[0].in_order(tasks)

    return make


@dataclass(frozen=True)
class Shared:
    """What the workers of a dataset share with the process that started them."""

    study_path: str
    digest: str
    address: str
    own: Environment
    mix: bool


# A worker process keeps what it is at from one frame to the next.
_worker: list[tuple[Work, Renderer | None]] = []


def _start_worker(shared: Shared, backend: str | None, threads: int | None) -> None:
    folder = store_at(shared.address)
    # Beside the files that it may name; a machine without that disk has the study of the dataset.
    study = load_study(shared.study_path) if Path(shared.study_path).is_file() else held_study(folder)
    if study.digest() != shared.digest:
        raise UsageError(f"{shared.study_path}: changed while it was being rendered; run again")
    _stop_worker()  # one of a cluster may have worked for somebody else before
    work = Work(study, folder, range(total_frames(study)), shared.own, shared.mix)
    renderer = None
    if backend is not None:
        start(f"{backend}_ad_mono", threads or threads_of_worker())
        own = environment_of(environment(backend))
        renderer = Renderer(study, folder, backend, own, shared.mix)
    _worker[:] = [(work, renderer)]


def _stop_worker() -> None:
    for _, renderer in _worker:
        if renderer is not None:
            renderer.leave()
    _worker.clear()


def _work(task: Task) -> tuple[Task, int]:
    work, renderer = _worker[0]
    if not task.frame_ids:
        return task, finish(work, task.shard)
    assert renderer is not None, "frames with images have a renderer"
    return task, sum(renderer.render_one(task.shard, i) for i in task.frame_ids)
