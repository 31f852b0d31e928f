"""summary.json, scores.parquet and false_positives.parquet, read again and held against their checksums."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from roundel.datasets.layout.schema import checked
from roundel.datasets.store.folder import Folder
from roundel.datasets.store.records import KEY, record_of_document
from roundel.datasets.store.writing import sha256
from roundel.scenes.errors import DataError, UsageError, first_line
from roundel.validate.scores.false_positives import FALSE_POSITIVES_SCHEMA
from roundel.validate.scores.summary import SCHEMA
from roundel.validate.scores.summary_schema import SummaryRecord

SCORES, FALSE_POSITIVES, SUMMARY = "scores.parquet", "false_positives.parquet", "summary.json"
_REMEDY = "validate the dataset again"


def read_report_files(path: str | Path) -> tuple[dict[str, Any], pa.Table]:
    """The summary and the scores of a report.

    Raises
    ------
    UsageError
        If there is no report.
    DataError
        If one of them is damaged, or they do not belong together.
    """
    folder = Folder(Path(path))
    for name in (SCORES, SUMMARY):
        if not (folder.path / name).is_file():
            raise UsageError(f"{path}: not a report: it has no {name}; give a folder written by `roundel validate`")
    facts = _summary(folder, _REMEDY)
    table = _table(folder, facts, SCORES)
    if facts.get("schema") == SCHEMA:
        checked(SummaryRecord, facts, f"{folder.place(SUMMARY)}")
    return facts, table


def read_scores(path: str | Path) -> pa.Table:
    """The scores of a report: a row for each true circle, method, intrinsics and reference.

    Parameters
    ----------
    path : path
        The folder of the report.

    Returns
    -------
    pyarrow.Table
        `to_pandas` makes a data frame of it where pandas is installed.

    Raises
    ------
    UsageError
        If there is no report.
    DataError
        If it is damaged.
    """
    return read_report_files(path)[1]


def read_false_positives(path: str | Path, facts: dict[str, Any]) -> pa.Table | None:
    """The false positives of a report, a row of `FALSE_POSITIVES_SCHEMA` each; None if an older version wrote it.

    Parameters
    ----------
    path : path
    facts : dict
        Its summary, from `read_report_files`.

    Raises
    ------
    DataError
        If the file is damaged or missing.
    """
    if FALSE_POSITIVES not in facts["checksums"]:
        return None
    table = _table(Folder(Path(path)), facts, FALSE_POSITIVES)
    if table.schema != FALSE_POSITIVES_SCHEMA:
        raise DataError(f"{path}: {FALSE_POSITIVES} has not the columns that Roundel writes; {_REMEDY}")
    return table


def _table(folder: Folder, facts: dict[str, Any], name: str) -> pa.Table:
    """A table of the report, held against its checksum in the summary."""
    data = folder.read(name)
    checksums = facts.get("checksums")
    if not isinstance(checksums, dict) or checksums.get(name) != sha256(data):
        raise DataError(f"{folder.path}: {name} is not the file that {SUMMARY} was made from; {_REMEDY}")
    try:
        return pq.ParquetFile(pa.BufferReader(data)).read(use_threads=False)
    except (OSError, ValueError, pa.ArrowException) as error:
        raise DataError(f"{folder.place(name)}: damaged ({first_line(error)}); {_REMEDY}") from error


def _summary(folder: Folder, remedy: str) -> dict[str, Any]:
    data = folder.read(SUMMARY)
    try:
        return record_of_document(data)
    except ValueError as error:
        reason = first_line(error)
    # Reports of older versions have no checksum of their own.
    try:
        facts = json.loads(data)
    except (ValueError, RecursionError):
        facts = None
    if not isinstance(facts, dict) or KEY in facts:
        raise DataError(f"{folder.place(SUMMARY)}: damaged ({reason}); {remedy}")
    return facts
