"""Baselines: accepted scores in one small Parquet file for git.

A row is one circle with one method and one kind of intrinsics. The file's metadata identify what the rows may be
compared with, and record who accepted them and why.
"""

from __future__ import annotations

import hashlib
import io
import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from roundel.datasets.store.folder import Folder
from roundel.datasets.store.lock import one_at_a_time
from roundel.datasets.store.writing import sha256, write_file
from roundel.scenes.errors import DataError, NotComparableError, UsageError, first_line
from roundel.validate.gate.quantities import (
    CHI2,
    CHOICE,
    CONFIDENCE,
    DETECTED,
    MIN_CIRCLES,
    ORACLE_BRANCH,
    SCORE,
)
from roundel.validate.metrics.metric import CONTOUR, NORMAL, POSE, POSITION_M, SHIFT_X, SHIFT_Y
from roundel.validate.scores.report_files import read_false_positives, read_report_files

SCHEMA = 2
KEY = ("frame_id", "marker_id", "method", "intrinsics")
ERRORS = tuple(m.oracle for m in (POSE, NORMAL, POSITION_M, CONTOUR, SHIFT_X, SHIFT_Y))
BOUNDS = tuple(dict.fromkeys(m.bound for m in (NORMAL, POSITION_M, CONTOUR)))
_COLUMNS = (*KEY, "group", "solved", "branch_correct", *ERRORS, *BOUNDS)
_FALSE = pa.schema(
    [
        ("method", pa.string()),
        ("intrinsics", pa.string()),
        ("frame_id", pa.int64()),
        ("confidence", pa.float64()),
    ]
)
# Columns that older versions do not have: what is not on both sides is not compared.
_LATER = (SCORE, CHI2, *CHOICE, ORACLE_BRANCH, DETECTED, CONFIDENCE)
_METADATA = b"roundel_baseline"
# Seven digits are enough for a comparison, at half the size in git.
_SINGLE = (*ERRORS, *BOUNDS, SCORE, CHI2, CHOICE[0], CONFIDENCE)


@dataclass(frozen=True)
class Baseline:
    """Scores to compare with.

    Attributes
    ----------
    rows : pyarrow.Table
        Sorted by `KEY`.
    dataset_id, images, settings : str
        Identity of the dataset, digest of its images, hash of the validator's settings.
    metric_version : int
    accepted : list of dict
        `{reason, roundel}` of every acceptance, in order of time.
    false_positives : pyarrow.Table or None
        Detections that match no marker; None if an older version wrote the file.
    """

    rows: pa.Table
    dataset_id: str
    images: str
    settings: str
    metric_version: int
    accepted: list[dict[str, str]]
    false_positives: pa.Table | None = None


def baseline_of_report(report: str | Path) -> Baseline:
    """The scores of a report, as a baseline that is not yet accepted.

    Raises
    ------
    UsageError
        If there is no report.
    DataError
        If it is corrupt, scores a circle twice, or is from a version that lacks data for the gate.
    NotComparableError
        If it scored nothing.
    """
    folder = Path(report)
    folder = folder.parent if folder.is_file() else folder
    facts, table = read_report_files(folder)
    try:
        settings = hashlib.sha256(json.dumps(facts["settings"], sort_keys=True).encode()).hexdigest()
        identity = facts["dataset"]["dataset_id"], facts["checksums"]["images"], settings
        version, roundel = int(facts["metric_version"]), str(facts["versions"]["validate"]["roundel"])
        rows = baseline_of_scores(table)
        false = read_false_positives(folder, facts)
    except (OSError, ValueError, KeyError, TypeError, pa.ArrowException) as error:
        reason = first_line(error)
        raise DataError(
            f"{folder}: not a report that a gate can read ({reason}); validate the dataset again"
        ) from error
    _check_rows(rows, folder)
    found = None if false is None else baseline_of_false_positives(false)
    return Baseline(rows, *identity, version, [{"reason": "", "roundel": roundel}], found)


def baseline_of_scores(scores: pa.Table) -> pa.Table:
    """Rows of a baseline: the columns of scores.parquet that a gate compares, against the truth, sorted by `KEY`."""
    rows = scores.filter(pc.equal(scores["reference"], "truth")).select(_columns_in(scores))
    for name in set(_SINGLE) & set(rows.column_names):
        at = rows.column_names.index(name)
        rows = rows.set_column(at, name, rows[name].cast(pa.float32()))
    return rows.sort_by([(name, "ascending") for name in KEY]).combine_chunks()


def baseline_of_false_positives(false: pa.Table) -> pa.Table:
    """The columns of false_positives.parquet that a gate compares, in an order that depends on the rows alone."""
    # Seven digits, as of other numbers: the text of more would be half of the file.
    confidence = [None if c is None else float(f"{c:.7g}") for c in false[CONFIDENCE].to_pylist()]
    rows = false.select(_FALSE.names)
    rows = rows.set_column(rows.column_names.index(CONFIDENCE), CONFIDENCE, pa.array(confidence, pa.float64()))
    return rows.cast(_FALSE).sort_by([(name, "ascending") for name in _FALSE.names]).combine_chunks()


def _false_record(false: pa.Table) -> list[dict[str, Any]]:
    """False positives as JSON: for each run its frames and confidences."""
    runs: dict[tuple[str, str], dict[str, Any]] = {}
    for row in false.to_pylist():
        key = row["method"], row["intrinsics"]
        run = runs.setdefault(key, {"method": key[0], "intrinsics": key[1], "frame_id": [], "confidence": []})
        run["frame_id"].append(row["frame_id"])
        run["confidence"].append(row["confidence"])
    return list(runs.values())


def _false_of_record(record: list[dict[str, Any]]) -> pa.Table:
    tables = [_FALSE.empty_table()]
    for run in record:
        n = len(run["frame_id"])
        columns = {**run, "method": [run["method"]] * n, "intrinsics": [run["intrinsics"]] * n}
        tables.append(pa.table({name: columns[name] for name in _FALSE.names}, schema=_FALSE))
    return pa.concat_tables(tables).combine_chunks()


def _columns_in(table: pa.Table) -> list[str]:
    """The columns of a baseline that a table has; the older ones must be there."""
    return [*_COLUMNS, *(name for name in _LATER if name in table.column_names)]


def _check_rows(rows: pa.Table, source: Path) -> None:
    """Check that there are scores, exactly one per circle and run."""
    if rows.num_rows == 0:
        raise NotComparableError(f"{source}: no scores, so there is nothing to compare")
    keys = rows.select(list(KEY))
    if keys.group_by(list(KEY)).aggregate([]).num_rows < rows.num_rows:
        raise DataError(f"{source}: a circle is scored twice in one run; validate the dataset again")


def write_baseline(baseline: Baseline, path: str | Path) -> None:
    """Write a baseline atomically; the same scores give the same bytes."""
    facts: dict[str, Any] = {
        "schema": SCHEMA,
        "metric_version": baseline.metric_version,
        "dataset_id": baseline.dataset_id,
        "images": baseline.images,
        "settings": baseline.settings,
        "accepted": baseline.accepted,
    }
    if baseline.false_positives is not None:
        # A few rows of another kind: beside the table, not in it.
        facts["false_positives"] = _false_record(baseline.false_positives)
    facts["sha256"] = _checksum(baseline.rows, facts)
    sink = io.BytesIO()
    table = baseline.rows.replace_schema_metadata({_METADATA: json.dumps(facts).encode()})
    pq.write_table(table, sink, compression="zstd", compression_level=19)
    write_file(path, sink.getvalue())


def _checksum(rows: pa.Table, facts: dict[str, Any]) -> str:
    """sha256 over the rows and what the file says of them."""
    sink = io.BytesIO()
    # Made anew from their values: what memory holds where a value is null would count, and Parquet does not keep it.
    bare = pa.table({name: pa.array(rows[name].to_pylist(), rows[name].type) for name in rows.column_names})
    with pa.ipc.new_stream(sink, bare.schema) as writer:
        writer.write_table(bare)
    return sha256(json.dumps(facts, sort_keys=True).encode() + sink.getvalue())


def read_baseline(path: str | Path) -> Baseline:
    """Read a baseline.

    Raises
    ------
    UsageError
        If there is no such file.
    DataError
        If it is corrupt or not a baseline, or scores a circle twice.
    NotComparableError
        If it is empty, or another version of Roundel wrote it in another format.
    """
    file = Path(path)
    if not file.is_file():
        raise UsageError(f"{file}: there is no such baseline; `roundel baseline accept` writes one")
    try:
        table = pq.ParquetFile(pa.BufferReader(Folder(file.parent).read(file.name))).read(use_threads=False)
        facts = json.loads((table.schema.metadata or {})[_METADATA])
        schema = facts["schema"]
        if schema != SCHEMA:
            raise NotComparableError(f"{file}: the baseline has format {schema}, not {SCHEMA}; accept a new one")
        rows = table.replace_schema_metadata(None).select(_columns_in(table))
        # Baselines of older versions have no checksum.
        if "sha256" in facts and facts.pop("sha256") != _checksum(rows, facts):
            raise DataError(f"{file}: damaged: its checksum does not match; restore it, or accept a new one")
        _check_rows(rows, file)
        identity = str(facts["dataset_id"]), str(facts["images"]), str(facts["settings"])
        known = facts.get("false_positives")
        false = None if known is None else _false_of_record(known)
        return Baseline(rows, *identity, int(facts["metric_version"]), list(facts["accepted"]), false)
    except (OSError, ValueError, KeyError, TypeError, pa.ArrowException) as error:
        reason = first_line(error)
        raise DataError(f"{file}: not a baseline, or damaged ({reason})") from error


def accept(report: str | Path, path: str | Path, reason: str) -> Baseline:
    """Make the scores of a report the baseline; its history keeps earlier acceptances.

    Raises
    ------
    UsageError
        If no reason is given, or there is no report.
    NotComparableError
        If too few circles are solved for a verdict.
    """
    if not reason.strip():
        raise UsageError("--reason: state why these scores are right; the reason is kept in the history")
    new = baseline_of_report(report)
    solved = new.rows.filter(new.rows["solved"]).group_by(["method", "intrinsics"]).aggregate([([], "count_all")])
    most = max(solved["count_all"].to_pylist(), default=0)
    if most < MIN_CIRCLES:
        raise NotComparableError(f"{report}: {most} circles are solved; a verdict needs {MIN_CIRCLES}")
    # Others may accept at the same time: each reason is kept.
    with one_at_a_time(Path(path).with_name(f".{Path(path).name}.lock")):
        history = read_baseline(path).accepted if Path(path).is_file() else []
        accepted = [*history, {"reason": " ".join(reason.split()), "roundel": new.accepted[0]["roundel"]}]
        baseline = replace(new, accepted=accepted)
        write_baseline(baseline, path)
    return baseline
