"""Which of the two poses is the true one: only what is known from elsewhere can tell.

Both candidates reproduce the image exactly: one image holds no information about the choice (errata, section 3). So the
knowledge is declared, and without it nothing is chosen.
"""

from __future__ import annotations

import difflib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.errors import UsageError
from roundel.scenes.pose import angle_deg

Array = NDArray[np.float64]

KNOWLEDGE = ("same_side", "opposite_side")


@dataclass(frozen=True)
class NormalPrior:
    """What is known of the normal: from gravity, an inertial sensor, or the frame before.

    Attributes
    ----------
    normal : (3,) array
        Out of the printed face, in the camera frame; of any length.
    spread_deg : float
        One standard deviation of the angle between it and the truth, along one axis.
    """

    normal: Array
    spread_deg: float = 10.0


Knowledge = str | NormalPrior | None


@dataclass(frozen=True)
class Choice:
    """Probability of each candidate, and the index of the chosen one, if any."""

    probability: tuple[float, float]
    chosen: int | None


def check_knowledge(knowledge: Knowledge) -> None:
    """Refuse what is not `same_side`, `opposite_side`, a `NormalPrior` or None.

    Raises
    ------
    UsageError
    """
    if knowledge is None or knowledge in KNOWLEDGE:
        return
    if isinstance(knowledge, NormalPrior):
        if not (np.all(np.isfinite(knowledge.normal)) and np.any(knowledge.normal) and knowledge.spread_deg > 0):
            raise UsageError("a prior normal must be a finite vector that is not zero, with a positive spread")
        return
    close = difflib.get_close_matches(knowledge, KNOWLEDGE, n=1)
    hint = f"did you mean {close[0]}?" if close else f"use {' or '.join(KNOWLEDGE)}"
    raise UsageError(f"unknown knowledge {knowledge!r}; {hint}")


def choose(normal: Array, knowledge: Knowledge = None) -> Choice:
    """Choose between both candidates by declared knowledge.

    - None: probabilities 0.5, nothing is chosen.
    - `same_side`: the limiting points are on one side of the vanishing line (E > 0, Proposition 3 with its sign
      corrected): the errata's `+`, the larger n_z, which is index 0 here. Holds if the paper's (i) and (ii) do.
    - `opposite_side`: E < 0, index 1.
    - a `NormalPrior`: weights exp(-theta^2 / (2 spread^2)), theta the angle between a candidate and the prior: the
      normal distribution on the tangent plane, a von Mises-Fisher weight for small spreads. The larger is chosen;
      candidates at the same angle are not told apart.

    Source: errata, section 3, "Exact criterion" and "Decision procedure".

    Parameters
    ----------
    normal : (2, 3) array
        Unit normals out of the printed face, in the order of `CirclePoses`.
    knowledge : str, NormalPrior or None

    Returns
    -------
    Choice

    Raises
    ------
    UsageError
        If the knowledge is of no known kind.
    """
    check_knowledge(knowledge)
    if knowledge is None:
        return Choice((0.5, 0.5), None)
    if isinstance(knowledge, NormalPrior):
        theta = angle_deg(normal, np.broadcast_to(knowledge.normal, (2, 3)))
        # The difference of the exponents, so that two far candidates do not both underflow to zero.
        log_ratio = (theta[1] ** 2 - theta[0] ** 2) / (2.0 * knowledge.spread_deg**2)
        first = float(0.5 * (1.0 + np.tanh(0.5 * log_ratio)))
        chosen = None if abs(log_ratio) < 1e-9 else int(log_ratio < 0)
        return Choice((first, 1.0 - first), chosen)
    index = KNOWLEDGE.index(knowledge)
    return Choice((1.0 - index, float(index)), index)
