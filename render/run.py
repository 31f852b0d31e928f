"""`roundel render`: render a study to a dataset on disk; resumable, losing at most the current frame if killed.

Any number of processes may render into the same folder: each takes frames that nobody else does, and whoever is last
finishes the shard and the dataset.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

from roundel.datasets.cluster import ClusterPool
from roundel.datasets.dataset import Dataset, open_dataset
from roundel.datasets.environment import Environment, environment_of
from roundel.datasets.index import image_ids, progress_of
from roundel.datasets.layout.shards import Shard, shards_of
from roundel.datasets.resume import backend_to_resume, prepare
from roundel.datasets.store.addresses import Address, store_at
from roundel.datasets.work import MakeFrames, Work, is_whole, shards_within, tidy, work_through
from roundel.datasets.worker_pool import Lost, WorkerPool
from roundel.render.backend import DEFAULT_BACKEND, choose_backend, environment, start
from roundel.render.own_files import check_files
from roundel.render.shard_work import Renderer
from roundel.scenes.errors import DataError, UsageError
from roundel.scenes.study.study import Study, load_study
from roundel.scenes.world.frame import frame_of, total_frames

Progress = Callable[[int, int], None]

# Frames are placed before the first is rendered, evenly spread, until all are or this time is over: an impossible
# study is refused now.
_CHECK_S = 1.0

# A worker process keeps what it is at from one frame to the next.
_worker: list[Renderer] = []


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
    work = Work(study, folder, wanted, own, mix_environments, progress, on_warning)
    with ExitStack() as stack:
        finished = work_through(work, _maker(work, jobs, threads, scheduler, chosen, stack))
    if work.lost:
        first, *more = work.lost
        what = "it is" if not more else f"this and {len(more)} more are"
        raise DataError(
            f"{folder}: frame {first.item[1]}: {first}; {what} set aside, all other frames are done; run the command "
            "again to try once more"
        )
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


def _maker(
    work: Work, jobs: int, threads: int | None, scheduler: str | None, backend: str, stack: ExitStack
) -> MakeFrames:
    """What renders frames: this process, or its workers, which start with the first frame and end with `stack`."""
    mine: list[Renderer] = []
    pool: list[WorkerPool | ClusterPool] = []

    def here(shard: Shard, ids: list[int]) -> Iterator[int | None]:
        if not mine:
            start(f"{backend}_ad_mono", threads)
            mine.append(Renderer(work.study, work.folder, backend, work.own, work.mix))
            stack.callback(mine[0].leave)
        return mine[0].render(shard, ids)

    def there(shard: Shard, ids: list[int]) -> Iterator[int | Lost[tuple[Shard, int]] | None]:
        if not pool:
            # Start here first: an error is then known before any process is started.
            start(f"{backend}_ad_mono", threads)
            study = work.study.path.resolve()
            arguments = (str(study), work.study.digest(), work.folder.address(), backend, threads, work.mix)
            if scheduler is not None:
                pool.append(stack.enter_context(ClusterPool(scheduler, _work, _start_worker, arguments, _stop_worker)))
                return pool[0].in_order((shard, i) for i in ids)
            died = "the rendering processes died as they started; free some memory, or use fewer --jobs"
            pool.append(stack.enter_context(WorkerPool(jobs, _work, _start_worker, arguments, died)))
        return pool[0].in_order((shard, i) for i in ids)

    return here if jobs == 1 and scheduler is None else there


def _start_worker(study_path: str, digest: str, dataset: str, backend: str, threads: int | None, mix: bool) -> None:
    study = load_study(study_path)
    if study.digest() != digest:
        raise UsageError(f"{study_path}: changed while it was being rendered; run again")
    start(f"{backend}_ad_mono", threads)
    _stop_worker()  # one of a cluster may have worked for somebody else before
    _worker[:] = [Renderer(study, store_at(dataset), backend, _own(backend), mix)]


def _stop_worker() -> None:
    for renderer in _worker:
        renderer.leave()
    _worker.clear()


def _own(backend: str) -> Environment:
    return environment_of(environment(backend))


def _work(item: tuple[Shard, int]) -> int | None:
    return _worker[0].render_one(*item)
