"""`roundel render`: render a study to a dataset on disk; resumable, losing at most the current frame if killed."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from roundel.datasets.dataset import Dataset, open_dataset
from roundel.datasets.fidelity.measure import measure_circle
from roundel.datasets.finish import finish_dataset
from roundel.datasets.layout import files, journal
from roundel.datasets.layout.radiance import encode_radiance
from roundel.datasets.layout.worker_pool import in_order
from roundel.datasets.numbers import check_resumable
from roundel.datasets.resume import backend_to_resume, prepare, record, reopen
from roundel.render.backend import DEFAULT_BACKEND, choose_backend, environment, start, variant_of
from roundel.render.frame_files import coverage_channel, entry_of, image_file, write_frame
from roundel.render.own_files import check_files
from roundel.render.sensor.develop import develop
from roundel.scenes.errors import UsageError
from roundel.scenes.study.identity import frame_digest
from roundel.scenes.study.study import Study, load_study
from roundel.scenes.world.frame import Frame, frame_of, frames_of, group_ranges

if TYPE_CHECKING:
    from roundel.render.radiance import Radiance

Progress = Callable[[int, int], None]

# Compressing a frame on one core takes about as long as tracing it: two at a time keep up.
_FINISHERS = 2

# A frame's journal line and its timings.
Done = tuple[journal.Entry, dict[str, float]]


def _traced(frame: Frame, backend: str) -> tuple[Radiance, float]:
    """A frame's radiance and its timings in seconds."""
    from roundel.render.radiance import render_radiance

    began = time.perf_counter()
    return render_radiance(start(variant_of(frame, backend)), frame), time.perf_counter() - began


def _finished(frame: Frame, radiance: Radiance, render_s: float, dataset: Path, backend: str) -> Done:
    """Measure, develop and write a traced frame; needs no renderer."""
    clock = [time.perf_counter()]
    developed = develop(frame, radiance.mean)
    planes = {"Y": radiance.mean, "Y.variance": radiance.variance, "Z": radiance.depth_m}
    planes |= {coverage_channel(marker_id): plane for marker_id, plane in radiance.coverage.items()}
    fidelity = {
        str(part.marker_id): measure_circle(view, part.marker_id, radiance.mean, radiance.variance)
        for view in frame.views()
        for part in view.sheet.parts
        if part.radius_m is not None
    }
    written = image_file(frame, developed)
    if frame.settings.render.radiance:
        noise = {"noise_dn": developed.noise_dn()}
        written[files.radiance_name(frame.frame_id)] = encode_radiance(planes | noise)
    clock.append(time.perf_counter())
    listed = write_frame(dataset, written)
    clock.append(time.perf_counter())
    encode, write = np.diff(clock)
    seconds = {"render_s": render_s, "encode_s": float(encode), "write_s": float(write)}
    return entry_of(frame, developed, planes, fidelity, listed, backend), seconds


def render_frame(frame: Frame, dataset: Path, backend: str = DEFAULT_BACKEND) -> Done:
    """Render, measure, develop and write one frame.

    Returns
    -------
    entry : dict
        The frame's journal line, see `frame_files.entry_of`.
    seconds : dict
        Timings, for timings.jsonl.
    """
    return _finished(frame, *_traced(frame, backend), dataset, backend)


def render_frames(frames: Iterable[Frame], dataset: Path, backend: str = DEFAULT_BACKEND) -> Iterator[Done]:
    """Frames in order: while one is traced, earlier ones are measured, compressed and written."""
    with ThreadPoolExecutor(_FINISHERS, "finish") as pool:
        before: deque[Future[Done]] = deque()
        for frame in frames:
            traced = _traced(frame, backend)
            if len(before) == _FINISHERS:
                yield before.popleft().result()
            before.append(pool.submit(_finished, frame, *traced, dataset, backend))
        while before:
            yield before.popleft().result()


# A worker process keeps its study and its renderer from one frame to the next.
_worker: dict[str, Any] = {}


def _start_worker(study_path: str, digest: str, dataset: str, backend: str, threads: int | None) -> None:
    study = load_study(study_path)
    if study.digest() != digest:
        raise UsageError(f"{study_path}: changed while it was being rendered; run again")
    _worker.update(study=study, dataset=Path(dataset), backend=backend)
    start(f"{backend}_ad_mono", threads)


def _work(frame_id: int) -> Done:
    return render_frame(frame_of(_worker["study"], frame_id), _worker["dataset"], _worker["backend"])


def _rendered(
    study: Study, dataset: Path, frame_ids: list[int], jobs: int, backend: str, threads: int | None
) -> Generator[Done, None, None]:
    """Results in the order of the frames."""
    if not frame_ids:
        return
    # Start here first: an error is then known before any process is started.
    start(f"{backend}_ad_mono", threads)
    if jobs == 1:
        yield from render_frames((frame_of(study, i) for i in frame_ids), dataset, backend)
        return
    arguments = (str(study.path), study.digest(), str(dataset), backend, threads)
    died = "a rendering process died; run the command again to continue"
    yield from in_order(jobs, _work, frame_ids, _start_worker, arguments, died)


def render_study(
    study: Study | str | Path,
    dataset: str | Path,
    *,
    jobs: int = 1,
    threads: int | None = None,
    frames: range | None = None,
    backend: str = DEFAULT_BACKEND,
    progress: Progress | None = None,
    check_progress: Progress | None = None,
) -> Dataset | None:
    """Render a study to a dataset on disk; existing frames are kept.

    Parameters
    ----------
    study : Study or path
    dataset : path
        A new or empty folder, or one that holds this study.
    jobs : int
        Number of processes; a single process already uses all cores.
    threads : int, optional
        Threads of each process. The bytes do not depend on jobs or threads.
    frames : range, optional
        Only these frame ids; the dataset is finished once no frame is missing.
    backend : str
        `llvm`: the processor; `cuda`: an NVIDIA GPU; `auto`: the backend of the frames that exist, else `cuda` where a
        GPU is usable, else `llvm`. The bytes depend on it.
    progress : callable, optional
        Called with (done, total) as frames are rendered.
    check_progress : callable, optional
        Called with (done, total) before that, while all frames are placed.

    Returns
    -------
    Dataset or None
        None if frames are still missing.

    Raises
    ------
    StudyError
        Before anything is rendered, if a frame is impossible.
    UsageError
        If the folder holds something else, or frames of another backend.
    BackendError
        If the backend cannot start on this machine.
    DataError
        If a file cannot be written (finished frames are kept), or if finished frames were drawn differently.
    """
    if not isinstance(study, Study):
        study = load_study(study)
    dataset = Path(dataset)
    wanted: list[int] = []
    ranges = group_ranges(study)
    images = {i for name, ids in ranges.items() if study.groups[name].mode == "images" for i in ids}
    # Before the frames are placed, which may take long.
    chosen = choose_backend(backend) if images else backend
    digests: dict[int, str] = {}
    count = sum(map(len, ranges.values()))
    for frame in frames_of(study):
        # Place every frame before rendering the first: an impossible study is refused now.
        digests[frame.frame_id] = frame_digest(frame)
        if frame.frame_id in images and (frames is None or frame.frame_id in frames):
            wanted.append(frame.frame_id)
            check_files(study, frame, chosen)
        if check_progress:
            check_progress(len(digests), count)
    entries = prepare(study, dataset)
    check_resumable(dataset, entries, digests)
    if entries:
        chosen = choose_backend(backend_to_resume(dataset, entries, backend))
    missing = [i for i in wanted if i not in entries]
    if missing:
        reopen(dataset, entries)
    if progress:
        progress(len(wanted) - len(missing), len(wanted))
    with closing(_rendered(study, dataset, missing, jobs, chosen, threads)) as results:
        for done, (entry, seconds) in enumerate(results, start=len(wanted) - len(missing) + 1):
            record(dataset, entries, entry, seconds)
            if progress:
                progress(done, len(wanted))
    if images - set(entries):
        return None
    made_by = environment(chosen) if images else {"variant": None}
    finish_dataset(study, dataset, entries, made_by)
    return open_dataset(dataset)
