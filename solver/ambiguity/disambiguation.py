"""The choice between both poses, from prior knowledge and cues.

Both candidates reproduce the image of the circle exactly, so the image holds no information about the choice (errata,
section 3). The user declares prior knowledge, each piece of which contributes odds; without it nothing is chosen.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.errors import UsageError, did_you_mean
from roundel.solver.ambiguity.coplanar import CoplanarCircles
from roundel.solver.ambiguity.normal_prior import GreatCirclePrior, NormalPrior
from roundel.solver.ambiguity.observation import Evidence, Observation
from roundel.solver.ambiguity.vanishing_line_side import SideRule

__all__ = [
    "KNOWLEDGE",
    "Choice",
    "GreatCirclePrior",
    "Knowledge",
    "NormalPrior",
    "check_knowledge",
    "choose",
    "named",
    "pieces_of",
]

Array = NDArray[np.float64]

KNOWLEDGE = ("same_side", "opposite_side", "coplanar")

# One piece of prior knowledge, or several; a string is one of `KNOWLEDGE`.
Knowledge = str | Evidence | Sequence[str | Evidence] | None

_SURE = math.log(19.0)  # 95 %: pieces that favour different candidates with this certainty contradict each other
_TIED = 1e-9
# Part of a basis: two pieces are each certain, of different candidates.
CONTRADICTORY = "these contradict each other"


@dataclass(frozen=True)
class Choice:
    """Probability of each candidate, the index of the chosen one, if any, and the basis of both as text."""

    probability: tuple[float, float]
    chosen: int | None
    basis: str = ""


def check_knowledge(knowledge: Knowledge) -> None:
    """Check prior knowledge.

    Raises
    ------
    UsageError
        If a name is unknown, or a piece is invalid (for example, a zero normal).
    """
    pieces_of(knowledge)


def choose(observation: Observation | Array, knowledge: Knowledge = None) -> Choice:
    """Choose between both candidates by prior knowledge.

    - None: probabilities 0.5, nothing is chosen.
    - `same_side`, `opposite_side`: the paper's condition, see `SideRule`; taken as certain if only normals are given.
    - `NormalPrior`, `GreatCirclePrior` (a floor, a wall, the previous frame): see there.
    - `ConcentricCircle`, `Pattern`: cues in the print, measured in the image.
    - `coplanar`: no odds for one circle; several of an image are solved together, see `solve_together`.
    - Several of them: their log odds add, as for independent observations.

    The likelier candidate is chosen; of equally likely candidates none is chosen. Probabilities are calibrated under
    the declared knowledge: 80 % of the cases with probability 0.8 are right.

    Source: errata, section 3, "Exact criterion" and "Decision procedure".

    Parameters
    ----------
    observation : Observation or (2, 3) array
        Or only the unit normals, out of the printed face, in the order of `CirclePoses`.
    knowledge : str, Evidence, a sequence of them, or None

    Returns
    -------
    Choice

    Raises
    ------
    UsageError
        If the type of the knowledge is unknown.
    """
    pieces = pieces_of(knowledge)
    if not pieces:
        return Choice((0.5, 0.5), None, "no prior knowledge was given")
    seen = (
        observation if isinstance(observation, Observation) else Observation(np.asarray(observation, dtype=np.float64))
    )
    verdicts = [piece.verdict(seen) for piece in pieces]
    odds = [verdict.log_odds for verdict in verdicts]
    basis = "; ".join(verdict.basis for verdict in verdicts)
    if max(odds) > _SURE and min(odds) < -_SURE:
        basis += f"; {CONTRADICTORY}"
    if math.inf in odds and -math.inf in odds:
        return Choice((0.5, 0.5), None, basis)
    total = sum(odds)
    # tanh keeps the digits of the probability and of its complement, and allows infinite odds.
    first = 0.5 * (1.0 + math.tanh(0.5 * total))
    return Choice((first, 1.0 - first), None if abs(total) < _TIED else int(total < 0), basis)


def pieces_of(knowledge: Knowledge) -> list[Evidence]:
    """All pieces of knowledge, checked.

    Raises
    ------
    UsageError
        As `check_knowledge`.
    """
    if knowledge is None:
        return []
    several = [knowledge] if isinstance(knowledge, str) or not isinstance(knowledge, Sequence) else knowledge
    out: list[Evidence] = []
    for piece in several:
        if isinstance(piece, str):
            out.append(named(piece))
            continue
        if not hasattr(piece, "verdict"):
            raise UsageError(
                f"{type(piece).__name__} is not a valid prior; pass {' or '.join(KNOWLEDGE)}, or a NormalPrior"
            )
        problem = piece.problem()
        if problem:
            raise UsageError(problem)
        out.append(piece)
    return out


def named(word: str) -> Evidence:
    """The piece of knowledge that a word of `KNOWLEDGE` stands for.

    Raises
    ------
    UsageError
        If it is none of them.
    """
    if word not in KNOWLEDGE:
        hint = did_you_mean(word, KNOWLEDGE) or f"use {' or '.join(KNOWLEDGE)}"
        raise UsageError(f"unknown knowledge {word!r}; {hint}")
    return CoplanarCircles() if word == "coplanar" else SideRule(word == KNOWLEDGE[0])
