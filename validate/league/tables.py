"""Tables of the league: overall, by condition, focal lengths by distance, and who wins where."""

from __future__ import annotations

from collections.abc import Sequence

from roundel.validate.league.figure import winners
from roundel.validate.league.standings import ALL, Standing
from roundel.validate.statistics.intervals import Interval
from roundel.validate.tables.table import Cell, Column, Table

_NAMED = 3  # winners of a condition that are named
NAMES = ("overall", "conditions", "focal", "winners")


def league_tables(standings: Sequence[Standing]) -> list[Table]:
    """All tables, in the order of the page."""
    overall = [s for s in standings if s.condition == ALL]
    return [_overall(overall), *_focal(standings), _winners(standings), _conditions(standings)]


def _percent(interval: Interval) -> tuple[Cell, Cell, Cell]:
    return tuple(None if v is None else 100 * v for v in (interval.value, interval.low, interval.high))  # type: ignore[return-value]


def _plain(interval: Interval) -> tuple[Cell, Cell, Cell]:
    return interval.value, interval.low, interval.high


def _with_interval(key: str, title: str, unit: str = "") -> tuple[Column, Column, Column]:
    low, high = (Column(f"{key}_{end}", title, unit, role=end) for end in ("low", "high"))
    return Column(key, title, unit), low, high


_KEY = (Column("variant", "Marker"), Column("entry", "Entry"), Column("intrinsics", "Intrinsics"))
_RESULTS = (
    Column("frames", "Frames"),
    *_with_interval("found_pct", "Found", "%"),
    Column("false_per_frame", "False", "per frame"),
    Column("identity_wrong", "Wrong identities"),
    Column("identity_read", "", role="of"),
    *_with_interval("normal_error_deg", "Normal", "deg"),
    *_with_interval("branch_correct_pct", "Chose the right pose", "%"),
    *_with_interval("position_error_pct", "Position", "% of distance"),
    Column("time_ms", "Time", "ms"),
)


def _results(s: Standing) -> tuple[Cell, ...]:
    told = s.rates["identity_correct"]
    wrong = None if told.value is None else round(told.n * (1.0 - told.value))
    return (
        s.frames,
        *_percent(s.rates["found"]),
        s.false_per_frame,
        wrong,
        None if wrong is None else told.n,
        *_plain(s.errors["normal_error_deg"]),
        *_percent(s.rates["branch_correct"]),
        *_plain(s.errors["position_error_pct"]),
        s.errors["time_ms"].value,
    )


def _overall(standings: Sequence[Standing]) -> Table:
    rows = tuple((s.variant, s.entry, s.intrinsics, *_results(s)) for s in standings)
    note = (
        "All conditions together. Found: the marker was detected at the right place. Errors: medians over the frames "
        "in which it was found; normal and position of the better of two poses, where a method gives two. Chose the "
        "right pose: the pose that it chose, or the only one, is nearer to the true normal than to the one mirrored at "
        "the line of sight. In brackets 95 % intervals (Wilson; bootstrap)."
    )
    return Table("overall", "All conditions", (*_KEY, *_RESULTS), rows, note)


def _conditions(standings: Sequence[Standing]) -> Table:
    columns = (_KEY[0], _KEY[1], _KEY[2], Column("condition", "Condition"), *_RESULTS)
    rows = tuple((s.variant, s.entry, s.intrinsics, s.condition, *_results(s)) for s in standings if s.condition != ALL)
    return Table("conditions", "Condition by condition", columns, rows, "As above, for each condition.")


def _focal(standings: Sequence[Standing]) -> list[Table]:
    measured = [s for s in standings if s.intrinsics == "default" and s.errors["focal_error_pct"].value is not None]
    if not measured:
        return []
    columns = (
        Column("condition", "Condition"),
        Column("variant", "Marker"),
        Column("entry", "Entry"),
        Column("frames", "Frames"),
        *_with_interval("focal_error_pct", "From one image alone", "%"),
        *_with_interval("fused_focal_error_pct", "Fused with the prior", "%"),
        *_with_interval("prior_focal_error_pct", "Prior alone", "%"),
    )
    rows = tuple(
        (
            s.condition,
            s.variant,
            s.entry,
            s.errors["focal_error_pct"].n,
            *_plain(s.errors["focal_error_pct"]),
            *_plain(s.errors["fused_focal_error_pct"]),
            *_plain(s.errors["prior_focal_error_pct"]),
        )
        for s in sorted(measured, key=lambda s: list(dict.fromkeys(m.condition for m in measured)).index(s.condition))
    )
    note = (
        "Median errors of the focal length, over the frames in which the entry measured one. The prior is the default "
        "phone's, 11.5 %; fused by inverse variances of log f, with the sigma that the method states."
    )
    return [Table("focal", "Focal length", columns, rows, note)]


def _first(names: Sequence[str]) -> str:
    """The best names, and how many more there are."""
    more = len(names) - _NAMED
    return "; ".join([*names[:_NAMED], *([f"{more} more"] if more > 0 else [])])


def _winners(standings: Sequence[Standing]) -> Table:
    known = [s for s in standings if s.intrinsics == "true"]
    found, normal, position = (winners(known, panel) for panel in ("recall", "chosen", "position"))
    conditions = dict.fromkeys(s.condition for s in known if s.condition != ALL)
    best = (found, normal, position)
    rows = tuple((c, *(_first(those.get(c, [])) for those in best)) for c in conditions)
    columns = (
        Column("condition", "Condition"),
        Column("found", "Found most"),
        Column("normal", "Best normal of a chosen pose"),
        Column("position", "Best position"),
    )
    note = "With known intrinsics. The best first, then those whose 95 % interval contains its value."
    return Table("winners", "Who wins where", columns, rows, note)
