"""Outcomes of the league: for each frame of an entry, whether the marker was found, what it says, and the errors.

A frame of the league shows one marker, of one part or several. Detections are assigned to parts by the images of their
centres; the result of the frame is that of its first part that was found.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from roundel.datasets.dataset import Dataset
from roundel.scenes.camera.model import Camera
from roundel.validate.estimates.runs import Run
from roundel.validate.metrics.focal_errors import focal_errors
from roundel.validate.metrics.pose_errors import normal_error_deg
from roundel.validate.scores.readings import identity_of

Array = NDArray[np.float64]

# A detection is the marker if its centre's image is within 3 px or a quarter of the part's radius in the image,
# whichever is larger: as for contours (validate/scores/assignment.py), a bad centre is an error and not a miss.
GATE_PX, GATE_FRACTION = 3.0, 0.25

_NO_ROW, _ELSEWHERE = "there is no row for this frame", "the detections are elsewhere in the image"

OUTCOMES = pa.schema(
    [
        ("entry", pa.string()),
        ("intrinsics", pa.string()),
        ("condition", pa.string()),
        ("variant", pa.string()),
        ("frame_id", pa.int64()),
        ("found", pa.bool_()),
        ("false_detections", pa.int64()),
        ("identity_read", pa.bool_()),
        ("identity_correct", pa.bool_()),
        ("branch_correct", pa.bool_()),
        *(
            (name, pa.float64())
            for name in (
                "normal_error_deg",
                "chosen_normal_error_deg",
                "position_error_pct",
                "focal_error_pct",
                "fused_focal_error_pct",
                "prior_focal_error_pct",
                "time_ms",
            )
        ),
        ("reason", pa.string()),
    ]
)


@dataclass(frozen=True, eq=False)
class FrameTruth:
    """What a frame shows: the parts of its marker, row by row, and the marker's identity (None if it has none)."""

    condition: str
    variant: str
    camera: Camera
    normal: Array
    centre_m: Array
    centre_px: Array
    radius_px: Array
    identity: int | None


def frames_of_league(dataset: Dataset) -> dict[int, FrameTruth]:
    """The frames of a dataset whose groups are named `CONDITION.VARIANT`, by frame_id; others are left out."""
    rows: dict[int, list[dict[str, object]]] = {}
    columns = [*(f"normal_{a}" for a in "xyz"), *(f"centre_{a}_m" for a in "xyz")]
    columns += ["centre_image_x_px", "centre_image_y_px", "contour_x_px", "contour_y_px", "marker_id", "frame_id"]
    for row in dataset.truth.select(columns).to_pylist():
        rows.setdefault(int(row["frame_id"]), []).append(row)
    images, out = dataset.images, {}
    for i, (frame_id, group) in enumerate(zip(images.frame_ids, images.groups, strict=True)):
        condition, dot, variant = group.partition(".")
        parts = sorted(rows.get(frame_id, []), key=lambda row: int(str(row["marker_id"])))
        if not dot or not parts:
            continue
        values = np.array([[row[name] for name in columns[:8]] for row in parts], dtype=np.float64)
        radius = np.array([_radius_px(row["contour_x_px"], row["contour_y_px"]) for row in parts])
        out[frame_id] = FrameTruth(
            condition,
            variant,
            images.camera(i),
            values[:, :3],
            values[:, 3:6],
            values[:, 6:8],
            radius,
            identity_of(images.markers(i)[0]),
        )
    return out


def _radius_px(x: object, y: object) -> float:
    """Radius of the disc with the area that a contour encloses (the shoelace formula)."""
    u, v = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    return float(np.sqrt(abs(u @ np.roll(v, -1) - v @ np.roll(u, -1)) / 2 / np.pi))


def outcomes_of(
    entry: str,
    variants: tuple[str, ...],
    run: Run,
    truth: dict[int, FrameTruth],
    time_ms: dict[int, float] | None = None,
) -> pa.Table:
    """Outcomes of an entry on every frame of its variants, in the order of the frames.

    Parameters
    ----------
    entry : str
    variants : tuple of str
    run : Run
        Its estimates; a frame without a row was not found.
    truth : dict
        See `frames_of_league`.
    time_ms : dict, optional
        Time of each frame.
    """
    by_frame: dict[int, list[int]] = {}
    for row, frame in enumerate(run.frame_id.tolist()):
        by_frame.setdefault(frame, []).append(row)
    rows = []
    for frame_id, shown in truth.items():
        if shown.variant in variants:
            its = np.array(by_frame.get(frame_id, []), dtype=np.int64)
            outcome = _outcome(run, its, shown)
            about = {"entry": entry, "intrinsics": run.intrinsics, "frame_id": frame_id}
            about |= {"condition": shown.condition, "variant": shown.variant}
            rows.append({**about, **outcome, "time_ms": (time_ms or {}).get(frame_id)})
    return pa.Table.from_pylist(rows, schema=OUTCOMES)


def _outcome(run: Run, rows: NDArray[np.int64], shown: FrameTruth) -> dict[str, object]:
    detections: dict[int, list[int]] = {}
    for row in rows.tolist():
        if run.ok[row]:
            detections.setdefault(int(run.detection_id[row]), []).append(row)
    found = list(detections.values())
    part, mine = _assigned(run, found, shown)
    false = len(found) - len(mine)
    out: dict[str, object] = {"found": bool(mine), "false_detections": false}
    row = found[mine[0]][0] if mine else -1
    measured = (float(run.focal_px[row]), float(run.focal_sigma_px[row])) if mine else (np.nan, np.nan)
    focal = focal_errors(*measured, shown.camera)
    # The prior's error only where it can be compared: on a frame with a measured focal length.
    prior = focal.prior if np.isfinite(focal.measured) else np.nan
    for name, value in (("", focal.measured), ("fused_", focal.fused), ("prior_", prior)):
        out[f"{name}focal_error_pct"] = value if np.isfinite(value) else None
    if not mine:
        reasons = [run.reason[row] for row in rows.tolist() if run.reason[row]]
        return out | {"reason": reasons[0] if reasons else _NO_ROW if not len(rows) else _ELSEWHERE}
    candidates = np.array(found[mine[0]])
    out |= _pose_errors(run, candidates, shown, part)
    identity = run.identity[row]
    if shown.identity is not None:
        out["identity_read"] = bool(np.isfinite(identity))
        out["identity_correct"] = bool(identity == shown.identity) if np.isfinite(identity) else None
    return out


def _assigned(run: Run, found: list[list[int]], shown: FrameTruth) -> tuple[int, list[int]]:
    """The first part that was found, and the detections that are parts of the marker, that part's first."""
    if not found:
        return -1, []
    centre = np.array([_centre_px(run, rows) for rows in found])
    away = np.linalg.norm(centre[None] - shown.centre_px[:, None], axis=-1)
    gate = np.fmax(GATE_PX, GATE_FRACTION * shown.radius_px)
    allowed = away <= gate[:, None]
    pairs = zip(*linear_sum_assignment(np.where(allowed, away, 1e9)), strict=True)
    kept = sorted((int(i), int(j)) for i, j in pairs if allowed[i, j])
    return (kept[0][0] if kept else -1), [j for _, j in kept]


def _centre_px(run: Run, rows: list[int]) -> Array:
    """Image of a detection's centre: that of its chosen pose, or its first; without one, the centre of its ellipse."""
    meant = next((row for row in rows if run.chosen[row]), rows[0])
    centre = run.centre_px[meant]
    return centre if np.isfinite(centre).all() else run.ellipse[meant, :2]


def _pose_errors(run: Run, rows: NDArray[np.int64], shown: FrameTruth, part: int) -> dict[str, object]:
    posed = rows[run.posed[rows]]
    if not len(posed):
        return {}
    error = normal_error_deg(run.normal[posed], shown.normal[part])
    better = int(np.argmin(error))
    truth = shown.centre_m[part]
    away = float(np.linalg.norm(run.centre_m[posed[better]] - truth) / np.linalg.norm(truth))
    chosen = np.flatnonzero(run.chosen[posed])
    out: dict[str, object] = {"normal_error_deg": float(error[better]), "position_error_pct": 100 * away}
    if len(chosen):
        out["chosen_normal_error_deg"] = float(error[chosen[0]])
        # Not by the other pose: a method that gives one pose has chosen, too.
        mirrored = _mirrored(shown.normal[part], truth)
        out["branch_correct"] = bool(error[chosen[0]] < normal_error_deg(run.normal[posed[chosen[0]]], mirrored))
    return out


def _mirrored(normal: Array, centre_m: Array) -> Array:
    """The normal mirrored at the line of sight, near which the wrong pose of a circle lies: 2 (n.s) s - n."""
    sight = centre_m / np.linalg.norm(centre_m)
    return np.asarray(2.0 * (normal @ sight) * sight - normal)
