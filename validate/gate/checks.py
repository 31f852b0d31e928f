"""A check, and a test of the data that becomes one once its p-value is adjusted for all others."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from roundel.validate.gate.quantities import ALPHA, RATE_FLOOR, Array, Flags
from roundel.validate.statistics.intervals import holm
from roundel.validate.statistics.paired_tests import PairedTest, mcnemar_test

# The two families share the allowed false alarms evenly: all circles of a run, and its groups one by one.
FAMILIES = 2


@dataclass(frozen=True)
class Check:
    """One check and its verdict.

    Attributes
    ----------
    run, name : str
    verdict : str
        `same`, `worse`, `better`, or `identical`.
    sentence : str
    p_value : float
        Adjusted for the family; NaN if nothing was tested.
    group : str
        The group that it is about; empty for all circles of the run.
    """

    run: str
    name: str
    verdict: str
    sentence: str
    p_value: float = math.nan
    group: str = ""


@dataclass(frozen=True)
class Tested:
    """A test of the data, before its p-value is adjusted.

    Attributes
    ----------
    run, title : str
    test : PairedTest
    sentence : str
        Without the p-value.
    certain, otherwise : str
        The verdict if the p-value is below `ALPHA`, and if it is not.
    group : str
        The group that it is about; empty for all circles of the run.
    least : float or None
        Of the growth of an error: the smallest fraction that counts.
    """

    run: str
    title: str
    test: PairedTest
    sentence: str
    certain: str
    otherwise: str = "same"
    group: str = ""
    least: float | None = None

    @property
    def name(self) -> str:
        """The title, with the group."""
        return f"{self.title} in {self.group}" if self.group else self.title

    @property
    def could_differ(self) -> bool:
        """Whether the two sides differ at all; if not, the test is not part of the family."""
        return self.test.effect != 0.0 or self.test.standard_error > 0.0


def answers(tested: list[Tested]) -> list[Check]:
    """The verdicts of all tests, in their order.

    Holm's correction is applied to each family, and both share `ALPHA`: with any number of groups the false alarms of
    all questions together stay below it.
    """
    adjusted: dict[int, float] = {}
    families = [[t for t in tested if t.could_differ and bool(t.group) == grouped] for grouped in (False, True)]
    share = FAMILIES if families[1] else 1
    for family in families:
        for t, p in zip(family, holm([t.test.p_value for t in family]).tolist(), strict=True):
            adjusted[id(t)] = min(1.0, share * p)
    return [_answer(t, adjusted.get(id(t), 1.0)) for t in tested]


def strictest(tested: list[Tested], grouped: bool) -> float:
    """The p-value below which the first loss of a family is certain."""
    sizes = [sum(t.could_differ and bool(t.group) == which for t in tested) for which in (False, True)]
    return ALPHA / (FAMILIES if sizes[1] else 1) / max(sizes[grouped], 1)


def _answer(t: Tested, p: float) -> Check:
    verdict = t.certain if p < ALPHA else t.otherwise
    return Check(t.run, t.name, verdict, f"{t.name}: {t.sentence}, p = {p:.2g}", p, t.group)


def rate(run: str, title: str, new: Flags | Array, old: Flags | Array, floor: float = RATE_FLOOR) -> Tested:
    """Whether fewer circles succeed than before."""
    test = mcnemar_test(new, old, alpha=ALPHA)
    sentence = f"{100 * float(np.mean(old)):.2f} % -> {100 * float(np.mean(new)):.2f} % of {test.n}"
    return Tested(run, title, test, sentence, *growth_verdicts(test.effect, test.standard_error, floor))


def growth_verdicts(effect: float, error: float, floor: float) -> tuple[str, str]:
    """`certain` and `otherwise` of a score that is worse where it has grown by more than its floor."""
    better = effect < -floor and effect < -3.0 * error
    return "worse" if effect > floor else "same", "better" if better else "same"
