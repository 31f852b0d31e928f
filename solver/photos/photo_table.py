"""`estimates.csv`: the results of photographs as a table for spreadsheets, one row for each candidate pose."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import Any

from roundel.solver.estimates import NOT_FOUND, Estimate
from roundel.solver.photos.photo_report import PhotoResult, candidate_record

COLUMNS = (
    *("file", "status", "reason", "circle", "method", "intrinsics", "candidate", "probability", "chosen"),
    *("distance_m", "distance_sigma_m", "tilt_deg", "azimuth_deg", "normal_sigma_deg"),
    *("normal_x", "normal_y", "normal_z", "centre_x_m", "centre_y_m", "centre_z_m"),
    *("ellipse_x_px", "ellipse_y_px", "ellipse_a_px", "ellipse_b_px", "ellipse_angle_deg", "confidence"),
    *("camera", "exif_problem", "choice_basis", "caveats"),
)


def photo_table(results: Sequence[PhotoResult]) -> str:
    """CSV (RFC 4180, UTF-8, LF); missing values are empty. A photograph without a pose has one row that says why."""
    sink = io.StringIO()
    writer = csv.DictWriter(sink, COLUMNS, lineterminator="\n", restval="")
    writer.writeheader()
    for result in results:
        rows = [row for estimate in result.estimates for row in _rows(result, estimate)]
        writer.writerows([{k: _plain(v) for k, v in row.items()} for row in rows or [_head(result)]])
    return sink.getvalue()


def _plain(value: Any) -> Any:
    """A cell; text that a spreadsheet would run as a formula gets an apostrophe."""
    if isinstance(value, str) and value.startswith(("=", "+", "-", "@", "\t")):
        return f"'{value}"
    return "" if value is None else value


def _head(result: PhotoResult) -> dict[str, Any]:
    reason, problem = result.reason, result.exif_problem
    return {"file": result.file, "status": result.status, "reason": reason, "exif_problem": problem}


def _rows(result: PhotoResult, estimate: Estimate) -> list[dict[str, Any]]:
    camera = result.cameras.get(estimate.intrinsics)
    row: dict[str, Any] = {
        **_head(result),
        "reason": estimate.reason or result.reason,
        "circle": None if estimate.detection_id == NOT_FOUND else estimate.detection_id,
        "method": estimate.method,
        "intrinsics": estimate.intrinsics,
        "confidence": estimate.confidence,
        "camera": "" if camera is None else camera.basis,
        "choice_basis": estimate.choice_basis,
        "caveats": "; ".join(estimate.caveats),
    }
    if estimate.ellipse is not None:
        row |= {f"ellipse_{name}": value for name, value in estimate.ellipse._asdict().items()}
    if estimate.normal is None or estimate.centre_m is None:
        return [row]
    return [row | _candidate(estimate, k) for k in range(len(estimate.normal))]


def _candidate(estimate: Estimate, k: int) -> dict[str, Any]:
    record = candidate_record(estimate, k)
    shared = ("probability", "distance_m", "distance_sigma_m", "tilt_deg", "azimuth_deg", "normal_sigma_deg")
    return {
        "candidate": k,
        "chosen": estimate.chosen == k,
        **{name: record.get(name) for name in shared},
        **dict(zip(("normal_x", "normal_y", "normal_z"), record["normal"], strict=True)),
        **dict(zip(("centre_x_m", "centre_y_m", "centre_z_m"), record["centre_m"], strict=True)),
    }
