"""The scores of a report, run by run, in the order of the page's markers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from roundel.datasets.dataset import Dataset
from roundel.scenes.camera.intrinsics_label import IntrinsicsLabel
from roundel.scenes.display_text import NAME_LIMIT, clean
from roundel.scenes.errors import DataError, NotComparableError
from roundel.validate.browse.frames import Variable, numbers, texts
from roundel.validate.metrics.rows import circle_keys, in_memory
from roundel.validate.scores.report_files import SCORES, read_report_files
from roundel.validate.scores.scores import KEY, SCORES_SCHEMA
from roundel.validate.scores.summary import CHESSBOARD, main_key, run_keys, run_rows

ERRORS = (
    Variable("oracle_normal_error_deg", "Normal error", "\N{DEGREE SIGN}", filtered=True),
    Variable("oracle_position_error_pct", "Position error", "% of distance", filtered=True),
)
_REASON_LIMIT = 300


class ReportScores:
    """The scores of a report that is of this dataset.

    Raises
    ------
    UsageError
        If there is no report.
    DataError
        If it is damaged.
    NotComparableError
        If it is of another dataset, or of other images of the same.
    """

    def __init__(self, path: str | Path, dataset: Dataset) -> None:
        facts, self._table = read_report_files(path)
        _check_dataset(path, facts, dataset)
        _check_columns(path, self._table)
        self.runs = run_keys(self._table)
        if not self.runs:
            raise NotComparableError(f"{path}: the report has no scores; validate the dataset again")
        asked = (dataset.study.get("solve") or {}).get("methods") or []
        main = main_key(self.runs, asked)
        # The run that the page opens with.
        self.main = self.runs.index(main) if main in self.runs else 0

    def described(self) -> dict[str, Any]:
        """The runs and errors as the page lists them."""
        return {
            "runs": [_title(*run) for run in self.runs],
            "run": self.main,
            "errors": [asdict(error) for error in ERRORS],
        }

    def records(self, circles: NDArray[np.void]) -> Iterator[dict[str, Any]]:
        """A record for each run: `solved` (1, 0, null for a marker without a score), `reason`, and the errors.

        Parameters
        ----------
        circles : array of (frame_id, marker_id)
            The page's markers, sorted.
        """
        for run in self.runs:
            rows = run_rows(self._table, run)
            of = circle_keys(rows)
            at = np.searchsorted(of, circles)
            there = np.zeros(len(circles), dtype=bool)
            inside = at < len(of)
            there[inside] = of[at[inside]] == circles[inside]
            # A null index takes a row of nulls.
            mine = in_memory(rows, pa.array(at, mask=~there))
            yield {
                "solved": [None if flag is None else int(flag) for flag in mine["solved"].to_pylist()],
                "reason": texts(mine, "reason", _REASON_LIMIT),
                **{error.key: numbers(mine, error.key) for error in ERRORS},
            }


def _title(method: str, intrinsics: str, reference: str) -> str:
    name = "the chessboard's own pose" if method == CHESSBOARD else clean(method, NAME_LIMIT)
    against = "" if reference == "truth" else ", against the chessboard"
    return f"{name}, {clean(IntrinsicsLabel.of(intrinsics).title, NAME_LIMIT)}{against}"


def _check_dataset(path: str | Path, facts: dict[str, Any], dataset: Dataset) -> None:
    scored = facts.get("dataset") or {}
    theirs, ours = str(scored.get("dataset_id")), str(dataset.manifest["dataset_id"])
    if theirs != ours:
        raise NotComparableError(
            f"{path}: the report is of dataset {clean(theirs, 12)}, not of {ours[:12]}; give a report of this dataset"
        )
    # A part of a dataset, fetched or not finished, has fewer images than the report.
    images = facts["checksums"].get("images")
    if dataset.images.complete and images != dataset.images.images_sha256:
        raise NotComparableError(f"{path}: the report is of other images of this dataset; validate the dataset again")


def _check_columns(path: str | Path, scores: pa.Table) -> None:
    for name in (*KEY, "solved", "reason", *(error.key for error in ERRORS)):
        if name not in scores.column_names:
            raise NotComparableError(f"{path}: its scores have no column {name}; validate the dataset again")
        if scores.schema.field(name).type != SCORES_SCHEMA.field(name).type:
            place = Path(path) / SCORES
            raise DataError(f"{place}: the column {name} is not as Roundel writes it; validate the dataset again")
