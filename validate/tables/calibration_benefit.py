"""Tables of the benefit of a calibration: of one camera for every kind of intrinsics, and over several cameras."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from roundel.validate.claims.benefit_over_cameras import BenefitOverCameras
from roundel.validate.metrics.metric import HEADLINE
from roundel.validate.tables.table import Cell, Column, Table

_PARTS = {"on_axis": "on the axis", "off_axis": "off the axis"}


def benefit_table(record: dict[str, Any] | None) -> Table:
    """One row per part of the image and kind of intrinsics, from summary["benefit"]; empty if there is no record."""
    rows: dict[tuple[str, str], list[Cell]] = {}
    columns = [Column("frames", "Circles"), Column("intrinsics", "Intrinsics")]
    for i, metric in enumerate(HEADLINE):
        error, title, unit = metric.name, metric.title, metric.unit
        for key, role in (("median", ""), ("low", "low"), ("high", "high")):
            columns.append(Column(f"{error}_{key}", title, unit, role))
        columns.append(Column(f"{error}_gain", "Gain", "1"))
        columns += [Column(f"{error}_gain_{end}", "Gain", "1", end) for end in ("low", "high")]
        for entry in (record or {}).get("overall", []):
            if entry["error"] == error:
                part, label = _PARTS[entry["part"]], entry["intrinsics"]
                gain = entry["gain"] or {}
                row = rows.setdefault((part, label), [part, label] + [None] * (6 * i))
                row += [entry["value"], entry["low"], entry["high"], *(gain.get(k) for k in ("value", "low", "high"))]
    record = record or {"calibrated": "", "on_axis_deg": 0.0}
    note = (
        "Median error of the better candidate over the solved circles, with its 95 % interval in brackets. Gain: that "
        f"median over the one with {record['calibrated']}, by paired bootstrap. On the axis: the circle's centre is "
        f"within {record['on_axis_deg']:g} deg of it. Camera frame; reprojection in the delivered image, a 3x3 grid "
        "around the circle. chessboard: the circle's pose from the board beside it, by solvePnP."
    )
    return Table(
        "benefit", "Benefit of calibration, by intrinsics", tuple(columns), tuple(map(tuple, rows.values())), note
    )


def benefit_over_cameras_table(found: Sequence[BenefitOverCameras]) -> Table:
    """One row per error, assumed intrinsics and number of views."""
    columns = (
        Column("error", "Error"),
        Column("without", "Without"),
        Column("views", "Views", "count"),
        Column("cameras", "Cameras", "count"),
        Column("sets", "Calibrations", "count"),
        Column("factor", "Factor", "1"),
        Column("factor_low", "Factor", "1", "low"),
        Column("factor_high", "Factor", "1", "high"),
        Column("from", "80 % from", "1"),
        Column("to", "to", "1"),
    )
    rows = tuple(
        (f.error.words, f.without, f.views, f.cameras, f.sets, f.factor.value, f.factor.low, f.factor.high, f.low,
         f.high)
        for f in found
    )  # fmt: skip
    note = (
        "Median error without a calibration over that with it, each report being one camera and each of its "
        "calibrations one set of views: geometric mean over cameras with its 95 % interval (nested bootstrap over "
        "cameras, sets and circles; none for fewer than six cameras). 80 % of single cameras and sets lie from and to."
    )
    return Table("benefit_over_cameras", "Benefit of a calibration, over cameras", columns, rows, note)
