"""Levenberg-Marquardt for a few parameters, as the five of an ellipse, with few function evaluations."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_MAX_ITERATIONS = 50


def minimise(
    theta: Array,
    rows_at: Callable[[Array], Array],
    valid: Callable[[Array], bool],
    smallest_step: float,
    weight_of: Callable[[Array], Array] | None = None,
) -> tuple[Array, Array]:
    """Minimise the sum of squared residuals, optionally with iterative reweighting.

    Source: D. W. Marquardt, J. SIAM 11 (1963), with the damping in units of the normal matrix's diagonal.

    Parameters
    ----------
    theta : (P,) array
        Valid starting value.
    rows_at : callable
        theta to (P + 1, N): derivatives of the residuals by theta, followed by the residuals.
    valid : callable
        Whether theta is allowed; invalid steps are shortened.
    smallest_step : float
        The iteration ends at a step whose elements are all smaller. The step is applied, and the residuals are updated
        by their derivatives, because another evaluation would not change them.
    weight_of : callable, optional
        Residuals (N,) to weights (N,) of their squares (a robust loss: psi(r) / r).

    Returns
    -------
    theta : (P,) array
    rows : (P + 1, N) array
    """
    damping, p = 1e-4, len(theta)
    rows = rows_at(theta)
    for _ in range(_MAX_ITERATIONS):
        weight = 1.0 if weight_of is None else weight_of(rows[p])
        weighted = rows * weight if weight_of is not None else rows
        gram = weighted @ rows.T
        normal, gradient = gram[:p, :p], gram[:p, p]
        cost = float(weighted[p] @ rows[p])
        scale = normal.diagonal() + (normal.diagonal() <= 0)
        moved = False
        while damping < 1e10 and not moved:
            try:
                step = np.asarray(-np.linalg.solve(normal + np.diag(damping * scale), gradient), dtype=np.float64)
            except np.linalg.LinAlgError:  # the points do not determine all parameters
                damping *= 10.0
                continue
            trial = theta + step
            if valid(trial):
                if float(np.abs(step).max()) < smallest_step:
                    rows[p] += step @ rows[:p]
                    return trial, rows
                new = rows_at(trial)
                moved = float((new[p] * weight) @ new[p]) <= cost
                if moved:
                    theta, rows = trial, new
            damping = max(damping * 0.1, 1e-12) if moved else damping * 10.0
        if not moved:
            break
    return theta, rows
