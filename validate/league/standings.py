"""Standings of the league: rates and errors of each entry, over all conditions and by condition, with intervals."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from roundel.validate.metrics.rows import column
from roundel.validate.statistics.intervals import Interval, bootstrap_interval, wilson_interval

Array = NDArray[np.float64]

ALL = "all"

# Errors whose medians are shown, by column of the outcomes.
ERRORS = (
    "normal_error_deg",
    "chosen_normal_error_deg",
    "position_error_pct",
    "focal_error_pct",
    "fused_focal_error_pct",
    "prior_focal_error_pct",
    "time_ms",
)
RATES = ("found", "identity_read", "identity_correct", "branch_correct")


@dataclass(frozen=True)
class Standing:
    """One entry on one variant, with one kind of intrinsics, in one condition.

    Attributes
    ----------
    entry, variant, intrinsics, condition : str
        `condition` is `all` for all conditions together.
    frames : int
    rates : dict
        Interval of each of `RATES`: `found` of all frames, the others of the frames in which the marker was found and
        the question applies.
    false_per_frame : float
    errors : dict
        Median and interval of each of `ERRORS`, over the frames in which the marker was found.
    """

    entry: str
    variant: str
    intrinsics: str
    condition: str
    frames: int
    rates: dict[str, Interval]
    false_per_frame: float
    errors: dict[str, Interval]

    def record(self) -> dict[str, Any]:
        """As plain values, for league.json and league.csv: `NAME`, `NAME_low`, `NAME_high` for each number."""
        out: dict[str, Any] = {n: getattr(self, n) for n in ("entry", "variant", "intrinsics", "condition", "frames")}
        out["false_per_frame"] = self.false_per_frame
        for name, interval in {**self.rates, **self.errors}.items():
            out |= {name: interval.value, f"{name}_low": interval.low, f"{name}_high": interval.high}
            out[f"{name}_frames"] = interval.n
        return out


def standings_of(outcomes: pa.Table) -> list[Standing]:
    """Standings of every entry, variant and kind of intrinsics in the outcomes, in their order; `all` comes first."""
    return [_standing(table, *key) for key, table in _parts(outcomes)]


def _parts(outcomes: pa.Table) -> Iterator[tuple[tuple[str, str, str, str], pa.Table]]:
    seen = dict.fromkeys(zip(*(outcomes[n].to_pylist() for n in ("entry", "variant", "intrinsics")), strict=True))
    for entry, variant, intrinsics in seen:
        mine = outcomes.filter(
            (pc.field("entry") == entry) & (pc.field("variant") == variant) & (pc.field("intrinsics") == intrinsics)
        )
        yield (entry, variant, intrinsics, ALL), mine
        for condition in dict.fromkeys(mine["condition"].to_pylist()):
            yield (entry, variant, intrinsics, condition), mine.filter(pc.field("condition") == condition)


def _standing(table: pa.Table, entry: str, variant: str, intrinsics: str, condition: str) -> Standing:
    rates = {}
    for name in RATES:
        known = table[name].drop_null()
        rates[name] = wilson_interval(pc.sum(known).as_py() or 0, len(known))
    return Standing(
        entry,
        variant,
        intrinsics,
        condition,
        table.num_rows,
        rates,
        float(pc.mean(table["false_detections"]).as_py()),
        {name: bootstrap_interval(column(table, name), "median") for name in ERRORS},
    )
