"""Scores of made-up methods for the gate: an efficient solver, in groups, with one pose a circle or two."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from roundel.validate.gate.baseline import Baseline
from roundel.validate.gate.gate import GateResult

Array = NDArray[np.float64]


def method_scores(
    seed: int,
    n: int = 3250,
    groups: int = 1,
    scale: Array | float = 1.0,
    normal_scale: float = 1.0,
    wrong: Array | None = None,
    images: str = "",
) -> Baseline:
    """A solver at its bounds: five components of each error are standard normal, in units of the frame's own bound.

    Parameters
    ----------
    seed : int
        Of the noise; frames differ in difficulty, the same at every seed.
    n, groups : int
        Circles, one a frame, in groups of the same size.
    scale : float or (n,) array
        Of all errors.
    normal_scale : float
        Of those of the normal alone.
    wrong : (n,) array of bool, optional
        One pose a circle: where it lies beside the second solution, some tens of degrees away.
    images : str
        Identity of the images; default: others at each seed.
    """
    easy = np.random.default_rng([0, 0])
    difficulty, away = easy.uniform(0.01, 0.1, n), easy.uniform(20.0, 90.0, n)
    noise = np.random.default_rng(seed).normal(size=(n, 5)) * np.broadcast_to(scale, n)[:, None]
    noise[:, :2] *= normal_scale
    normal = np.linalg.norm(noise[:, :2], axis=1) * difficulty
    pose = np.linalg.norm(noise, axis=1) / 5**0.5
    single = np.zeros(n, dtype=bool) if wrong is None else wrong
    normal, pose = np.where(single, away, normal), np.where(single, away / difficulty, pose)
    xy = noise[:, 3:] * difficulty[:, None] * 0.1

    def numbers(values: Array) -> pa.Array:
        return pa.array(values, type=pa.float32())

    data: dict[str, Any] = {
        "frame_id": np.arange(n),
        "marker_id": np.zeros(n, dtype=np.int64),
        "method": ["mine"] * n,
        "intrinsics": ["true"] * n,
        "group": [f"group {i * groups // n}" for i in range(n)],
        "solved": np.ones(n, dtype=bool),
        "branch_correct": pa.nulls(n, pa.bool_()) if wrong is None else ~wrong,
        "oracle_pose_error_bounds": numbers(pose),
        "oracle_normal_error_deg": numbers(normal),
        "oracle_position_error_m": numbers(np.linalg.norm(noise[:, 2:], axis=1) * difficulty / 100),
        "contour_error_px": numbers(np.abs(xy).mean(axis=1)),
        "ellipse_centre_x_error_px": numbers(xy[:, 0]),
        "ellipse_centre_y_error_px": numbers(xy[:, 1]),
        "normal_bound_deg": numbers(difficulty * 2**0.5),
        "position_bound_m": numbers(difficulty * 3**0.5 / 100),
        "ellipse_centre_bound_px": numbers(difficulty * 0.1 * 2**0.5),
        "oracle_branch_correct": ~single,
        "detected": np.ones(n, dtype=bool),
    }
    return Baseline(pa.table(data), "d" * 64, images or f"images {seed}", "s", 1, [{"reason": "", "roundel": "0"}])


def with_detections(scores: Baseline, confidence: Array, false: dict[int, list[float]]) -> Baseline:
    """The same with a confidence for each circle, and those of false positives by frame."""
    rows = scores.rows.append_column("confidence", pa.array(confidence, type=pa.float32()))
    flat = [(frame, value) for frame, values in sorted(false.items()) for value in values]
    table = pa.table(
        {
            "method": pa.array(["mine"] * len(flat), pa.string()),
            "intrinsics": pa.array(["true"] * len(flat), pa.string()),
            "frame_id": pa.array([frame for frame, _ in flat], pa.int64()),
            "confidence": pa.array([value for _, value in flat], pa.float64()),
        }
    )
    return replace(scores, rows=rows, false_positives=table)


def worse(result: GateResult) -> dict[str, str]:
    """Names and sentences of the failed checks."""
    return {check.name: check.sentence for check in result.checks if check.verdict == "worse"}
