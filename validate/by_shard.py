"""Scores of a dataset, shard by shard: memory holds one shard, and the columns that statistics are made of."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Generator
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import pyarrow as pa

from roundel.datasets.cluster import pool_of
from roundel.datasets.dataset import Dataset, open_dataset
from roundel.datasets.worker_pool import Lost
from roundel.scenes.blas_threads import one_blas_thread
from roundel.scenes.camera.model import Camera
from roundel.scenes.errors import DataError, NotComparableError
from roundel.solver.caveats import count_caveats
from roundel.validate.calibration.chessboard_reference import Reference, reference_of
from roundel.validate.calibration.opencv import BoardView
from roundel.validate.claims.calibration_benefit import ERRORS, off_axis_deg
from roundel.validate.estimates.runs import Run, read_runs, touched_groups
from roundel.validate.metrics.ground_truth import Targets, true_targets
from roundel.validate.scores.false_positives import FalseDetections
from roundel.validate.scores.scores import Matched, Scores, match_runs, score
from roundel.validate.scores.scores_on_disk import ScoresOnDisk


@dataclass
class ShardScores:
    """What the shards' scores add up to.

    Attributes
    ----------
    scores : Scores
        Against the truth and against the chessboards, and the chessboards' own poses.
    circles : int
        True circles.
    off_axis : pyarrow.Table or None
        See `calibration_benefit`; None if no run is calibrated.
    board_rows : pyarrow.Table or None
        Errors of circles by the boards beside them.
    filled_in : dict
        Defaults that were used, by run.
    caveats : list of dict
        The detections of each run by kind of caveat.
    """

    scores: Scores
    circles: int = 0
    off_axis: pa.Table | None = None
    board_rows: pa.Table | None = None
    filled_in: dict[str, list[str]] = field(default_factory=dict)
    caveats: list[dict[str, Any]] = field(default_factory=list)


@dataclass
class _Tally:
    filled: dict[tuple[str, str], dict[str, None]] = field(default_factory=dict)
    caveats: dict[tuple[str, str], Counter[str]] = field(default_factory=dict)
    detections: Counter[tuple[str, str]] = field(default_factory=Counter)

    def add(self, run: Run) -> None:
        """Count what a run of a shard used and warned of; both candidates of a detection have the same caveats."""
        key = run.method, run.intrinsics
        self.filled.setdefault(key, {}).update(dict.fromkeys(run.filled))
        first = [texts for texts, candidate in zip(run.caveats, run.candidate.tolist(), strict=False) if candidate == 0]
        self.caveats.setdefault(key, Counter()).update(count_caveats(first))
        self.detections[key] += len(first)

    def join(self, other: _Tally) -> None:
        """Add what another one counted."""
        for key, filled in other.filled.items():
            self.filled.setdefault(key, {}).update(filled)
        for key, caveats in other.caveats.items():
            self.caveats.setdefault(key, Counter()).update(caveats)
        self.detections.update(other.detections)


@dataclass(frozen=True)
class ShardScoring:
    """How shards are scored.

    Attributes
    ----------
    files : list of path
        Of estimates.
    extent_D : float
        See `true_targets`.
    views : list of BoardView
        The boards that were looked for.
    camera : Camera or None
        See `reference_of`.
    label : str
        Label of the reference's intrinsics.
    tolerated : frozenset of path
        Files in another convention, see `read_runs`.
    """

    files: list[Path]
    extent_D: float
    views: list[BoardView]
    camera: Camera | None
    label: str
    tolerated: frozenset[Path] = frozenset()


@dataclass
class _Part:
    """The scores of a shard."""

    tables: list[pa.Table]
    board_rows: pa.Table | None
    false: list[FalseDetections]
    circles: int
    frames: int
    off_axis: pa.Table | None
    tally: _Tally


def _score_part(dataset: Dataset, how: ShardScoring, touched: frozenset[str] | None, number: int) -> _Part:
    part = dataset.of_part(number)
    runs = read_runs(how.files, part, whole=dataset, tolerated=how.tolerated)
    targets = true_targets(part, how.extent_D)
    reference = _reference(part, how.views, targets, how.camera, how.label)
    found = score(part, targets, runs, reference.circles if reference else None, touched)
    tally = _Tally()
    for run in runs:
        tally.add(run)
    off_axis = off_axis_deg(targets.truth) if any("calibrated" in run.intrinsics for run in runs) else None
    tables = [found.table, *([reference.rows] if reference is not None else [])]
    boards = None
    if reference is not None and reference.circle_rows is not None:
        boards = reference.circle_rows.select(["frame_id", "marker_id", *(error.oracle for error in ERRORS)])
    return _Part(tables, boards, found.false_detections, len(targets), len(part), off_axis, tally)


def score_by_shard(
    dataset: Dataset,
    how: ShardScoring,
    rows: ScoresOnDisk,
    progress: Callable[[int, int], None] | None = None,
    jobs: int = 1,
    scheduler: str | None = None,
) -> ShardScores:
    """Score estimates of a dataset.

    Parameters
    ----------
    dataset : Dataset
    how : ShardScoring
    rows : ScoresOnDisk
        Where the rows are kept; for as long as they are used.
    progress : callable, optional
        Called with (frames done, total frames).
    jobs : int
        Number of processes, if there are several shards.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers score instead.

    Raises
    ------
    NotComparableError
        If there is nothing to score.
    DataError
        If processes died.
    """
    # Of a single shard the runs themselves tell.
    several = len(dataset.contents.parts) > 1
    touched = touched_groups(how.files, dataset, how.tolerated) if several else None
    boards: list[pa.Table] = []
    off_axis: list[pa.Table] = []
    false: dict[tuple[str, str], FalseDetections] = {}
    scored = False
    tally, out, done = _Tally(), ShardScores(Scores(pa.table({}))), 0
    with closing(_parts(dataset, how, touched, jobs if several else 1, scheduler if several else None)) as parts:
        for part in parts:
            some = [table for table in part.tables if table.num_rows]
            scored |= any("truth" in table["reference"].unique().to_pylist() for table in some)
            if some:
                rows.add(pa.concat_tables(some))
            boards += [] if part.board_rows is None else [part.board_rows]
            for its in part.false:
                key = its.method, its.intrinsics
                false[key] = false[key].joined(its) if key in false else its
            tally.join(part.tally)
            out.circles += part.circles
            off_axis += [] if part.off_axis is None else [part.off_axis]
            done += part.frames
            if progress and several:
                progress(done, len(dataset))
    if not scored:
        raise NotComparableError("nothing to score: the frames that were solved show no disc and no ring")
    matched = _matched(dataset, how, touched)
    out.scores = Scores(rows.finish(), list(false.values()), matched)
    out.board_rows = pa.concat_tables(boards) if boards else None
    out.off_axis = pa.concat_tables(off_axis) if off_axis else None
    out.filled_in = {", ".join(key): list(filled) for key, filled in tally.filled.items() if filled}
    out.caveats = [
        {"method": key[0], "intrinsics": key[1], "caveat": heading, "count": count, "of": tally.detections[key]}
        for key, counts in tally.caveats.items()
        for heading, count in counts.items()
    ]
    return out


def _parts(
    dataset: Dataset, how: ShardScoring, touched: frozenset[str] | None, jobs: int, scheduler: str | None
) -> Generator[_Part, None, None]:
    """The scores of each shard, in order."""
    numbers = range(len(dataset.contents.parts))
    if jobs == 1 and scheduler is None:
        for number in numbers:
            yield _score_part(dataset, how, touched, number)
        return
    died = "the scoring processes died as they started; free some memory, or use fewer --jobs"
    # For workers in other folders.
    files, tolerated = [path.resolve() for path in how.files], frozenset(path.resolve() for path in how.tolerated)
    sent = replace(how, files=files, tolerated=tolerated)
    arguments = dataset.contents.folder.address(), dataset.contents.images_sha256, sent, touched
    with pool_of(min(jobs, len(numbers)), scheduler, _work, _start_worker, arguments, died) as pool:
        for number, part in zip(numbers, pool.in_order(numbers), strict=True):
            if isinstance(part, Lost):
                raise DataError(f"{dataset.address}: shard {number}: {part}; run the command again")
            yield part


# A worker process keeps what all shards share.
_worker: list[Callable[[int], _Part]] = []


def _start_worker(address: str, images_sha256: str, how: ShardScoring, touched: frozenset[str] | None) -> None:
    dataset = open_dataset(address)
    if dataset.contents.images_sha256 != images_sha256:
        raise DataError(f"{address}: changed while it was being scored; run again")
    _worker[:] = [partial(_score_part, dataset, how, touched)]


def _work(number: int) -> _Part:
    with one_blas_thread():
        return _worker[0](number)


def _reference(
    part: Dataset, views: list[BoardView], targets: Targets, camera: Camera | None, label: str
) -> Reference | None:
    """The poses of a shard's chessboards as a second reference; None without boards."""
    ids = set(part.images.frame_ids)
    own = [view for view in views if view.frame_id in ids]
    return reference_of(part, own, targets, camera, label) if own else None


def _matched(dataset: Dataset, how: ShardScoring, touched: frozenset[str] | None) -> Callable[[int], Matched]:
    """The matched ellipses of the shard of a frame, computed again when they are asked for."""
    starts = {}
    for number, part in enumerate(dataset.contents.parts):
        starts[part.shard.frames.start] = number
    ordered = sorted(starts)

    @lru_cache(maxsize=1)
    def of_part(number: int) -> Matched:
        part = dataset.of_part(number)
        runs = read_runs(how.files, part, whole=dataset, tolerated=how.tolerated)
        return match_runs(part, true_targets(part, how.extent_D), runs, touched)

    return lambda frame_id: of_part(starts[max(start for start in ordered if start <= frame_id)])
