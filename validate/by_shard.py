"""Scores of a dataset, shard by shard: memory holds one shard, and the rows of scores.parquet."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import pyarrow as pa

from roundel.datasets.dataset import Dataset
from roundel.scenes.camera.model import Camera
from roundel.scenes.errors import NotComparableError
from roundel.solver.caveats import count_caveats
from roundel.validate.calibration.chessboard_reference import Reference, reference_of
from roundel.validate.calibration.opencv import BoardView
from roundel.validate.claims.calibration_benefit import off_axis_deg
from roundel.validate.estimates.runs import Run, read_runs, touched_groups
from roundel.validate.metrics.ground_truth import Targets, true_targets
from roundel.validate.scores.scores import FalseDetections, Matched, Scores, match_runs, score, sorted_scores


@dataclass
class ShardScores:
    """What the shards' scores add up to.

    Attributes
    ----------
    scores : Scores
        Against the truth and against the chessboards, and the chessboards' own poses.
    circles : int
        True circles.
    off_axis_deg : dict
        By (frame_id, marker_id), see `calibration_benefit`; empty if no run is calibrated.
    board_rows : pyarrow.Table or None
        Scores of circles by the boards beside them.
    filled_in : dict
        Defaults that were used, by run.
    caveats : list of dict
        The detections of each run by kind of caveat.
    """

    scores: Scores
    circles: int = 0
    off_axis_deg: dict[tuple[int, int], float] = field(default_factory=dict)
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


def score_by_shard(
    dataset: Dataset,
    files: list[Path],
    extent_D: float,
    views: list[BoardView],
    camera: Camera | None,
    label: str,
    progress: Callable[[int, int], None] | None = None,
) -> ShardScores:
    """Score estimates of a dataset.

    Parameters
    ----------
    dataset : Dataset
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
    progress : callable, optional
        Called with (frames done, total frames).

    Raises
    ------
    NotComparableError
        If there is nothing to score.
    """
    # Of a single shard the runs themselves tell.
    touched = touched_groups(files, dataset) if len(dataset.contents.parts) > 1 else None
    tables: list[pa.Table] = []
    boards: list[pa.Table] = []
    false: dict[tuple[str, str], FalseDetections] = {}
    tally, out = _Tally(), ShardScores(Scores(pa.table({})))
    done = 0
    for number in range(len(dataset.contents.parts)):
        part = dataset.of_part(number)
        runs = read_runs(files, part, whole=dataset)
        targets = true_targets(part, extent_D)
        reference = _reference(part, views, targets, camera, label)
        found = score(part, targets, runs, reference.circles if reference else None, touched)
        tables.append(found.table)
        for its in found.false_detections:
            _add(false, its)
        for run in runs:
            tally.add(run)
        out.circles += len(targets)
        if any("calibrated" in run.intrinsics for run in runs):
            out.off_axis_deg |= off_axis_deg(targets.truth)
        if reference is not None:
            tables.append(reference.rows)
            boards += [reference.circle_rows] if reference.circle_rows is not None else []
        done += len(part)
        if progress and len(dataset.contents.parts) > 1:
            progress(done, len(dataset))
    tables = [table for table in tables if table.num_rows]
    if not any("truth" in table["reference"].unique().to_pylist() for table in tables):
        raise NotComparableError("nothing to score: the frames that were solved show no disc and no ring")
    out.scores = Scores(
        sorted_scores(pa.concat_tables(tables)), list(false.values()), _matched(dataset, files, extent_D, touched)
    )
    out.board_rows = pa.concat_tables(boards) if boards else None
    out.filled_in = {", ".join(key): list(filled) for key, filled in tally.filled.items() if filled}
    out.caveats = [
        {"method": key[0], "intrinsics": key[1], "caveat": heading, "count": count, "of": tally.detections[key]}
        for key, counts in tally.caveats.items()
        for heading, count in counts.items()
    ]
    return out


def _reference(
    part: Dataset, views: list[BoardView], targets: Targets, camera: Camera | None, label: str
) -> Reference | None:
    """The poses of a shard's chessboards as a second reference; None without boards."""
    ids = set(part.images.frame_ids)
    own = [view for view in views if view.frame_id in ids]
    return reference_of(part, own, targets, camera, label) if own else None


def _add(false: dict[tuple[str, str], FalseDetections], its: FalseDetections) -> None:
    key = its.method, its.intrinsics
    before = false.get(key, FalseDetections(*key, 0, 0, []))
    false[key] = FalseDetections(
        *key, before.detections + its.detections, before.count + its.count, before.frame_ids + its.frame_ids
    )


def _matched(
    dataset: Dataset, files: list[Path], extent_D: float, touched: frozenset[str] | None
) -> Callable[[int], Matched]:
    """The matched ellipses of the shard of a frame, computed again when they are asked for."""
    starts = {}
    for number, part in enumerate(dataset.contents.parts):
        starts[part.shard.frames.start] = number
    ordered = sorted(starts)

    @lru_cache(maxsize=1)
    def of_part(number: int) -> Matched:
        part = dataset.of_part(number)
        return match_runs(part, true_targets(part, extent_D), read_runs(files, part, whole=dataset), touched)

    return lambda frame_id: of_part(starts[max(start for start in ordered if start <= frame_id)])
