"""Which measured ellipse belongs to which track: the assignment of least total cost within each track's gate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from roundel.solver.fit.ellipse import shape_of_ellipse
from roundel.solver.tracking.ellipse_motion import GATE, EllipseMotion

Array = NDArray[np.float64]

_APART = 1e6  # a pair outside the gate; more than any sum of costs


def assign(
    predictions: Sequence[EllipseMotion], dark: Sequence[bool], ellipses: Sequence[Array], dark_seen: Sequence[bool]
) -> dict[int, int]:
    """Pairs {prediction: ellipse}, each at most once.

    The cost is the negative log-likelihood of the ellipse under the prediction: a vague prediction of a marker that was
    out of sight never takes the ellipse of a certain one.

    Parameters
    ----------
    predictions : sequence of EllipseMotion
    dark : sequence of bool
        Whether each is dark on light; an ellipse of the other polarity is another contour.
    ellipses : sequence of (5,) arrays
    dark_seen : sequence of bool
        The polarity of each ellipse.
    """
    from scipy.optimize import linear_sum_assignment

    if not predictions or not ellipses:
        return {}
    cost = np.full((len(predictions), len(ellipses)), _APART)
    for i, prediction in enumerate(predictions):
        spread = float(np.linalg.slogdet(prediction.cov[:5, :5])[1])
        for j, ellipse in enumerate(ellipses):
            distance = prediction.distance(ellipse) if dark[i] == dark_seen[j] else np.inf
            if distance <= GATE:
                cost[i, j] = distance + spread
    rows, columns = linear_sum_assignment(cost)
    return {int(i): int(j) for i, j in zip(rows, columns, strict=True) if cost[i, j] < _APART}


def same_contour(one: Array, other: Array) -> bool:
    """Whether two ellipses (5,) are the same contour, up to the error of edge points that have not converged."""
    difference = np.abs(shape_of_ellipse(one) - shape_of_ellipse(other))
    return bool(np.max(difference) <= 0.5 + 0.05 * float(min(one[3], other[3])))
