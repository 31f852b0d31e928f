"""`roundel compare`: one page over several reports, paired by frame where they share a dataset or its radiance.

Reports with different metric versions or different extents of the reprojection grid are not compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa

from roundel.datasets.layout.files import check_no_dataset
from roundel.datasets.store.writing import write_file
from roundel.scenes.display_text import NAME_LIMIT, clean
from roundel.scenes.errors import DataError, NotComparableError, UsageError
from roundel.validate.claims.benefit_over_cameras import benefit_over_cameras
from roundel.validate.figures.paired_levels import SENSORS, change_pictures
from roundel.validate.figures.side_by_side import (
    ERRORS,
    NO_DIFFERENCE,
    Entry,
    Pair,
    pair_tables,
    runs_to_compare,
    side_by_side_pictures,
)
from roundel.validate.figures.writers import write_figures
from roundel.validate.report.html import Tables, figures, fill, presentable_summary
from roundel.validate.report.same_radiance import Origin, origin_of, sensor_pairs
from roundel.validate.scores.report_files import SCORES, read_report_files
from roundel.validate.scores.scores import KEY, SCORES_SCHEMA
from roundel.validate.scores.summary import CHESSBOARD, SCHEMA, Summary, versions
from roundel.validate.tables.calibration_benefit import benefit_over_cameras_table
from roundel.validate.tables.report import pairs_table, result_table
from roundel.validate.tables.table import Cell, Table, formatted
from roundel.validate.tables.writers import write_tables

PAGE = "compare.html"
# The columns that are read from a report's scores.
NEEDED = (*KEY, "group", "solved", "distance_m", *(m.bound for m in ERRORS if m.bound), *(m.oracle for m in ERRORS))
NAMES = (
    "results", "comparisons", "solved_by_one", "stated_pairs", "sensor_comparisons", "sensor_solved_by_one",
    "benefit_over_cameras", "reports",
)  # fmt: skip


# More sentences on sensors than these hide the rest of the summary.
_MOST_SENTENCES = 9


@dataclass(frozen=True)
class Report:
    """A report read from disk: its label on the page, its summary and its scores."""

    label: str
    summary: Summary
    scores: pa.Table

    @property
    def dataset_id(self) -> str:
        """Identity of the dataset's scenes."""
        return str(self.summary.dataset["dataset_id"])

    @property
    def origin(self) -> Origin:
        """Where the radiance of its frames comes from."""
        return origin_of(self.summary.dataset)

    def shares_radiance(self, other: Report) -> bool:
        """Whether both are of different images of the same rendered frames."""
        return self.dataset_id != other.dataset_id and self.origin.rendered_id == other.origin.rendered_id


def compare_reports(paths: Sequence[str | Path], out_path: str | Path) -> list[str]:
    """Write `compare.html` and its tables.

    Parameters
    ----------
    paths : sequence of path
        Folders written by `roundel validate`; the others are compared with the first.
    out_path : path
        Output folder.

    Returns
    -------
    list of str
        The findings, one sentence each.

    Raises
    ------
    UsageError
        If fewer than two reports are given, one is given twice, or the folder is a file or one of the reports.
    DataError
        If a report cannot be read, or its files do not belong together.
    NotComparableError
        If the errors were measured differently.
    """
    if len(paths) < 2:
        raise UsageError("compare: give two or more reports; a single report is in its own report.html")
    out, folders = Path(out_path), [Path(path) for path in paths]
    if out.exists() and not out.is_dir():
        raise UsageError(f"{out}: is a file; give a folder for the comparison")
    check_no_dataset(out)
    if out.resolve() in (folder.resolve() for folder in folders):
        raise UsageError(f"{out}: is one of the reports; give another folder for the comparison")
    if len({folder.resolve() for folder in folders}) < len(folders):
        raise UsageError("compare: the same report is given twice")
    reports = [read_report(p, label) for p, label in zip(folders, labels_of(folders), strict=True)]
    _check(reports, folders)
    entries = [runs_to_compare(r.scores, r.summary.runs, r.label) for r in reports]
    sensors = pair_tables(_sensor_pairs(reports, entries), SENSORS)
    found = [
        _results(reports), *pair_tables(_pairs(reports, entries)), *sensors, *_over_cameras(reports), _sources(reports)
    ]  # fmt: skip
    tables = {table.name: table for table in found}
    said = _sentences(reports, tables)
    changes = change_pictures("sensors", SENSORS.comparisons, sensors)
    drawn = side_by_side_pictures([entry for mine in entries for entry in mine], "The reports side by side")
    html = fill(
        "compare.html.j2",
        title=" and ".join(r.label for r in reports) if len(reports) == 2 else f"{len(reports)} reports",
        sentences=said,
        pictures=figures(drawn),
        changes=figures(changes),
        tables=Tables(tables),
        version=versions()["roundel"],
    )
    write_file(out / PAGE, html.encode())
    write_figures(out, [*drawn, *changes])
    write_tables(out, found, NAMES)
    return said


def read_report(folder: Path, label: str) -> Report:
    """A report's summary and scores, checked against each other.

    Raises
    ------
    UsageError
        If the folder has no report.
    DataError
        If its files cannot be read or do not belong together.
    NotComparableError
        If another version of Roundel wrote it in another format.
    """
    raw, scores = read_report_files(folder)
    if raw.get("schema") != SCHEMA:
        raise NotComparableError(f"{folder}: written by another version of Roundel; validate the dataset again")
    try:
        summary = Summary(**raw)
    except TypeError as error:
        raise NotComparableError(
            f"{folder}: written by another version of Roundel; validate the dataset again"
        ) from error
    for name in NEEDED:
        if name not in scores.column_names:
            raise NotComparableError(f"{folder}: its scores have no column {name}; validate the dataset again")
        if scores.schema.field(name).type != SCORES_SCHEMA.field(name).type:
            raise DataError(f"{folder / SCORES}: the column {name} is not as Roundel writes it; validate it again")
    return Report(label, presentable_summary(summary), scores)


def labels_of(folders: Sequence[Path]) -> list[str]:
    """Labels of the reports: the shortest ends of their paths that differ."""
    parts = [folder.absolute().parts for folder in folders]
    for length in range(1, max(map(len, parts)) + 1):
        labels = ["/".join(part[-length:]) for part in parts]
        if len(set(labels)) == len(labels) and "report" not in labels:
            break
    return [clean(label.removesuffix("/report"), NAME_LIMIT) for label in labels]


def _check(reports: Sequence[Report], folders: Sequence[Path]) -> None:
    first = reports[0].summary
    for report, folder in zip(reports[1:], folders[1:], strict=True):
        mine = report.summary
        if mine.metric_version != first.metric_version:
            raise NotComparableError(
                f"{folder}: its metrics have version {mine.metric_version}, those of {folders[0]} version "
                f"{first.metric_version}; validate both with the same Roundel"
            )
        a, b = (s.settings["reprojection_extent_D"] for s in (first, mine))
        if a != b:
            raise NotComparableError(
                f"{folder}: its reprojection grid extends to {b:g} D, that of {folders[0]} to {a:g} D; validate both "
                "with the same --extent-D"
            )


def _pairs(reports: Sequence[Report], entries: Sequence[Sequence[Entry]]) -> list[Pair]:
    """Pair runs with those of the first report: the same intrinsics, and the same method or the only one of each."""
    pairs = []
    methods = {entry.run["method"] for entry in entries[0]}
    for report, mine in zip(reports[1:], entries[1:], strict=True):
        if report.dataset_id != reports[0].dataset_id:
            continue
        alone = len(methods) == 1 and len({entry.run["method"] for entry in mine}) == 1
        for entry in mine:
            for other in entries[0]:
                same_method = other.run["method"] == entry.run["method"] or alone
                if same_method and other.run["intrinsics"] == entry.run["intrinsics"]:
                    pairs.append(Pair(other, entry, entry.run["intrinsics"]))
    return pairs


def _sensor_pairs(reports: Sequence[Report], entries: Sequence[Sequence[Entry]]) -> list[Pair]:
    """Pair runs with those of the first report on other images of the same radiance."""
    first, *others = ((r.label, r.origin, mine) for r, mine in zip(reports, entries, strict=True))
    return [
        pair
        for report, other in zip(reports[1:], others, strict=True)
        if report.shares_radiance(reports[0])
        for pair in sensor_pairs(first, other)
    ]


def _results(reports: Sequence[Report]) -> Table:
    runs = [
        {**run, "report": report.label, "dataset": report.summary.dataset["name"]}
        for report in reports
        for run in report.summary.runs
        if run["reference"] == "truth" and run["method"] != CHESSBOARD
    ]
    one = len({report.dataset_id for report in reports}) == 1
    return result_table(runs, reports[0].summary, ("report",) if one else ("report", "dataset"))


def _over_cameras(reports: Sequence[Report]) -> list[Table]:
    """The benefit of a calibration over the reports' cameras, if there are several datasets with calibrations."""
    scores = {report.dataset_id: report.scores for report in reports}
    found = benefit_over_cameras(list(scores.values()))
    return [benefit_over_cameras_table(found)] if found else []


def _sources(reports: Sequence[Report]) -> Table:
    rows = [
        (r.label, r.summary.dataset["name"], r.summary.dataset["frames"], r.summary.dataset["seed"],
         r.dataset_id[:12], str(r.summary.checksums.get("images"))[:12],
         r.summary.versions["validate"]["roundel"], r.summary.metric_version, r.summary.checksums[SCORES][:12])
        for r in reports
    ]  # fmt: skip
    heads = ("Report", "Study", "Frames", "Seed", "Dataset", "Images sha256", "Roundel", "Metrics", "Scores sha256")
    return pairs_table("reports", "Reports", heads, rows, "The first twelve digits of each identity and checksum.")


def _sentences(reports: Sequence[Report], tables: dict[str, Table]) -> list[str]:
    same = [r for r in reports[1:] if r.dataset_id == reports[0].dataset_id]
    images = {str(r.summary.checksums.get("images")) for r in (reports[0], *same)}
    sensors = [r for r in reports[1:] if r.shares_radiance(reports[0])]
    found = []
    if len(same) + len(sensors) < len(reports) - 1:
        found.append(
            "The reports are of different datasets. These are shown side by side; no difference between them is "
            "claimed, because their frames are not the same."
        )
    if same:
        pixels = "the same images" if len(images) == 1 else "the same scenes, whose images differ"
        found.append(f"{len(same) + 1} reports are of one dataset, {pixels}: they are compared frame by frame.")
    if sensors:
        found.append(
            f"{len(sensors) + 1} reports are of the same radiance under different sensors (rendered as dataset "
            f"{reports[0].origin.rendered_id[:12]}): their images of each rendered frame are compared in pairs."
        )
        found += _sensor_sentences(tables.get("sensor_comparisons"))
    if same and "comparisons" not in tables:
        found.append("No shared method and intrinsics have enough circles solved by both, so nothing is tested.")
    for row in tables["comparisons"].rows if "comparisons" in tables else ():
        if row[-1] not in NO_DIFFERENCE:
            found.append(f"{str(row[3]).capitalize()}, {row[0]} intrinsics: {row[-1]} has the smaller error.")
    if "comparisons" in tables and all(row[-1] in NO_DIFFERENCE for row in tables["comparisons"].rows):
        found.append("No difference of errors is shown on the shared frames.")
    if "stated_pairs" in tables:
        found += [_stated_sentence(tables["stated_pairs"], row) for row in tables["stated_pairs"].rows]
    return found


def _sensor_sentences(table: Table | None) -> list[str]:
    """Which images of the same frames have other errors than those of the first."""
    if table is None:
        return ["Too few circles are solved under two of the sensors, so nothing is tested."]
    sure = [row for row in table.rows if row[-1] not in NO_DIFFERENCE]
    if not sure:
        return ["No difference of errors between the sensors is shown."]
    found = []
    for row in sure[:_MOST_SENTENCES]:
        about, first, second, error, _, ratio, low, high = row[:8]
        ends = f"{formatted(low)}, {formatted(high)}"
        found.append(
            f"{str(error).capitalize()}, {about}: the RMS of {second} is {formatted(ratio)} times [{ends}] that of "
            f"{first}."
        )
    more = len(sure) - len(found)
    return [*found, f"{more} more differences are in the table."] if more else found


def _stated_sentence(table: Table, row: Sequence[Cell]) -> str:
    """Which of two runs states its uncertainty better, and whether the regions of each hold the truth."""
    at = dict(zip((c.key for c in table.columns), row, strict=True))
    shares = " and ".join(
        f"{formatted(at[f'{which}_within_95_pct'])} % of {at[which]} ({at[f'{which}_verdict']})"
        for which in ("first", "second")
    )
    if at["better"] in NO_DIFFERENCE:
        better = "no difference of the log scores is shown" if at["better"] == NO_DIFFERENCE[0] else "identical"
    else:
        ends = ", ".join(formatted(at[f"log_score_{end}"], sign=True) for end in ("low", "high"))
        difference = f"{formatted(at['log_score_difference'], sign=True)} [{ends}]"
        better = f"{at['better']} has the better log score (second minus first: {difference})"
    return f"Stated uncertainty, {at['about']} intrinsics: {better}; 95 % regions hold the truth in {shares}."
