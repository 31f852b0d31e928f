"""What a process does in a shard: claim a frame, render it, write its files, record it."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np

from roundel.datasets.environment import Environment
from roundel.datasets.fidelity.measure import measure_circle
from roundel.datasets.layout import files, journal
from roundel.datasets.layout.masks import only_masks
from roundel.datasets.layout.radiance import coverage_channel, encode_planes
from roundel.datasets.layout.shards import Shard
from roundel.datasets.store.store import Store
from roundel.datasets.work import Participant
from roundel.render.backend import DEFAULT_BACKEND, start, variant_of
from roundel.render.frame_files import entry_of, image_file, write_frame
from roundel.render.sensor.develop import develop
from roundel.scenes.study.study import Study
from roundel.scenes.world.frame import Frame, frame_of

if TYPE_CHECKING:
    from roundel.render.radiance import Radiance

# Compressing a frame on one core takes about as long as tracing it: two at a time keep up.
_FINISHERS = 2

# A frame's journal line and its timings.
Done = tuple[journal.Entry, dict[str, float]]


def _traced(frame: Frame, backend: str) -> tuple[Radiance, float]:
    """A frame's radiance and its timings in seconds."""
    from roundel.render.radiance import render_radiance

    began = time.perf_counter()
    return render_radiance(start(variant_of(frame, backend)), frame), time.perf_counter() - began


def _finished(frame: Frame, radiance: Radiance, render_s: float, folder: Store, backend: str) -> Done:
    """Measure, develop and write a traced frame; needs no renderer."""
    clock = [time.perf_counter()]
    developed = develop(frame, radiance.mean)
    planes = {"Y": radiance.mean, "Y.variance": radiance.variance}
    if radiance.depth_m is not None:
        planes["Z"] = radiance.depth_m
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
        written[files.radiance_name(frame.frame_id)] = encode_planes(planes | noise)
    elif frame.settings.render.masks:
        written[files.masks_name(frame.frame_id)] = encode_planes(only_masks(planes))
    clock.append(time.perf_counter())
    listed = write_frame(folder, written)
    clock.append(time.perf_counter())
    encode, write = np.diff(clock)
    seconds = {"render_s": render_s, "encode_s": float(encode), "write_s": float(write)}
    return entry_of(frame, developed, planes, fidelity, listed, backend), seconds


def render_frame(frame: Frame, folder: Store, backend: str = DEFAULT_BACKEND) -> Done:
    """Render, measure, develop and write one frame.

    Parameters
    ----------
    frame : Frame
    folder : Store
        That of its shard.
    backend : str

    Returns
    -------
    entry : dict
        The frame's journal line, see `frame_files.entry_of`.
    seconds : dict
        Timings, for timings.jsonl.
    """
    return _finished(frame, *_traced(frame, backend), folder, backend)


def render_frames(frames: Iterable[Frame], folder: Store, backend: str = DEFAULT_BACKEND) -> Iterator[Done]:
    """Frames in order: while one is traced, earlier ones are measured, compressed and written."""
    with ThreadPoolExecutor(_FINISHERS, "finish") as pool:
        before: deque[Future[Done]] = deque()
        for frame in frames:
            traced = _traced(frame, backend)
            if len(before) == _FINISHERS:
                yield before.popleft().result()
            before.append(pool.submit(_finished, frame, *traced, folder, backend))
        while before:
            yield before.popleft().result()


class Renderer(Participant):
    """A process that renders frames of a study into its dataset."""

    def __init__(self, study: Study, folder: Store, backend: str, environment: Environment, mix: bool) -> None:
        super().__init__(study, folder, environment, mix)
        self.backend = backend

    def render(self, shard: Shard, frame_ids: Iterable[int]) -> Iterator[tuple[int, bool]]:
        """Render those frames of a shard that nobody else does; yields each with whether it is done and recorded."""
        state, others = self.enter(shard), list[int]()

        def claimed() -> Iterator[Frame]:
            for i in frame_ids:
                if state.claim(i):
                    yield frame_of(self.study, i)
                else:
                    others.append(i)

        for entry, seconds in render_frames(claimed(), state.here, self.backend):
            state.record(entry, seconds)
            yield entry["frame_id"], True
        yield from ((i, False) for i in others)

    def render_one(self, shard: Shard, frame_id: int) -> bool:
        """Render a frame of a shard; whether it was done: not, if somebody else does it."""
        state = self.enter(shard)
        if not state.claim(frame_id):
            return False
        state.record(*render_frame(frame_of(self.study, frame_id), state.here, self.backend))
        return True
