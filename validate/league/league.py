"""The league's page: outcomes of every entry to league.html, figures, tables, league.json and outcomes.parquet."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from roundel.datasets.dataset import Dataset
from roundel.datasets.store.writing import sha256, write_file
from roundel.scenes.errors import NotComparableError
from roundel.validate.estimates.runs import read_runs
from roundel.validate.figures.writers import write_figures
from roundel.validate.league.entries import Entry
from roundel.validate.league.figure import league_pictures
from roundel.validate.league.outcomes import frames_of_league, outcomes_of
from roundel.validate.league.standings import standings_of
from roundel.validate.league.tables import NAMES, league_tables
from roundel.validate.report.html import Tables, figures, fill
from roundel.validate.tables.writers import write_tables

OUTCOMES, RECORD, PAGE = "outcomes.parquet", "league.json", "league.html"
SCHEMA = 1


@dataclass(frozen=True)
class Solved:
    """Estimates of an entry: their folder, with `estimates.parquet` and `timings.jsonl`."""

    entry: Entry
    folder: Path


def outcomes_of_entries(dataset: Dataset, solved: Sequence[Solved]) -> pa.Table:
    """Outcomes of every entry on the frames of its variants.

    Raises
    ------
    NotComparableError
        If the dataset has no groups `CONDITION.VARIANT`, or the estimates are of another dataset.
    """
    truth = frames_of_league(dataset)
    if not truth:
        raise NotComparableError(
            f"{dataset.address}: no group is named CONDITION.VARIANT; give a dataset of the study `league`"
        )
    tables = []
    for one in solved:
        times = _times_ms(one.folder / "timings.jsonl")
        for run in read_runs([one.folder / "estimates.parquet"], dataset):
            tables.append(outcomes_of(one.entry.name, one.entry.variants, run, truth, times))
    return pa.concat_tables(tables)


def _times_ms(file: Path) -> dict[int, float]:
    if not file.is_file():
        return {}
    records = (json.loads(line) for line in file.read_text(encoding="utf-8").splitlines())
    return {int(r["frame_id"]): 1e3 * (r["detect_s"] + r["pose_s"]) for r in records}


def write_league(dataset: Dataset, outcomes: pa.Table, out: Path, left_out: Sequence[str] = ()) -> dict[str, Any]:
    """Write the page, and what machines read.

    Parameters
    ----------
    dataset : Dataset
    outcomes : pa.Table
        See `outcomes_of`.
    out : Path
        Folder.
    left_out : sequence of str
        Methods that are not installed.

    Returns
    -------
    dict
        The contents of league.json: the dataset's identity and checksums, and the standings.
    """
    standings = standings_of(outcomes)
    buffer = io.BytesIO()
    pq.write_table(outcomes, buffer, compression="zstd")
    record = {
        "schema": SCHEMA,
        "roundel": version("roundel"),
        "dataset": identity_of_dataset(dataset),
        "left_out": list(left_out),
        "outcomes_sha256": sha256(buffer.getvalue()),
        "standings": [standing.record() for standing in standings],
    }
    pictures, tables = league_pictures(standings), league_tables(standings)
    page = fill(
        "league.html.j2",
        title="League",
        dataset=record["dataset"],
        pictures=figures(pictures),
        tables=Tables({table.name: table for table in tables}),
        left_out=", ".join(left_out),
        version=record["roundel"],
    )
    write_file(out / OUTCOMES, buffer.getvalue())
    write_file(out / RECORD, (json.dumps(record, indent=1, allow_nan=False) + "\n").encode())
    write_file(out / PAGE, page.encode())
    write_figures(out, pictures)
    write_tables(out, tables, NAMES)
    return record


def identity_of_dataset(dataset: Dataset) -> dict[str, Any]:
    """What tells one league from another: dataset_id, number of frames, and checksums of truth and images together."""
    return {
        "dataset_id": dataset.manifest["dataset_id"],
        "frames": len(dataset),
        "truth_sha256": dataset.truth_sha256,
        "images_sha256": dataset.images.images_sha256,
    }
