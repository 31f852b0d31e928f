"""Up to two poses of each circle, as a run gives them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.validate.estimates.runs import Run
from roundel.validate.scores.assignment import Match
from roundel.validate.scores.false_positives import stated_confidence

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Candidates:
    """Up to two poses per target: (N, 2, ...) arrays; `has` tells which exist. `camera` indexes `cameras`.

    `found` tells which were detected, with or without a pose; `centre_px` is the image of the centre. None: all
    detections have poses. `covariance` is of centre and normal, (N, 2, 6, 6), and `probability` that of each
    candidate, (N, 2); NaN where the method gives none. `confidence` is that of the detection, (N,).
    """

    has: NDArray[np.bool_]
    chosen: NDArray[np.bool_]
    normal: Array
    centre_m: Array
    ellipse: Array
    camera: NDArray[np.int64]
    cameras: list[Any]
    found: NDArray[np.bool_] | None = None
    centre_px: Array | None = None
    covariance: Array | None = None
    probability: Array | None = None
    confidence: Array | None = None

    def detected(self) -> NDArray[np.bool_]:
        """(N, 2) array: which were detected."""
        return self.has if self.found is None else self.found

    def stated_confidence(self) -> Array:
        """(N,) array: confidence of each detection; NaN where there is none."""
        return np.full(len(self.has), np.nan) if self.confidence is None else self.confidence


def matched_candidates(found: Match, run: Run) -> Candidates:
    """The matched rows of a run, target by target."""
    rows = found.rows
    there = rows >= 0
    # Row 0 is a placeholder for missing rows; `there` and `has` exclude it from all results.
    safe = np.where(there, rows, 0)
    has = there & run.posed[safe]
    return Candidates(
        has,
        there & run.chosen[safe],
        np.where(has[..., None], run.normal[safe], np.nan),
        np.where(has[..., None], run.centre_m[safe], np.nan),
        np.where(there[..., None], run.ellipse[safe], np.nan),
        np.where(there, run.camera[safe], -1),
        run.cameras,
        there,
        np.where(there[..., None], run.centre_px[safe], np.nan),
        np.where(has[..., None, None], run.covariance[safe], np.nan) if len(run.covariance) else None,
        np.where(has, run.probability[safe], np.nan) if len(run.probability) else None,
        np.where(there.any(axis=1), stated_confidence(run)[rows.max(axis=1)], np.nan),
    )


def candidates_take(candidates: Candidates, rows: NDArray[np.int64]) -> Candidates:
    """The selected rows."""
    c = candidates
    return Candidates(
        c.has[rows],
        c.chosen[rows],
        c.normal[rows],
        c.centre_m[rows],
        c.ellipse[rows],
        c.camera[rows],
        c.cameras,
        None if c.found is None else c.found[rows],
        None if c.centre_px is None else c.centre_px[rows],
        None if c.covariance is None else c.covariance[rows],
        None if c.probability is None else c.probability[rows],
        None if c.confidence is None else c.confidence[rows],
    )
