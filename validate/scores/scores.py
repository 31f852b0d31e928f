"""Scores: one row for every true circle, method, intrinsics and reference, solved or not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from roundel.datasets.dataset import Dataset
from roundel.scenes.camera.model import distort_px, project
from roundel.validate.estimates.runs import Run
from roundel.validate.metrics.bop import mspd_px, mssd_m
from roundel.validate.metrics.cramer_rao import Bounds, bounds_of
from roundel.validate.metrics.ground_truth import Targets
from roundel.validate.metrics.metric import ELLIPSE_METRICS, POSE_METRICS
from roundel.validate.metrics.pose_errors import (
    contour_error_px,
    ellipse_centre_offset_px,
    normal_error_deg,
    pose_error_bounds,
    position_errors,
    reprojection_error_px,
)
from roundel.validate.metrics.rows import Rows
from roundel.validate.metrics.sweeps import COLUMNS as SWEEP
from roundel.validate.metrics.uncertainty import uncertainty_scores
from roundel.validate.scores.assignment import groups_of, match
from roundel.validate.scores.candidates import Candidates, candidates_take, matched_candidates
from roundel.validate.scores.false_positives import FalseDetections, false_detections
from roundel.validate.scores.readings import READINGS, identity_of, with_readings

Array = NDArray[np.float64]

KEY = ("frame_id", "marker_id", "method", "intrinsics", "reference")

# The frame's own variables, and their names in the truth.
VARIABLES: dict[str, str] = {
    **{n: n for n in ("distance_m", "distance_D", "tilt_deg", "azimuth_deg")},
    "image_x_px": "centre_image_x_px",
    "image_y_px": "centre_image_y_px",
    **{n: n for n in ("edge_contrast_dn", "edge_noise_dn", "edge_blur_px")},
}

# The offset of the ellipse's centre by coordinate; its mean shows a shift common to all frames.
SIGNED = ("ellipse_centre_x_error_px", "ellipse_centre_y_error_px")
BOUNDS = ("normal_bound_deg", "position_bound_m", "ellipse_centre_bound_px")
# What a method says of its own error, of the chosen candidate and of the oracle's; null without a covariance.
UNCERTAINTY = ("pose_chi2", "pose_log_score", "normal_sigma_deg", "position_sigma_m", "depth_sigma_m")

SCORES_SCHEMA = pa.schema(
    [
        ("frame_id", pa.int64()),
        ("marker_id", pa.int64()),
        *[(name, pa.string()) for name in ("method", "intrinsics", "reference", "group", "kind")],
        *[(name, pa.float64()) for name in VARIABLES],
        ("sweep_level", pa.float64()),
        ("sweep_frame", pa.int64()),
        ("detected", pa.bool_()),
        ("solved", pa.bool_()),
        ("reason", pa.string()),
        *[(name, pa.float64()) for name in POSE_METRICS],
        *[(f"oracle_{name}", pa.float64()) for name in POSE_METRICS],
        *[(name, pa.float64()) for name in (*ELLIPSE_METRICS, *SIGNED)],
        *[(name, pa.float64()) for name in BOUNDS],
        *[(name, pa.float64()) for name in UNCERTAINTY],
        *[(f"oracle_{name}", pa.float64()) for name in UNCERTAINTY],
        ("branch_correct", pa.bool_()),
        ("likelier_probability", pa.float64()),
        ("likelier_correct", pa.bool_()),
        ("oracle_branch_correct", pa.bool_()),
        ("confidence", pa.float64()),
        *READINGS.items(),
    ]
)


@dataclass(frozen=True)
class Scores:
    """The table of scores.parquet, and data that it does not contain: false positives and the matched ellipses.

    `matched(frame_id)` has every expected circle and its candidates, row by row, at least of that frame.
    """

    table: Rows
    false_detections: list[FalseDetections] = field(default_factory=list)
    matched: Callable[[int], Matched] = field(default=lambda frame_id: {})


# Expected circles and their candidates, by method and intrinsics.
Matched = dict[tuple[str, str], tuple[Targets, Candidates]]


def match_runs(dataset: Dataset, targets: Targets, runs: list[Run], touched: frozenset[str] | None = None) -> Matched:
    """The expected circles of each run with its candidates; see `score`."""
    matched = {}
    for run in runs:
        mine = targets.take(np.flatnonzero(_expected(dataset, targets, run, touched)))
        matched[run.method, run.intrinsics] = mine, matched_candidates(match(mine, run), run)
    return matched


def score(
    dataset: Dataset,
    targets: Targets,
    runs: list[Run],
    board: Targets | None = None,
    touched: frozenset[str] | None = None,
) -> Scores:
    """Score runs against the truth, and against the chessboard if there is one.

    Parameters
    ----------
    dataset : Dataset
        Its study gives the groups to solve.
    targets : Targets
        Every true circle.
    runs : list of Run
    board : Targets, optional
        As `targets`, with poses from the chessboard; rows of frames without a board are missing, identified by
        marker_id and frame_id.
    touched : frozenset of str, optional
        Groups of which any run has frames, where this is a shard of several; default: those of the runs.
    """
    tables, false = [], []
    matched: Matched = {}
    every, identities = bounds_of(dataset, targets), _identities(dataset)
    group_of = dict(zip(dataset.images.frame_ids, dataset.images.groups, strict=True))
    for run in runs:
        expected = np.flatnonzero(_expected(dataset, targets, run, touched))
        mine, bounds = targets.take(expected), every.take(expected)
        found = match(mine, run)
        candidates = matched_candidates(found, run)
        matched[run.method, run.intrinsics] = mine, candidates
        scored = score_rows(mine, candidates, found.reason, run.method, run.intrinsics, "truth", bounds)
        tables.append(with_readings(scored, run, found.rows, mine, identities))
        if board is not None:
            rows = _same_markers(mine, board)
            if len(rows):
                placed = board.take(_same_markers(board, mine))
                reason = [found.reason[i] for i in rows.tolist()]
                tables.append(
                    score_rows(
                        placed, candidates_take(candidates, rows), reason, run.method, run.intrinsics, "chessboard"
                    )
                )
        false.append(false_detections(run, found.detections, found.false_rows, group_of))
    return Scores(sorted_scores(pa.concat_tables([SCORES_SCHEMA.empty_table(), *tables])), false, lambda _: matched)


def sorted_scores(table: pa.Table) -> pa.Table:
    """Rows in the order of the key, in one chunk: the same bytes for the same scores."""
    return table.sort_by([(name, "ascending") for name in KEY]).combine_chunks()


def _expected(dataset: Dataset, targets: Targets, run: Run, touched: frozenset[str] | None) -> NDArray[np.bool_]:
    """Expected circles of a run: those of the groups that the study solves, and of any group in the run.

    A frame of such a group without a row counts as not solved, so that leaving out hard frames gives no advantage.
    """
    group = np.array(targets.truth["group"].to_pylist(), dtype=object)
    solve = dataset.study.get("solve") or {}
    asked = solve.get("groups")
    if not asked:
        return np.ones(len(group), dtype=bool)
    if touched is None:
        of_frame = dict(zip(dataset.images.frame_ids, dataset.images.groups, strict=True))
        touched = frozenset(of_frame[f] for f in np.unique(run.frame_id).tolist())
    return np.isin(group, sorted(touched | set(asked)))


def _identities(dataset: Dataset) -> dict[tuple[int, int], int]:
    """Identities of the printed markers that have one, by frame_id and marker_id."""
    images = dataset.images
    every = ((f, m) for i, f in enumerate(images.frame_ids) for m in images.markers(i))
    found = {(f, int(m["marker_id"])): identity_of(m) for f, m in every}
    return {key: identity for key, identity in found.items() if identity is not None}


def _same_markers(a: Targets, b: Targets) -> NDArray[np.int64]:
    """Positions in `a` of the circles that are also in `b`; both are sorted by frame and marker."""
    known = set(zip(b.frame_id.tolist(), b.marker_id.tolist(), strict=True))
    keys = zip(a.frame_id.tolist(), a.marker_id.tolist(), strict=True)
    return np.array([i for i, key in enumerate(keys) if key in known], dtype=np.int64)


def score_rows(
    targets: Targets,
    candidates: Candidates,
    reason: list[str],
    method: str,
    intrinsics: str,
    reference: str,
    bounds: Bounds | None = None,
) -> pa.Table:
    """Rows of scores.parquet for one run against one reference.

    The oracle is the candidate nearer to the truth, the one with the smaller normal error, for every metric. If no
    candidate was chosen, the chosen metrics and `branch_correct` are null.
    """
    n, columns = len(targets), np.arange(len(targets))
    solved = candidates.has.any(axis=1)
    placed = targets.placed
    values = _pose_metrics(targets, candidates, placed, bounds)
    # A detection without a pose outranks no detection.
    nothing = np.where(candidates.detected(), 1e9, np.inf)
    error = np.where(np.isnan(values["normal_error_deg"]), nothing, values["normal_error_deg"])
    oracle = np.argmin(error, axis=1)
    chosen = np.argmax(candidates.chosen, axis=1)
    values |= _symmetric_metrics(targets, candidates, candidates.chosen | (np.arange(2) == oracle[:, None]))
    is_chosen = candidates.chosen.any(axis=1) & placed
    single = candidates.has.sum(axis=1) == 1
    # A single candidate is right if it is nearer to the true normal than to that of the second solution.
    nearer = normal_error_deg(candidates.normal[columns, chosen], targets.camera_from_marker[:, :3, 2]) <= (
        normal_error_deg(candidates.normal[columns, chosen], targets.other_normal)
    )
    correct = np.where(single, nearer, chosen == oracle)
    ellipse = _ellipse_metrics(targets, candidates)
    bare_rows = np.asarray(candidates.detected().any(axis=1) & ~solved)
    lost = "" if reference == "truth" else "no reference: the chessboard was not found"
    truth = targets.truth
    data: dict[str, Any] = {
        "frame_id": targets.frame_id,
        "marker_id": targets.marker_id,
        "method": [method] * n,
        "intrinsics": [intrinsics] * n,
        "reference": [reference] * n,
        "group": truth["group"].to_pylist(),
        "kind": truth["kind"].to_pylist(),
        **{name: truth[source].combine_chunks() for name, source in VARIABLES.items()},
        **{name: truth[name].combine_chunks() for name in SWEEP},
        "detected": candidates.detected().any(axis=1),
        "solved": solved,
        "reason": [
            why or (lost if not there else "found, but without a pose" if bare else "")
            for why, there, bare in zip(reason, placed, bare_rows, strict=True)
        ],
        **{name: _nullable(np.where(is_chosen, v[columns, chosen], np.nan)) for name, v in values.items()},
        **{f"oracle_{name}": _nullable(v[columns, oracle]) for name, v in values.items()},
        **{name: _nullable(v) for name, v in ellipse.items()},
        **{name: _nullable(v) for name, v in zip(BOUNDS, _bounds(bounds, n), strict=True)},
        **_uncertainty(targets, candidates, {"": (chosen, is_chosen), "oracle_": (oracle, placed)}, reference),
        "branch_correct": pa.array(
            correct, mask=~is_chosen | ~solved | (single & np.isnan(targets.other_normal[:, 0]))
        ),
    }
    likelier, stated = _likelier(candidates, placed)
    data["likelier_probability"] = _nullable(stated)
    data["likelier_correct"] = pa.array(likelier == oracle, mask=~np.isfinite(stated))
    data["oracle_branch_correct"] = _beside_truth(targets, candidates, oracle, single, placed & solved)
    data["confidence"] = _nullable(candidates.stated_confidence())
    data |= {name: [None] * n for name in READINGS}
    return pa.table([pa.array(data[f.name], type=f.type) for f in SCORES_SCHEMA], schema=SCORES_SCHEMA)


def _beside_truth(
    targets: Targets,
    candidates: Candidates,
    oracle: NDArray[np.int64],
    single: NDArray[np.bool_],
    there: NDArray[np.bool_],
) -> pa.Array:
    """Whether the oracle lies beside the true pose: false for a single pose beside the second solution.

    Null without a pose, or for a single pose of a circle that has no second solution.
    """
    normal = candidates.normal[np.arange(len(targets)), oracle]
    true, other = (normal_error_deg(normal, v) for v in (targets.camera_from_marker[:, :3, 2], targets.other_normal))
    return pa.array(~single | (true <= other), mask=~there | (single & np.isnan(other)))


def _likelier(candidates: Candidates, placed: NDArray[np.bool_]) -> tuple[NDArray[np.int64], Array]:
    """The likelier of two candidates by the method, and its probability; NaN without two, or if both are as likely."""
    n = len(candidates.has)
    if candidates.probability is None:
        return np.zeros(n, dtype=np.int64), np.full(n, np.nan)
    stated = candidates.probability
    both = candidates.has.all(axis=1) & placed & np.isfinite(stated).all(axis=1) & (stated[:, 0] != stated[:, 1])
    likelier = np.argmax(np.where(np.isfinite(stated), stated, -1.0), axis=1)
    return likelier, np.where(both, stated[np.arange(n), likelier], np.nan)


def _uncertainty(
    targets: Targets,
    candidates: Candidates,
    which: dict[str, tuple[NDArray[np.int64], NDArray[np.bool_]]],
    reference: str,
) -> dict[str, pa.Array]:
    """Columns of `UNCERTAINTY`, by prefix; empty against a reference that has an error of its own."""
    rows = np.arange(len(targets))
    out: dict[str, pa.Array] = {}
    for prefix, (candidate, there) in which.items():
        values = np.full((len(UNCERTAINTY), len(targets)), np.nan)
        if candidates.covariance is not None and reference == "truth":
            estimate = (v[rows, candidate] for v in (candidates.normal, candidates.centre_m, candidates.covariance))
            found = uncertainty_scores(targets.camera_from_marker, *estimate)
            named = (found.chi2, found.log_score, found.normal_sigma_deg, found.position_sigma_m, found.depth_sigma_m)
            values = np.where(there, np.stack(named), np.nan)
        out |= {f"{prefix}{name}": _nullable(v) for name, v in zip(UNCERTAINTY, values, strict=True)}
    return out


def _bounds(bounds: Bounds | None, n: int) -> tuple[Array, Array, Array]:
    """Columns of `BOUNDS`; a chessboard's pose has no bounds, because they are those of a circle."""
    if bounds is None:
        nothing = np.full(n, np.nan)
        return nothing, nothing, nothing
    return bounds.normal_deg, bounds.position_m, bounds.ellipse_centre_px


def _nullable(values: Array) -> pa.Array:
    return pa.array(values, mask=~np.isfinite(values), type=pa.float64())


def _pose_metrics(
    targets: Targets, candidates: Candidates, placed: NDArray[np.bool_], bounds: Bounds | None
) -> dict[str, Array]:
    pose = targets.camera_from_marker
    normal = normal_error_deg(candidates.normal, pose[:, None, :3, 2])
    position = position_errors(candidates.centre_m, pose[:, None, :3, 3], targets.diameter_m[:, None])
    information = np.full((len(targets), 5, 5), np.nan) if bounds is None else bounds.information
    reprojection = np.full(candidates.has.shape, np.nan)
    row, which = np.nonzero(candidates.has & placed[:, None])
    for index, where in groups_of(targets.camera[row]):
        for used, part in groups_of(candidates.camera[row[where], which[where]]):
            i, k = row[where[part]], which[where[part]]
            reprojection[i, k] = reprojection_error_px(
                pose[i],
                targets.cameras[index],
                candidates.normal[i, k],
                candidates.centre_m[i, k],
                candidates.cameras[used],
                targets.extent_m[i],
            )
    centre = np.full(candidates.has.shape, np.nan)
    row, which = np.nonzero(candidates.detected() & placed[:, None])
    for index, where in groups_of(targets.camera[row]):
        for used, part in groups_of(candidates.camera[row[where], which[where]]):
            i, k = row[where[part]], which[where[part]]
            image = project(candidates.cameras[used], candidates.centre_m[i, k])
            if candidates.centre_px is not None:
                image = np.where(candidates.has[i, k][:, None], image, candidates.centre_px[i, k])
            centre[i, k] = np.linalg.norm(image - project(targets.cameras[index], pose[i, :3, 3]), axis=-1)
    return {
        "normal_error_deg": normal,
        "position_error_m": position.absolute_m,
        "position_error_D": position.in_D,
        "position_error_pct": position.percent,
        "along_ray_m": position.along_ray_m,
        "across_ray_m": position.across_ray_m,
        "reprojection_error_px": reprojection,
        "centre_image_error_px": centre,
        "pose_error_bounds": pose_error_bounds(
            pose[:, None], candidates.normal, candidates.centre_m, information[:, None]
        ),
    }


def _symmetric_metrics(targets: Targets, candidates: Candidates, wanted: NDArray[np.bool_]) -> dict[str, Array]:
    """BOP's two metrics for the wanted candidates only, because the search for the best rotation is slow."""
    space, image = np.full(wanted.shape, np.nan), np.full(wanted.shape, np.nan)
    circle = targets.placed & np.isfinite(targets.diameter_m)
    row, which = np.nonzero(wanted & candidates.has & circle[:, None])
    for index, where in groups_of(targets.camera[row]):
        i, k = row[where], which[where]
        estimate = candidates.normal[i, k], candidates.centre_m[i, k], targets.diameter_m[i] / 2
        space[i, k] = mssd_m(targets.camera_from_marker[i], *estimate)
        image[i, k] = mspd_px(targets.camera_from_marker[i], targets.cameras[index], *estimate)
    return {"mssd_m": space, "mspd_px": image}


def _ellipse_metrics(targets: Targets, candidates: Candidates) -> dict[str, Array]:
    """Both candidates have the same ellipse, so that of the first existing one is used."""
    n, first = len(targets), np.argmax(candidates.detected(), axis=1)
    offset, contour = np.full((n, 2), np.nan), np.full(n, np.nan)
    every, detected = np.arange(n), candidates.detected().any(axis=1)
    outlined = detected & np.isfinite(candidates.ellipse[every, first]).all(axis=1)
    if candidates.centre_px is not None:
        # A centre without a pose is also compared with that of the ellipse, because the two are often confused.
        point = candidates.centre_px[every, first]
        for index, i in groups_of(np.where(detected & ~outlined, targets.camera, -1)):
            if index >= 0:
                offset[i] = point[i] - distort_px(targets.cameras[index], targets.ellipse[i, :2])
    rows = np.flatnonzero(outlined)
    for index, where in groups_of(targets.camera[rows]):
        for used, part in groups_of(candidates.camera[rows[where], first[rows[where]]]):
            i = rows[where[part]]
            ellipse, camera = candidates.ellipse[i, first[i]], candidates.cameras[used]
            offset[i] = ellipse_centre_offset_px(targets.ellipse[i], targets.cameras[index], ellipse, camera)
            for chunk in np.array_split(np.arange(len(i)), max(1, len(i) // 8192)):
                contour[i[chunk]] = contour_error_px(targets.contour_px[i[chunk]], ellipse[chunk], camera)
    centre = np.linalg.norm(offset, axis=-1)
    signed = dict(zip(SIGNED, offset.T, strict=True))
    return {"ellipse_centre_error_px": centre, "contour_error_px": contour, **signed}
