"""Test whether pixels differ from a prediction by their Monte-Carlo error alone.

Each difference over its standard error follows Student's t with 7 degrees of freedom, because a pixel's variance comes
from 8 replicates. Its normal score z is tested twice: the worst of n pixels against Sidak's limit (Sidak 1967), which
detects a few wrong pixels, and the sum of squares against chi-square, which detects many slightly wrong pixels. Both
tests together reject one correct image in a hundred.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.datasets.layout.radiance import REPLICATES

Array = NDArray[np.float64]

LEVEL = 0.01

# Replicates are stratified counts, not Gaussian: the sum of squares may exceed its expected value by this factor.
_SLACK = 1.1


def normal_scores(difference: Array, variance: Array) -> Array:
    """Normal scores (n,) of differences whose variances were estimated from 8 replicates each."""
    from scipy.stats import norm, t

    ratio = difference / np.sqrt(variance)
    return np.asarray(np.sign(ratio) * norm.isf(np.maximum(t.sf(np.abs(ratio), REPLICATES - 1), 1e-300)))


def pixel_test(difference: Array, variance: Array) -> dict[str, Any]:
    """Test differences (n,) against their variances (n,).

    Returns
    -------
    dict
        `z_pixels`: n; `z_worst`: the largest absolute score, and `z_limit`; `z_rms`: the root of the scores' mean
        square, and `z_rms_limit`; `z_passed`: whether both are within their limits.
    """
    from scipy.stats import chi2, norm

    scores = normal_scores(difference, variance)
    count = len(scores)
    half = 1 - np.sqrt(1 - LEVEL)
    limit = float(norm.isf((1 - (1 - half) ** (1 / count)) / 2))
    rms_limit = _SLACK * float(np.sqrt(chi2.isf(half, count) / count))
    worst, rms = float(np.abs(scores).max()), float(np.sqrt(np.mean(scores**2)))
    return {
        "z_pixels": count,
        "z_worst": worst,
        "z_limit": limit,
        "z_rms": rms,
        "z_rms_limit": rms_limit,
        "z_passed": bool(worst <= limit and rms <= rms_limit),
    }
