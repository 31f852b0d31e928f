"""Scores of `reported_uncertainty.py`: solve a dataset, and compare its errors with the reported covariances.

The error of a pose has five components: its centre, and the rotation from the estimated to the true normal in the two
axes of its tangent plane (the rotation in the plane of a circle is not observable). Its chi-square is that error
weighted by the inverse of the reported covariance in the same components.

- *beyond 5 sigma*: the share of poses whose chi-square (5 degrees of freedom) is less probable than a deviation of a
  normal variable by more than 5 sigma to either side, 5.7e-7: above 37.1.
- *normal beyond*: the same for the two components of the normal alone: above 28.7.
- *in 95 % region*: the share of poses with a chi-square below the 95 % quantile, 11.07.
- *normal error / bound*: RMS over the frames of the normal's error over its frame's Cramer-Rao bound.
- *median sigma*: of the reported standard deviation of the normal, both axes together.

Shares are of the solved markers. A pose without a covariance counts as beyond 5 sigma and outside of every region.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from roundel.datasets.dataset import Dataset
from roundel.scenes.geometry.pose import minimal_rotation
from roundel.solver.estimates import ESTIMATES
from roundel.solver.methods.roundel_fits import DEFAULT_METHOD
from roundel.solver.methods.solve import solve_dataset
from roundel.validate.estimates.reader import read_estimates
from roundel.validate.estimates.runs import read_runs
from roundel.validate.metrics.cramer_rao import bounds_of
from roundel.validate.metrics.ground_truth import true_targets
from roundel.validate.metrics.pose_errors import normal_error_deg
from roundel.validate.scores.assignment import match

Array = NDArray[np.float64]

FIVE_SIGMA = 2 * float(norm.sf(5))  # the probability of a deviation beyond 5 sigma, to either side
_COV = [f"cov_{min(i, j)}{max(i, j)}" for i in range(6) for j in range(6)]


@dataclass(frozen=True)
class LevelScore:
    """One line of the table; shares are fractions of the solved markers."""

    level: str
    frames: int
    markers: int
    solved: int
    beyond: float
    normal_beyond: float
    covered: float
    over_bound: float
    sigma_deg: float
    confidence: float


def pose_chi_square(cov: Array, normal: Array, centre_m: Array, true_pose: Array) -> tuple[float, float, float]:
    """Chi-square of a pose (5 degrees of freedom) and of its normal (2), and the normal's sigma in degrees.

    Parameters
    ----------
    cov : (6, 6) array
        Of centre (m) and normal.
    normal, centre_m : (3,) arrays
        The estimate.
    true_pose : (4, 4) array

    Returns
    -------
    whole, of_normal, sigma_deg : float
        Infinite chi-squares if there is no positive definite covariance.
    """
    # Two axes of the tangent plane of the estimated normal, in which the covariance of the normal lies.
    axes = minimal_rotation([0.0, 0.0, 1.0], normal)[:, :2].T
    true_normal = true_pose[:3, 2]
    angle = np.radians(normal_error_deg(normal, true_normal))
    along = axes @ true_normal
    length = float(np.linalg.norm(along))
    tangent = along * (float(angle) / length if length > 0 else 1.0)
    error = np.concatenate([true_pose[:3, 3] - centre_m, tangent])
    basis = np.zeros((5, 6))
    basis[:3, :3], basis[3:, 3:] = np.eye(3), axes
    five = basis @ cov @ basis.T
    scale = np.sqrt(np.diag(five))
    if not np.all(np.isfinite(five)) or not np.all(scale > 0):
        return np.inf, np.inf, np.nan
    unit, e = five / scale[:, None] / scale, error / scale
    if np.linalg.eigvalsh(unit)[0] <= 0:
        return np.inf, np.inf, float(np.degrees(np.hypot(*scale[3:])))
    whole = float(e @ np.linalg.solve(unit, e))
    of_normal = float(e[3:] @ np.linalg.solve(unit[3:, 3:], e[3:]))
    return whole, of_normal, float(np.degrees(np.hypot(*scale[3:])))


def score_levels(dataset: Dataset, method: str | None = None) -> list[LevelScore]:
    """Solve a dataset, and score each level of its sweep (each group, without one)."""
    with tempfile.TemporaryDirectory() as folder:
        solve_dataset(dataset.path, folder, methods=(method or DEFAULT_METHOD,))
        file = Path(folder) / ESTIMATES
        (run,) = read_runs([file], dataset)
        table = read_estimates(file)
        table = table.sort_by([(name, "ascending") for name in ("frame_id", "detection_id", "candidate")])
    cov = np.stack([np.asarray(table[name].to_numpy(zero_copy_only=False), dtype=float) for name in _COV], -1)
    confidence = np.asarray(table["confidence"].to_numpy(zero_copy_only=False), dtype=float)
    targets = true_targets(dataset, 3.0)
    bounds = bounds_of(dataset, targets)
    rows = match(targets, run).rows
    values = np.full((len(targets), 5), np.nan)
    for i, pair in enumerate(rows.tolist()):
        posed = [r for r in pair if r >= 0 and run.posed[r]]
        if not posed:
            continue
        pose = targets.camera_from_marker[i]
        best = min(posed, key=lambda r: float(normal_error_deg(run.normal[r], pose[:3, 2])))
        error = float(normal_error_deg(run.normal[best], pose[:3, 2]))
        chi = pose_chi_square(cov[best].reshape(6, 6), run.normal[best], run.centre_m[best], pose)
        values[i] = [*chi, error / bounds.normal_deg[i], confidence[best]]
    group = np.array(targets.truth["group"].to_pylist(), dtype=object)
    level = np.asarray(targets.truth["sweep_level"].to_numpy(zero_copy_only=False), dtype=float)
    labels = np.array([g if np.isnan(v) else f"{v:g}" for g, v in zip(group, level, strict=True)], dtype=object)
    return [
        _score(label, targets.frame_id[labels == label], values[labels == label])
        for label in dict.fromkeys(labels.tolist())
    ]


def _score(label: str, frame_id: NDArray[np.int64], values: Array) -> LevelScore:
    solved = values[~np.isnan(values[:, 0])]
    if not len(solved):
        return LevelScore(label, len(np.unique(frame_id)), len(values), 0, *[float("nan")] * 6)
    whole, normal, sigma, ratio, confidence = solved.T
    ratio = ratio[np.isfinite(ratio)]
    return LevelScore(
        label,
        len(np.unique(frame_id)),
        len(values),
        len(solved),
        float(np.mean(whole > chi2.isf(FIVE_SIGMA, 5))),
        float(np.mean(normal > chi2.isf(FIVE_SIGMA, 2))),
        float(np.mean(whole < chi2.ppf(0.95, 5))),
        float(np.sqrt(np.mean(ratio**2))) if len(ratio) else float("nan"),
        float(np.nanmedian(sigma)) if np.isfinite(sigma).any() else float("nan"),
        float(np.nanmedian(confidence)),
    )
