"""`roundel validate`: estimates against the truth, to scores.parquet, summary.json, report.html and its
figures and tables as files.

The same dataset and estimates give the same bytes, whenever and wherever they are scored: no file holds a time or a
path.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from roundel.datasets.dataset import Dataset, open_dataset
from roundel.datasets.layout.files import POINTS, check_no_dataset, sha256, write_file
from roundel.scenes.errors import DataError, NotComparableError, UsageError
from roundel.validate.calibration.camera_errors import calibration_summary
from roundel.validate.calibration.chessboard_reference import reference_of
from roundel.validate.calibration.opencv import (
    BoardView,
    calibrate_views,
    calibration_group,
    look_for_boards,
    read_camera,
)
from roundel.validate.calibration.study_calibrations import several_calibrations
from roundel.validate.claims.calibration_benefit import off_axis_deg, worth_of
from roundel.validate.claims.calibration_benefit_text import worth_record
from roundel.validate.claims.robustness import sweep_summary, sweeps_of
from roundel.validate.claims.verdicts import verdicts_of
from roundel.validate.estimates.reader import find_estimates
from roundel.validate.estimates.runs import read_runs
from roundel.validate.figures.calibration import calibration_pictures
from roundel.validate.figures.calibration_benefit import worth_picture
from roundel.validate.figures.error_curves import pictures
from roundel.validate.figures.errors_by_variable import matrix_pictures
from roundel.validate.figures.overlays import worst
from roundel.validate.figures.robustness import sweep_pictures
from roundel.validate.figures.side_by_side import entries_of, method_pairs, pair_tables, side_by_side_pictures
from roundel.validate.figures.verdicts import verdict_pictures
from roundel.validate.figures.writers import write_figures
from roundel.validate.metrics.ground_truth import true_targets
from roundel.validate.report.report import Pictures, render_report
from roundel.validate.report.summary_text import main_run
from roundel.validate.scores.scores import Scores, score, sorted_scores
from roundel.validate.scores.summary import summarise
from roundel.validate.tables.report import NAMES, report_tables
from roundel.validate.tables.writers import write_tables

SCORES, SUMMARY, REPORT = "scores.parquet", "summary.json", "report.html"


def validate_dataset(
    dataset_path: str | Path,
    estimates_paths: Sequence[str | Path],
    out_path: str | Path,
    extent_D: float = 3.0,
    camera_path: str | Path | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """Score estimates and write the report.

    Parameters
    ----------
    dataset_path : path
    estimates_paths : sequence of path
        Files, or folders that hold an `estimates.parquet`.
    out_path : path
        The report's folder; each of its files is written whole or not at all.
    extent_D : float
        Half the side of the reprojection error's grid, in marker diameters.
    camera_path : path, optional
        A camera file for the chessboard's pose; each frame's true camera without one.
    progress : callable, optional
        Called with (chessboards looked at, chessboards in all).

    Returns
    -------
    dict
        What summary.json holds.

    Raises
    ------
    UsageError
        If a file does not exist, `extent_D` is no positive number, or `out_path` is a file or a dataset.
    DataError
        If the dataset or an estimate is corrupt.
    NotComparableError
        If the estimates are of other frames, or there is nothing to score.
    """
    if not 0 < extent_D < float("inf"):
        raise UsageError(f"the extent of the reprojection grid must be a positive number of diameters, not {extent_D}")
    out = Path(out_path)
    if out.exists() and not out.is_dir():
        raise UsageError(f"{out}: is a file; name a folder for the report")
    check_no_dataset(out)
    dataset = open_dataset(dataset_path)
    files = [find_estimates(path) for path in estimates_paths]
    runs = read_runs(files, dataset)
    camera = None if camera_path is None else read_camera(camera_path)
    label = "true" if camera_path is None else f"calibrated:{Path(camera_path).stem}"
    targets = true_targets(dataset, extent_D)
    views = look_for_boards(dataset.images, progress=progress)
    reference = reference_of(dataset, views, targets, camera, label) if views else None
    scores = score(dataset, targets, runs, reference.circles if reference else None)
    if reference and reference.rows.num_rows:
        table = sorted_scores(pa.concat_tables([scores.table, reference.rows]))
        scores = Scores(table, scores.false_detections, scores.matched)
    settings = {
        "reprojection_extent_D": float(extent_D),
        "reference_intrinsics": label if views else None,
        "solve": dataset.study.get("solve"),
    }
    # What files of others leave out is in the record, not in the settings: it makes no two reports unlike.
    filled = {f"{run.method}, {run.intrinsics}": list(run.filled) for run in runs if run.filled}
    mine = _calibration_views(dataset, views)
    summary = summarise(dataset, scores, settings, _calibration(dataset, mine))
    summary["filled_in"] = filled
    calibrations = several_calibrations(dataset, mine, (dataset.study.get("solve") or {}).get("intrinsics", ()))
    summary["calibrations"] = calibrations.records if calibrations else []
    summary["calibration_subsets"] = calibrations.subsets if calibrations else []
    worth = worth_of(scores.table, off_axis_deg(targets.truth), reference.circle_rows if reference else None)
    summary["worth"] = worth_record(worth) if worth else None
    summary["sweeps"] = sweep_summary(sweeps_of(scores.table, dataset.study))
    summary["verdicts"] = verdicts_of(scores.table, dataset.study)
    sink = io.BytesIO()
    pq.write_table(scores.table, sink, compression="zstd")
    summary["checksums"] = {
        SCORES: sha256(sink.getvalue()),
        **{f"estimates {i}" if len(files) > 1 else "estimates": _digest(f) for i, f in enumerate(files, start=1)},
        **{name: record["sha256"] for name, record in dataset.manifest["files"].items() if "/" not in name},
        "images": _digest_of_images(dataset),
    }
    main, entries = main_run(summary), entries_of(scores.table, summary["runs"])
    drawn = Pictures(
        lead=[worth_picture(worth)] if worth else [],
        verdicts=verdict_pictures(scores.table, dataset.study, summary["verdicts"]),
        errors=pictures(scores.table, main["method"]),
        sweeps=sweep_pictures(summary["sweeps"]),
        matrix=matrix_pictures(scores.table, main["method"], main["intrinsics"]),
        comparison=side_by_side_pictures(entries, "Methods and intrinsics side by side"),
        calibration=calibration_pictures(calibrations),
    )
    compared = pair_tables(method_pairs(entries, main["method"]))
    html = render_report(summary, drawn, worst(dataset, scores), compared)
    write_file(out / SCORES, sink.getvalue())
    write_file(out / SUMMARY, (json.dumps(summary, indent=1, allow_nan=False) + "\n").encode())
    write_file(out / REPORT, html.encode())
    write_figures(out, drawn.all())
    write_tables(out, [*report_tables(summary).values(), *compared], NAMES)
    return summary


def _digest_of_images(dataset: Dataset) -> str:
    """One checksum over those of all images, or of the points: whether two reports saw the same pixels."""
    files = dataset.manifest["files"]
    seen = [f"{name} {files[name]['sha256']}" for name in sorted(files) if name.startswith("images/") or name == POINTS]
    return sha256("\n".join(seen).encode())


def _digest(file: Path) -> str:
    try:
        return sha256(file.read_bytes())
    except OSError as error:
        raise DataError(f"{file}: cannot be read: {error.strerror}") from error


def _calibration_views(dataset: Dataset, views: list[BoardView]) -> list[BoardView]:
    """Those of the group that the study calibrates from."""
    asked = (dataset.study.get("solve") or {}).get("calibrate_from")
    group = calibration_group(dataset.images, asked) if views else None
    return [view for view in views if view.group == group]


def _calibration(dataset: Dataset, views: list[BoardView]) -> dict[str, Any] | None:
    """The calibration that these views give, beside the truth; None where the study has no views for one."""
    if not views:
        return None
    try:
        return calibration_summary(dataset, views, calibrate_views(views))
    except NotComparableError as error:
        return {"group": views[0].group, "views": len(views), "reason": str(error)}
