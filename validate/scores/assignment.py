"""Assignment of detections to markers by nearest contour, or nearest centre, one to one.

The solver does not know a marker's identity. Both kinds of unmatched items are outcomes: a missed marker, and a false
positive.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from roundel.scenes.camera.model import Camera
from roundel.validate.estimates.runs import Run
from roundel.validate.metrics.ground_truth import Targets, columns_of
from roundel.validate.metrics.pose_errors import contour_error_px

Array = NDArray[np.float64]

# A detection matches a marker if the mean distance of its contour is within 3 px or a quarter of the true ellipse's
# semi-minor axis, whichever is larger: a bad fit of the right contour is an error, not a miss.
GATE_PX = 3.0
GATE_FRACTION = 0.25

# Directions in which the width of a bent contour is measured: 1 % of it at most is missed.
_DIRECTIONS = 16

# Pairs compared at once, which limits the memory to about 100 MB.
_CHUNK = 8192


@dataclass(frozen=True)
class Match:
    """The assignment of targets and detections.

    Attributes
    ----------
    rows : (N, 2) int array
        Row of candidate 0 and 1 of the target's detection in the run; -1 if there is none.
    reason : list of str
        Why a target has no pose; empty if it has one.
    contour_error_px : (N,) array
        Of the matched detection.
    detections : int
        All detections with a pose, an ellipse or a centre.
    false_rows : list of int
        First row in the run of each detection that matches no target.
    """

    rows: NDArray[np.int64]
    reason: list[str]
    contour_error_px: Array
    detections: int
    false_rows: list[int] = field(default_factory=list)


def match(targets: Targets, run: Run) -> Match:
    """Assign the detections of a run to the targets, frame by frame."""
    count = len(targets.frame_id)
    rows = np.full((count, 2), -1)
    reason = [""] * count
    error = np.full(count, np.nan)
    by_frame = _first_rows(run)
    target_frames = _positions(targets.frame_id)
    with_pose = {f: [r for r in firsts if run.ok[r]] for f, firsts in by_frame.items()}
    pairs = [(t, d) for f, ts in target_frames.items() for t in ts for d in with_pose.get(f, [])]
    cost = contour_errors(targets, run, pairs)
    gate = gates_px(targets)
    position = 0
    for frame, ts in target_frames.items():
        ds = with_pose.get(frame, [])
        if not ds:
            for t in ts:
                reason[t] = _why_nothing(run, by_frame.get(frame))
            continue
        block = cost[position : position + len(ts) * len(ds)].reshape(len(ts), len(ds))
        position += block.size
        # Pairs outside the gate get a prohibitive cost, so the number of matches is maximal.
        allowed = block <= gate[ts][:, None]
        for i, j in zip(*linear_sum_assignment(np.where(allowed, block, 1e9)), strict=True):
            if allowed[i, j]:
                first = ds[j]
                rows[ts[i], run.candidate[first]] = first
                if first + 1 < len(run.ok) and _same_detection(run, first) and run.ok[first + 1]:
                    rows[ts[i], run.candidate[first + 1]] = first + 1
                error[ts[i]] = block[i, j]
        for i, t in enumerate(ts):
            if rows[t].max() < 0:
                nearest = np.min(block[i], initial=np.inf, where=np.isfinite(block[i]))
                found = "1 detection" if len(ds) == 1 else f"the nearest of {len(ds)} detections"
                reason[t] = (
                    f"{found}, {nearest:.1f} px from the contour" if np.isfinite(nearest) else "contour out of view"
                )
    used = {int(r) for pair in rows for r in pair if r >= 0}
    false = [d for ds in with_pose.values() for d in ds if d not in used]
    return Match(rows, reason, error, sum(map(len, with_pose.values())), false)


def gates_px(targets: Targets) -> Array:
    """The largest distance (N,) of a matching contour from each target."""
    return np.asarray(np.maximum(GATE_PX, GATE_FRACTION * _semi_minor_px(targets)))


def _semi_minor_px(targets: Targets) -> Array:
    """Semi-minor axes (N,) of the true ellipses; of a circle on bent paper half the least width of its contour."""
    semi = targets.ellipse[:, 3].copy()
    bent = np.flatnonzero(np.isnan(semi) & np.isfinite(targets.contour_px).all(axis=(1, 2)))
    turn = np.linspace(0.0, np.pi, _DIRECTIONS, endpoint=False)
    extent = np.ptp(targets.contour_px[bent] @ np.stack([np.cos(turn), np.sin(turn)]), axis=1)
    semi[bent] = extent.min(axis=1) / 2 if len(bent) else semi[bent]
    return semi


def _positions(frame_id: NDArray[np.int64]) -> dict[int, list[int]]:
    out: dict[int, list[int]] = {}
    for position, frame in enumerate(frame_id.tolist()):
        out.setdefault(frame, []).append(position)
    return out


def _same_detection(run: Run, row: int) -> bool:
    """Whether the next row is the other candidate of the same detection."""
    return bool(run.frame_id[row] == run.frame_id[row + 1] and run.detection_id[row] == run.detection_id[row + 1])


def _first_rows(run: Run) -> dict[int, list[int]]:
    """First row of each detection (or of the frame's single failure), by frame; rows are sorted."""
    starts = np.ones(len(run.frame_id), dtype=bool)
    starts[1:] = (np.diff(run.frame_id) != 0) | (np.diff(run.detection_id) != 0)
    out: dict[int, list[int]] = {}
    for row in np.flatnonzero(starts).tolist():
        # If candidate 0 failed and candidate 1 did not, the detection is represented by the latter.
        if not run.ok[row] and row + 1 < len(run.ok) and not starts[row + 1] and run.ok[row + 1]:
            row += 1
        out.setdefault(int(run.frame_id[row]), []).append(row)
    return out


def _why_nothing(run: Run, firsts: list[int] | None) -> str:
    if firsts is None:
        return "the estimates have no row for this frame"
    return next((run.reason[r] for r in firsts if run.reason[r]), "no pose, and no reason given")


def contour_errors(targets: Targets, run: Run, pairs: list[tuple[int, int]]) -> Array:
    """Contour error of each (target, row) pair, grouped by camera; infinite if there is none.

    For a row without an ellipse, the distance between its centre's image and the true one.
    """
    out = np.full(len(pairs), np.inf)
    if not pairs:
        return out
    target, row = np.array(pairs).T
    for index, where in groups_of(run.camera[row]):
        for part in np.array_split(where, max(1, -(-len(where) // _CHUNK))):
            camera: Camera = run.cameras[index]
            value = contour_error_px(targets.contour_px[target[part]], run.ellipse[row[part]], camera)
            out[part] = np.where(np.isfinite(value), value, np.inf)
    # Without an ellipse, the point is compared with the image of the circle's centre.
    bare = np.flatnonzero(np.isnan(run.ellipse[row, 0]))
    if len(bare):
        true = columns_of(targets.truth, ["centre_image_x_px", "centre_image_y_px"])[target[bare]]
        away = np.linalg.norm(run.centre_px[row[bare]] - true, axis=-1)
        out[bare] = np.where(np.isfinite(away), away, np.inf)
    return out


def groups_of(labels: NDArray[np.int64]) -> list[tuple[int, NDArray[np.int64]]]:
    """Positions of each label, in the order of the labels."""
    if not len(labels):
        return []
    order = np.argsort(labels, kind="stable")
    values, starts = np.unique(labels[order], return_index=True)
    return list(zip(values.tolist(), np.split(order, starts[1:]), strict=True))
