"""summary.json and scores.parquet, read again and held against their checksums."""

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
from roundel.validate.scores.summary import SCHEMA
from roundel.validate.scores.summary_schema import SummaryRecord

SCORES, SUMMARY = "scores.parquet", "summary.json"


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
    remedy = "validate the dataset again"
    facts = _summary(folder, remedy)
    data = folder.read(SCORES)
    checksums = facts.get("checksums")
    if not isinstance(checksums, dict) or checksums.get(SCORES) != sha256(data):
        raise DataError(f"{path}: {SCORES} is not the file that {SUMMARY} was made from; {remedy}")
    if facts.get("schema") == SCHEMA:
        checked(SummaryRecord, facts, f"{folder.place(SUMMARY)}")
    try:
        return facts, pq.ParquetFile(pa.BufferReader(data)).read(use_threads=False)
    except (OSError, ValueError, pa.ArrowException) as error:
        raise DataError(f"{folder.place(SCORES)}: damaged ({first_line(error)}); {remedy}") from error


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
