"""A submission to the league: estimates of an outside method, checked, and scored like every other entry."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

from roundel.datasets.dataset import Dataset
from roundel.scenes.errors import DataError, NotComparableError, UsageError
from roundel.validate.estimates.reader import dataset_of, find_estimates, read_estimates
from roundel.validate.estimates.runs import Run, read_runs
from roundel.validate.league.league import OUTCOMES, RECORD, identity_of_dataset
from roundel.validate.league.outcomes import OUTCOMES as OUTCOMES_SCHEMA
from roundel.validate.league.outcomes import FrameTruth, frames_of_league, outcomes_of

ID_COLUMN = "dataset_id"
_SHORTEST_ID = 12


def submitted_outcomes(submission: str | Path, dataset: Dataset, name: str | None = None) -> pa.Table:
    """Outcomes of a submission on all frames of the variants that it takes part in.

    Parameters
    ----------
    submission : path
        A CSV or Parquet file of estimates, or a folder with one.
    dataset : Dataset
    name : str, optional
        Name of the entry; default: the method's.

    Raises
    ------
    UsageError
        If the file is not one of estimates, does not say of which dataset, or holds several methods and one name is
        given.
    NotComparableError
        If it is of another dataset, or lacks frames of a variant.
    DataError
        If it is damaged.
    """
    file = find_estimates(submission)
    _check_dataset(file, dataset)
    truth = frames_of_league(dataset)
    if not truth:
        raise NotComparableError(
            f"{dataset.address}: no group is named CONDITION.VARIANT; give a dataset of the league"
        )
    runs, tables = read_runs([file], dataset), []
    methods = sorted({run.method for run in runs})
    if name is not None and len(methods) > 1:
        raise UsageError(f"{file}: holds {len(methods)} methods ({', '.join(methods)}); leave out --name, or split it")
    for run in runs:
        variants = _variants(file, run, truth)
        tables.append(outcomes_of(name or run.method, variants, run, truth))
    return pa.concat_tables(tables)


def _check_dataset(file: Path, dataset: Dataset) -> None:
    here = str(dataset.manifest["dataset_id"])
    if dataset_of(read_estimates(file)) is not None:
        return  # `read_runs` compares it
    ids = _id_column(file)
    if ids is None:
        raise UsageError(
            f"{file}: does not say of which dataset it is; add a column {ID_COLUMN} with {here[:_SHORTEST_ID]} in each "
            "row"
        )
    wrong = sorted({text for text in ids if len(text) < _SHORTEST_ID or not here.startswith(text)})
    if wrong:
        raise NotComparableError(
            f"{file}: it is of dataset {wrong[0][:_SHORTEST_ID]!r}, but {dataset.address} is {here[:_SHORTEST_ID]}; "
            "solve the images of this dataset"
        )


def _id_column(file: Path) -> set[str] | None:
    try:
        if file.suffix == ".csv":
            options = pa_csv.ConvertOptions(include_columns=[ID_COLUMN], column_types={ID_COLUMN: pa.string()})
            table = pa_csv.read_csv(file, convert_options=options)
        else:
            table = pq.read_table(file, columns=[ID_COLUMN])
        return {str(value or "") for value in table[ID_COLUMN].to_pylist()}
    except (KeyError, pa.ArrowException):
        return None


def _variants(file: Path, run: Run, truth: dict[int, FrameTruth]) -> tuple[str, ...]:
    """Variants with a row in the run; every frame of these needs one.

    Raises
    ------
    NotComparableError
        If one has none: leaving out hard frames would give an advantage.
    """
    there = set(run.frame_id.tolist())
    variants = tuple(dict.fromkeys(shown.variant for frame, shown in truth.items() if frame in there))
    if not variants:
        raise NotComparableError(f"{file}: has no frame of the league")
    for variant in variants:
        frames = [frame for frame, shown in truth.items() if shown.variant == variant]
        missing = [frame for frame in frames if frame not in there]
        if missing:
            raise NotComparableError(
                f"{file}: method {run.method} has no row for {len(missing)} of the {len(frames)} frames of {variant}, "
                f"the first {missing[0]}; give each frame a row, with its frame_id alone where nothing was found"
            )
    return variants


def published(folder: str | Path, dataset: Dataset) -> pa.Table:
    """Outcomes of a published league, which has to be of the same images and truth.

    Raises
    ------
    DataError
        If it is not the folder of a league, or damaged.
    NotComparableError
        If it is of other images or another truth.
    """
    import json

    from roundel.datasets.store.writing import sha256

    folder = Path(folder)
    try:
        record = json.loads((folder / RECORD).read_text(encoding="utf-8"))
        data = (folder / OUTCOMES).read_bytes()
        theirs, checksum = record["dataset"], record["outcomes_sha256"]
        table = pq.read_table(pa.BufferReader(data))
    except (OSError, ValueError, KeyError, TypeError, pa.ArrowException) as error:
        raise DataError(f"{folder}: not the folder of a league ({RECORD}, {OUTCOMES}), or damaged") from error
    if sha256(data) != checksum or table.schema.names != OUTCOMES_SCHEMA.names:
        raise DataError(f"{folder}: {OUTCOMES} is not the file that {RECORD} was made from")
    mine = identity_of_dataset(dataset)
    for key, what in (("dataset_id", "dataset"), ("truth_sha256", "truth"), ("images_sha256", "set of images")):
        if theirs.get(key) != mine[key]:
            raise NotComparableError(
                f"{folder}: its {what} is {str(theirs.get(key))[:12]}, that of {dataset.address} is {mine[key][:12]}; "
                "they cannot be compared"
            )
    return table
