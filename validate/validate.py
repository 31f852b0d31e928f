"""`roundel validate`: estimates against the truth, to scores.parquet, summary.json, report.html and its
figures and tables as files.

The same dataset and estimates give the same bytes at any time and place, because no file contains a time or a path.
"""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from roundel.datasets.dataset import Dataset, open_dataset
from roundel.datasets.layout.files import check_no_dataset
from roundel.datasets.store.addresses import Address
from roundel.datasets.store.folder import Folder
from roundel.datasets.store.records import document_of
from roundel.datasets.store.writing import clear_leftovers, new_file, sha256, write_file
from roundel.scenes.blas_threads import one_blas_thread
from roundel.scenes.errors import DataError, NotComparableError, UsageError
from roundel.validate.by_shard import ShardScores, ShardScoring, score_by_shard
from roundel.validate.calibration.camera_errors import calibration_summary
from roundel.validate.calibration.opencv import (
    BoardView,
    calibrate_views,
    calibration_group,
    look_for_boards,
    read_camera,
)
from roundel.validate.calibration.study_calibrations import Calibrations, several_calibrations
from roundel.validate.claims.calibration_benefit import CalibrationBenefit, calibration_benefit
from roundel.validate.claims.calibration_benefit_text import benefit_record
from roundel.validate.claims.robustness import sweep_summary, sweeps_of
from roundel.validate.claims.verdicts import Verdict, verdict_record, verdicts_of
from roundel.validate.diagnosis.diagnosis import Diagnosis, diagnose
from roundel.validate.estimates.reader import find_estimates
from roundel.validate.figures.calibration import calibration_pictures
from roundel.validate.figures.calibration_benefit import benefit_pictures
from roundel.validate.figures.error_curves import pictures
from roundel.validate.figures.errors_by_variable import variable_pictures
from roundel.validate.figures.overlays import worst, worst_stated_overlays
from roundel.validate.figures.paired_levels import LEVELS, change_pictures, level_pairs
from roundel.validate.figures.reliability import reliability_pictures
from roundel.validate.figures.robustness import sweep_pictures, title_of
from roundel.validate.figures.side_by_side import method_pairs, pair_tables, runs_to_compare, side_by_side_pictures
from roundel.validate.figures.svg import Picture
from roundel.validate.figures.uncertainty import uncertainty_pictures
from roundel.validate.figures.verdicts import verdict_pictures
from roundel.validate.figures.writers import write_figures
from roundel.validate.report.report import Overlays, Pictures, render_report
from roundel.validate.report.summary_text import main_run
from roundel.validate.scores.false_positives import false_positives_parquet
from roundel.validate.scores.report_files import FALSE_POSITIVES, SCORES, SUMMARY
from roundel.validate.scores.scores import Scores
from roundel.validate.scores.scores_on_disk import ScoresOnDisk
from roundel.validate.scores.summary import Summary, summarise, summary_record
from roundel.validate.tables.report import NAMES, report_tables
from roundel.validate.tables.table import Table
from roundel.validate.tables.uncertainty import worst_stated_table
from roundel.validate.tables.writers import write_tables

REPORT = "report.html"


@one_blas_thread()
def validate_dataset(
    dataset_path: Address,
    estimates_paths: Sequence[str | Path],
    out_path: str | Path,
    extent_D: float = 3.0,
    camera_path: str | Path | None = None,
    progress: Callable[[int, int], None] | None = None,
    jobs: int = 1,
    scheduler: str | None = None,
) -> Summary:
    """Score estimates and write the report.

    Parameters
    ----------
    dataset_path : path
    estimates_paths : sequence of path
        Files, or folders with an `estimates.parquet`.
    out_path : path
        The report's folder; each of its files is written atomically.
    extent_D : float
        Half side of the reprojection error's grid, in marker diameters.
    camera_path : path, optional
        A camera file for the chessboard's pose; default: each frame's true camera.
    progress : callable, optional
        Called with (chessboards searched, total chessboards), then of several shards with (frames done, total frames).
    jobs : int
        Number of processes, if there are several shards; the bytes do not depend on it.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers score the shards instead.

    Returns
    -------
    Summary
        The contents of summary.json.

    Raises
    ------
    UsageError
        If a file does not exist, `extent_D` is not positive, `out_path` is a file or a dataset, or a camera is given
        for imported photographs.
    DataError
        If the dataset or an estimate is corrupt.
    NotComparableError
        If the estimates are of other frames, or there is nothing to score.

    Notes
    -----
    Estimates that are right but for a convention are scored as they are; `diagnoses` names it (see `diagnose`).
    """
    out = Path(out_path)
    _check_arguments(out, extent_D)
    dataset = open_dataset(dataset_path)
    files = [find_estimates(path) for path in estimates_paths]
    # Read even if no board needs it, because a missing file is always an error.
    reference_camera = None if camera_path is None else read_camera(camera_path)
    if dataset.reference is not None and camera_path is not None:
        raise UsageError(
            f"--camera: {dataset_path} holds imported photographs, whose reference poses are fixed; leave it out, or "
            "import them with --camera"
        )
    # The poses of imported photographs are those of their boards: to compare the two would say nothing.
    views = [] if dataset.reference is not None else look_for_boards(dataset.images, progress=progress)
    camera = "true" if camera_path is None else f"calibrated:{Path(camera_path).stem}"
    settings = {
        "reprojection_extent_D": float(extent_D),
        "reference_intrinsics": camera if views else None,
        "solve": dataset.study.get("solve"),
    }
    diagnosed = {file: its for file in files if (its := diagnose(file, dataset))}
    how = ShardScoring(files, extent_D, views, reference_camera, camera, frozenset(diagnosed))
    with ScoresOnDisk() as rows:
        found = score_by_shard(dataset, how, rows, progress, jobs, scheduler)
        false = false_positives_parquet(found.scores.false_detections)
        checksums = _checksums(dataset, files, {SCORES: rows.sha256, FALSE_POSITIVES: sha256(false)})
        diagnoses = [one for its in diagnosed.values() for one in its]
        return _write_report(dataset, found, views, settings, checksums, diagnoses, rows.parquet, false, out)


def _write_report(
    dataset: Dataset,
    found: ShardScores,
    views: list[BoardView],
    settings: dict[str, Any],
    checksums: dict[str, str],
    diagnoses: list[Diagnosis],
    parquet: Path,
    false: bytes,
    out: Path,
) -> Summary:
    """Statistics, figures, tables and the page of scores that are written as `parquet`, with the false positives."""
    scores = found.scores
    calibrations = _calibrations(dataset, views)
    benefit = calibration_benefit(scores.table, found.off_axis, found.board_rows)
    verdicts = verdicts_of(scores.table, dataset.study)
    summary = replace(
        summarise(dataset, scores, settings, found.circles, calibrations.whole),
        filled_in=found.filled_in,
        calibrations=calibrations.several.records if calibrations.several else [],
        calibration_subsets=calibrations.several.subsets if calibrations.several else [],
        benefit=benefit_record(benefit) if benefit else None,
        sweeps=sweep_summary(sweeps_of(scores.table, dataset.study)),
        verdicts=[verdict_record(verdict) for verdict in verdicts],
        checksums=checksums,
        caveats=found.caveats,
        diagnoses=[diagnosis.record() for diagnosis in diagnoses],
    )
    levels = pair_tables(level_pairs(runs_to_compare(scores.table, summary.runs), summary.sweeps), LEVELS)
    pictures = _pictures(dataset, scores, summary, benefit, verdicts, calibrations, levels)
    more = [*_compared(scores, summary), *levels, *(t for t in [worst_stated_table(scores.table)] if t.rows)]
    overlays = Overlays(worst(dataset, scores), worst_stated_overlays(dataset, scores))
    html = render_report(summary, pictures, overlays, more)
    # Without its summary a folder is no report: it comes last, and that of an earlier report goes first.
    Folder(out).make()
    clear_leftovers(out)
    Folder(out).remove(SUMMARY)
    with new_file(out / SCORES) as file, parquet.open("rb") as written:
        shutil.copyfileobj(written, file)
    write_file(out / FALSE_POSITIVES, false)
    write_file(out / REPORT, html.encode())
    write_figures(out, pictures.all())
    write_tables(out, [*report_tables(summary).values(), *more], NAMES)
    write_file(out / SUMMARY, document_of(summary_record(summary)))
    return summary


@dataclass(frozen=True)
class _Calibrations:
    """OpenCV's calibrations from all views of the study's group, and from the numbers of views in the study."""

    whole: dict[str, Any] | None
    several: Calibrations | None


def _check_arguments(out: Path, extent_D: float) -> None:
    if not 0 < extent_D < float("inf"):
        raise UsageError(f"the extent of the reprojection grid must be a positive number of diameters, not {extent_D}")
    if out.exists() and not out.is_dir():
        raise UsageError(f"{out}: is a file; give a folder for the report")
    check_no_dataset(out)


def _calibrations(dataset: Dataset, views: list[BoardView]) -> _Calibrations:
    mine = _calibration_views(dataset, views)
    asked = (dataset.study.get("solve") or {}).get("intrinsics", ())
    return _Calibrations(_calibration(dataset, mine), several_calibrations(dataset, mine, asked))


def _pictures(
    dataset: Dataset,
    scores: Scores,
    summary: Summary,
    benefit: CalibrationBenefit | None,
    verdicts: list[Verdict],
    calibrations: _Calibrations,
    levels: list[Table],
) -> Pictures:
    """Every figure of the report."""
    main = main_run(summary)
    return Pictures(
        lead=benefit_pictures(benefit) if benefit else [],
        verdicts=verdict_pictures(scores.table, dataset.study, verdicts),
        errors=pictures(scores.table, main["method"]),
        sweeps=[*sweep_pictures(summary.sweeps), *_level_pictures(summary, levels)],
        matrix=variable_pictures(scores.table, main["method"], main["intrinsics"]),
        comparison=side_by_side_pictures(
            runs_to_compare(scores.table, summary.runs), "Methods and intrinsics side by side"
        ),
        calibration=calibration_pictures(calibrations.several),
        uncertainty=uncertainty_pictures(summary.runs),
        reliability=reliability_pictures(summary.runs),
    )


def _level_pictures(summary: Summary, levels: list[Table]) -> list[Picture]:
    """One figure of the differences between the levels of all sweeps."""
    titles = {title_of(sweep) for sweep in summary.sweeps}
    return change_pictures("levels", LEVELS.comparisons, levels, titles.pop() if len(titles) == 1 else "")


def _compared(scores: Scores, summary: Summary) -> list[Table]:
    """Tables that compare the methods with that of the main run."""
    return pair_tables(method_pairs(runs_to_compare(scores.table, summary.runs), main_run(summary)["method"]))


def _checksums(dataset: Dataset, files: Sequence[Path], own: dict[str, str]) -> dict[str, str]:
    """sha256 of the report's own tables, of their inputs, and of all images together."""
    return {
        **own,
        **{f"estimates {i}" if len(files) > 1 else "estimates": _digest(f) for i, f in enumerate(files, start=1)},
        **{name: listed.sha256 for name, listed in dataset.contents.own.items() if "/" not in name},
        "truth.parquet": dataset.truth_sha256,
        "images": dataset.images.images_sha256,
    }


def _digest(file: Path) -> str:
    try:
        with file.open("rb") as opened:
            return hashlib.file_digest(opened, "sha256").hexdigest()
    except OSError as error:
        raise DataError(f"{file}: cannot be read: {error.strerror}") from error


def _calibration_views(dataset: Dataset, views: list[BoardView]) -> list[BoardView]:
    """The views of the study's calibration group."""
    asked = (dataset.study.get("solve") or {}).get("calibrate_from")
    group = calibration_group(dataset.images, asked) if views else None
    return [view for view in views if view.group == group]


def _calibration(dataset: Dataset, views: list[BoardView]) -> dict[str, Any] | None:
    """The calibration from these views, compared with the truth; None if the study has no views for it."""
    if not views:
        return None
    try:
        return calibration_summary(dataset, views, calibrate_views(views))
    except NotComparableError as error:
        return {"group": views[0].group, "views": len(views), "reason": str(error)}
