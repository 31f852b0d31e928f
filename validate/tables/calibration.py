"""Tables of OpenCV's calibrations: residuals, and errors against the true camera."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from roundel.validate.scores.summary import Summary
from roundel.validate.tables.table import Column, Table

_VIEWS = Column("views", "Views", "used")

_RESIDUALS = (
    ("corners", "Corners", "count", False),
    ("rms_px", "RMS", "px", False),
    ("rms_check_px", "RMS, checked", "px", False),
    ("corner_offset_mean_x_px", "Corner offset x", "px", True),
    ("corner_offset_mean_y_px", "Corner offset y", "px", True),
    ("corner_offset_std_px", "Corner scatter", "px", False),
)
_CAMERA = (
    ("fx_error_pct", "fx", "%", True),
    ("fy_error_pct", "fy", "%", True),
    ("cx_error_px", "cx", "px", True),
    ("cy_error_px", "cy", "px", True),
    *((f"{name}_error", name, "", True) for name in ("k1", "k2", "p1", "p2", "k3")),
    ("projection_mean_px", "Projection, mean", "px", False),
    ("projection_max_px", "Projection, worst", "px", False),
    ("projection_mean_rotated_px", "Rotation removed, mean", "px", False),
    ("projection_max_rotated_px", "Rotation removed, worst", "px", False),
    ("projection_share_pct", "Compared over", "% of image", False),
)


def calibrations_of(summary: Summary) -> list[dict[str, Any]]:
    """Every calibration of a report once: the one from all views and those from fewer."""
    records = [*(summary.calibrations), *([summary.calibration] if summary.calibration else [])]
    found: list[dict[str, Any]] = []
    for record in records:
        if "rms_px" in record and all((r["group"], r["views"]) != (record["group"], record["views"]) for r in found):
            share = record.get("projection_share")
            found.append({**record, "projection_share_pct": None if share is None else 100 * share})
    return sorted(found, key=lambda r: (r["group"], r["views"]))


def calibration_tables(summary: Summary) -> list[Table]:
    """Two tables: residuals, and errors of the cameras where they are known."""
    records = calibrations_of(summary)
    residuals = (
        "RMS: of calibrateCamera's residuals; checked: recomputed from its result. Corner offset: detected minus true, "
        "mean over all corners, in the delivered image."
    )
    camera = (
        "Calibrated minus true. Projection: distance between the projections of the same ray, over a grid of the field "
        "of view that both cameras share; then with the best-fit rotation removed, because a calibration may trade "
        "principal point for rotation. If the true lens has terms that the calibration lacks, only projection is "
        "compared."
    )
    known = [r for r in records if "projection_mean_px" in r]
    found = [
        _table("calibrations", "OpenCV calibrations", records, _RESIDUALS, residuals),
        _table("calibration_errors", "Errors of the calibrated cameras", known, _CAMERA, camera),
    ]
    return [table for table in found if table.rows]


def _table(
    name: str, title: str, records: Sequence[dict[str, Any]], shown: Sequence[tuple[str, str, str, bool]], note: str
) -> Table:
    shown = [s for s in shown if any(r.get(s[0]) is not None for r in records)]
    columns = (Column("group", "Group"), _VIEWS, *(Column(k, t, u, signed=sign) for k, t, u, sign in shown))
    rows = tuple((r["group"], r["views"], *(r.get(k) for k, *_ in shown)) for r in records)
    return Table(name, title, columns, rows, note)
