"""Scores of a pose's stated covariance: is the truth as far away as it says?

The error of a pose has five components: the centre, and the rotation from the estimated to the true normal about two
axes in the tangent plane of the normal. The turn of a circle in its plane is not observable, so that a covariance of
centre and normal has rank five.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from roundel.scenes.geometry.pose import minimal_rotation

Array = NDArray[np.float64]

DEGREES_OF_FREEDOM = 5


@dataclass(frozen=True)
class UncertaintyScores:
    """Scores of poses with their covariances; NaN where a covariance is missing or not positive definite.

    Attributes
    ----------
    chi2 : (...) array
        Squared length of the error in units of the covariance; chi-square with 5 degrees of freedom if it holds.
    log_score : (...) array
        Minus the logarithm of the stated density at the truth, in metres and radians: a proper score, smaller is
        better.
    normal_sigma_deg, position_sigma_m, depth_sigma_m : (...) arrays
        Stated standard deviations: of the normal's angle (both axes together), of the centre (three axes together), and
        along the line of sight.
    """

    chi2: Array
    log_score: Array
    normal_sigma_deg: Array
    position_sigma_m: Array
    depth_sigma_m: Array


def uncertainty_scores(
    camera_from_marker: ArrayLike, normal: ArrayLike, centre_m: ArrayLike, covariance: ArrayLike
) -> UncertaintyScores:
    """Score the covariances of poses against the truth.

    Parameters
    ----------
    camera_from_marker : (n, 4, 4) array_like
        True poses.
    normal, centre_m : (n, 3) array_like
        Estimated poses.
    covariance : (n, 6, 6) array_like
        Of centre (m) and normal, as in estimates.parquet.

    Notes
    -----
    T. Gneiting and A. E. Raftery, Strictly proper scoring rules, prediction, and estimation, JASA 102 (2007): the
    logarithmic score.
    """
    pose, n, c, cov = (np.asarray(v, dtype=np.float64) for v in (camera_from_marker, normal, centre_m, covariance))
    known = np.isfinite(pose).all(axis=(1, 2)) & np.isfinite(n).all(axis=1) & np.isfinite(c).all(axis=1)
    known &= np.isfinite(cov).all(axis=(1, 2))
    out = np.full((5, len(pose)), np.nan)
    rows = np.flatnonzero(known)
    if len(rows):
        out[:, rows] = _scored(pose[rows], n[rows], c[rows], cov[rows])
    return UncertaintyScores(*out)


def _scored(pose: Array, normal: Array, centre_m: Array, cov: Array) -> Array:
    # Two axes of the tangent plane of the estimated normal, in which the covariance of the normal lies.
    axes = np.swapaxes(minimal_rotation(np.broadcast_to([0.0, 0.0, 1.0], normal.shape), normal)[:, :, :2], 1, 2)
    true_normal = pose[:, :3, 2]
    along = np.einsum("nij,nj->ni", axes, true_normal)
    length = np.linalg.norm(along, axis=1)
    angle = np.arctan2(np.linalg.norm(np.cross(normal, true_normal), axis=1), np.sum(normal * true_normal, axis=1))
    tangent = along * np.divide(angle, length, out=np.ones_like(angle), where=length > 0)[:, None]
    error = np.concatenate([pose[:, :3, 3] - centre_m, tangent], axis=1)
    basis = np.zeros((len(pose), 5, 6))
    basis[:, :3, :3], basis[:, 3:, 3:] = np.eye(3), axes
    five = basis @ cov @ np.swapaxes(basis, 1, 2)
    variance = np.diagonal(five, axis1=1, axis2=2)
    positive: NDArray[np.bool_] = np.all(variance > 0, axis=1)
    scale = np.sqrt(np.where(positive[:, None], variance, 1.0))
    # In units of its own standard deviations, so that metres and radians do not spoil the conditioning.
    unit = np.where(positive[:, None, None], five / scale[:, :, None] / scale[:, None, :], np.eye(5))
    values, vectors = np.linalg.eigh(unit)
    positive &= values[:, 0] > _LEAST * values[:, -1]
    turned = np.einsum("nji,nj->ni", vectors, error / scale)
    safe = np.where(positive[:, None], values, 1.0)
    chi2 = np.sum(turned**2 / safe, axis=1)
    log_det = np.sum(np.log(safe), axis=1) + 2 * np.sum(np.log(scale), axis=1)
    ray = centre_m / np.linalg.norm(centre_m, axis=1, keepdims=True)
    depth = np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", ray, cov[:, :3, :3], ray), 0.0))
    score = 0.5 * (chi2 + log_det + DEGREES_OF_FREEDOM * np.log(2 * np.pi))
    sigma = np.stack(
        [chi2, score, np.degrees(np.hypot(scale[:, 3], scale[:, 4])), np.linalg.norm(scale[:, :3], axis=1), depth]
    )
    return np.where(positive, sigma, np.nan)


# Probabilities below this count as this.
_SURE = 1e-6
# Below this ratio of its eigenvalues a covariance is singular to rounding.
_LEAST = 1e-13


def percentile_of(chi2: ArrayLike) -> Array:
    """The probability of a smaller chi-square if the covariance holds, 0 to 1: uniform then; (...) array."""
    return np.asarray(stats.chi2.cdf(np.asarray(chi2, dtype=np.float64), DEGREES_OF_FREEDOM))


def tail_of(chi2: ArrayLike) -> Array:
    """The probability of a larger chi-square if the covariance holds, 0 to 1, exact where it is tiny; (...) array."""
    return np.asarray(stats.chi2.sf(np.asarray(chi2, dtype=np.float64), DEGREES_OF_FREEDOM))


def choice_score(stated: ArrayLike, right: ArrayLike) -> Array:
    """Minus the logarithm of the probability that was stated for what is true: a proper score, smaller is better.

    Parameters
    ----------
    stated : (...) array_like
        Probability of a statement, 0 to 1: that the likelier candidate is the right one, that a detection is a circle.
    right : (...) array_like of bool
        Whether the statement is right.

    Examples
    --------
    >>> choice_score([0.5, 1.0], [True, True]).round(3).tolist()
    [0.693, 0.0]
    """
    p = np.asarray(stated, dtype=np.float64)
    of_true = np.where(np.asarray(right, dtype=bool), p, 1 - p)
    # A certainty that is wrong would have an infinite score.
    return np.asarray(-np.log(np.clip(of_true, _SURE, 1.0)))


def brier_score(stated: ArrayLike, right: ArrayLike) -> Array:
    """Squared distance of a stated probability from what came true: a proper score, smaller is better; (...) array.

    Parameters
    ----------
    stated : (...) array_like
        Probability of a statement, 0 to 1.
    right : (...) array_like of bool
        Whether the statement is right.

    Notes
    -----
    G. W. Brier, Verification of forecasts expressed in terms of probability, Monthly Weather Review 78 (1950), for one
    of the two outcomes.

    Examples
    --------
    >>> brier_score([0.5, 1.0, 1.0], [True, True, False]).tolist()
    [0.25, 0.0, 1.0]
    """
    return np.asarray((np.asarray(stated, dtype=np.float64) - np.asarray(right, dtype=bool)) ** 2)
