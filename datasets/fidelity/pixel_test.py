"""Test whether pixels differ from a prediction by their Monte-Carlo error alone.

Each difference over its standard error is Student's t with 7 degrees of freedom, as a pixel's variance comes from 8
replicates. Its normal score z is tested twice: the worst of n pixels against Sidak's limit (Sidak 1967), which sees a
few wrong pixels, and the sum of squares against chi-square, which sees many that are a little wrong. Both together
reject one right image in a hundred.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.datasets.layout.radiance import REPLICATES

Array = NDArray[np.float64]

LEVEL = 0.01

# A pixel's replicates are stratified counts, not Gaussian numbers: the sum of squares may exceed its own by this much.
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
        square, and `z_rms_limit`; `z_passed`: whether both stay within.
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
