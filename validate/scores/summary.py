"""Summary of the scores by method, intrinsics and reference, and by cell of the study's grid."""

from __future__ import annotations

import importlib.metadata
import platform
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from roundel.datasets.dataset import Dataset
from roundel.datasets.layout.developed import developed_of
from roundel.datasets.layout.sweeps import sweep_keys, sweep_levels
from roundel.scenes.camera.intrinsics_label import IntrinsicsLabel
from roundel.solver.catalogue import is_own
from roundel.validate.metrics.metric import (
    METRIC_VERSION,
    METRICS,
    NORMAL,
    POSITION,
    POSITION_D,
    REPROJECTION,
)
from roundel.validate.metrics.rows import Mask, Rows, column, distinct, flag_column, those, where_text
from roundel.validate.scores.assignment import GATE_FRACTION, GATE_PX
from roundel.validate.scores.comparisons import POWER_NOTE, comparisons, power_of
from roundel.validate.scores.false_positives import FALSE_POSITIVES_SCHEMA
from roundel.validate.scores.run_statistics import run_statistics, statistics_of
from roundel.validate.scores.scores import Scores
from roundel.validate.scores.stated_uncertainty import stated_statistics

Array = NDArray[np.float64]

SCHEMA = 1

# A study has a grid if few values recur often; with more values than this they count as random.
_MAX_LEVELS = 60

# The columns that name a run.
RUN = ("method", "intrinsics", "reference")

# The method name of the chessboard's own pose (`validate.calibration.chessboard_reference`).
CHESSBOARD = "chessboard_pnp"

# The errors in the cells of the grid: the paper's three.
CELL_METRICS = (NORMAL, POSITION_D, POSITION, REPROJECTION)


@dataclass(frozen=True)
class Summary:
    """The contents of summary.json. Nested values are plain: finite numbers, texts, None.

    Attributes
    ----------
    metric_version : int
    dataset, settings, versions, checksums : dict
        The frames, the validator's settings, the software versions, and checksums of the inputs.
    runs, groups, cells : list of dict
        Statistics by method, intrinsics and reference; the same by group; and by cell of the study's grid.
    failures, comparisons, power : list of dict
        Reasons of failures, comparisons with the main run, and the detectable change.
    calibration, calibrations, calibration_subsets
        OpenCV's calibration from all views, from the numbers of views in the study, and from random subsets.
    caveats : list of dict
        Number of detections of each method and intrinsics with each kind of caveat.
    diagnoses : list of dict
        Conventions that files of estimates seem to have by mistake, see `roundel.validate.diagnosis`.
    filled_in : dict
        Defaults that were used for a run's file.
    benefit, sweeps, verdicts
        The benefit of a calibration, errors over the levels of a nuisance, the paper's claims: records of JSON.
    """

    metric_version: int
    dataset: dict[str, Any]
    settings: dict[str, Any]
    runs: list[dict[str, Any]]
    groups: list[dict[str, Any]]
    cells: list[dict[str, Any]]
    failures: list[dict[str, Any]]
    comparisons: list[dict[str, Any]]
    power: list[dict[str, Any]]
    calibration: dict[str, Any] | None
    metrics: list[dict[str, Any]]
    versions: dict[str, Any]
    schema: int = SCHEMA
    power_note: str = POWER_NOTE
    filled_in: dict[str, list[str]] = field(default_factory=dict)
    calibrations: list[dict[str, Any]] = field(default_factory=list)
    calibration_subsets: list[dict[str, Any]] = field(default_factory=list)
    benefit: dict[str, Any] | None = None
    sweeps: list[dict[str, Any]] = field(default_factory=list)
    verdicts: list[dict[str, Any]] = field(default_factory=list)
    checksums: dict[str, str] = field(default_factory=dict)
    caveats: list[dict[str, Any]] = field(default_factory=list)
    diagnoses: list[dict[str, Any]] = field(default_factory=list)


def summary_record(summary: Summary) -> dict[str, Any]:
    """The contents of summary.json, with its schema first."""
    return {"schema": summary.schema, **{f.name: getattr(summary, f.name) for f in fields(summary)}}


def run_keys(table: Rows) -> list[tuple[str, str, str]]:
    """(method, intrinsics, reference) of a table of scores, in display order."""
    found = [(m, i, r) for m, i, r in distinct(table, RUN)]
    # The truth first; the chessboard's own pose last.
    return sorted(found, key=lambda k: (k[0] == CHESSBOARD, k[2] != "truth", k[0], IntrinsicsLabel.of(k[1]).rank))


def run_rows(table: Rows, key: tuple[str, str, str]) -> Rows:
    """Rows of one run."""
    return those(table, where_text(table, **dict(zip(RUN, key, strict=True))))


def main_key(keys: list[tuple[str, str, str]], methods: list[str]) -> tuple[str, str, str] | None:
    """The main run of a report, against the truth: a method of the user's before Roundel's, the study's first, with the
    true focal length.
    """
    mine = [key for key in keys if key[2] == "truth" and key[0] != CHESSBOARD]

    def place(key: tuple[str, str, str]) -> tuple[bool, int, str, bool]:
        return (
            is_own(key[0]),
            methods.index(key[0]) if key[0] in methods else len(methods),
            key[0],
            not IntrinsicsLabel.of(key[1]).is_right,
        )

    return min(mine, key=place, default=None)


def levels(values: Array) -> Array | None:
    """The distinct values if they form a grid; None if they are random."""
    known = np.round(values[np.isfinite(values)], 6)
    distinct = np.unique(known)
    grid = 0 < len(distinct) <= _MAX_LEVELS and len(known) >= 2 * len(distinct)
    return distinct if grid else None


def grid_of(rows: Rows) -> tuple[Array, Array] | None:
    """(distances in D, tilts in degrees) if these rows form a grid."""
    if not _few_values(rows):
        return None
    # Each circle once, because several intrinsics of one random value are not a grid.
    _, first = np.unique(np.stack([column(rows, n) for n in ("frame_id", "marker_id")]), axis=1, return_index=True)
    distance, tilt = (levels(column(rows, name)[first]) for name in ("distance_D", "tilt_deg"))
    return None if distance is None or tilt is None else (distance, tilt)


def _few_values(rows: Rows) -> bool:
    """Whether there may be a grid: a cheap answer for the many rows of a random study."""
    return all(len(np.unique(np.round(column(rows, n), 6))) <= _MAX_LEVELS + 1 for n in ("distance_D", "tilt_deg"))


def _cells(rows: Rows, label: dict[str, str], group: str) -> list[dict[str, Any]]:
    grid = grid_of(rows)
    if grid is None:
        return []
    distance, tilt = np.round(column(rows, "distance_D"), 6), np.round(column(rows, "tilt_deg"), 6)
    solved = flag_column(rows, "solved")
    frame, cells = rows["frame_id"].to_numpy(), []
    for t in grid[1].tolist():
        for d in grid[0].tolist():
            here = (distance == d) & (tilt == t)
            if here.any():
                cells.append(
                    {
                        **label,
                        "group": group,
                        "distance_D": d,
                        "tilt_deg": t,
                        "n": int(here.sum()),
                        "solved": int((here & solved).sum()),
                        "oracle": statistics_of(_errors(rows, here), frame[here]),
                    }
                )
    return cells


def _errors(rows: Rows, here: Mask) -> Iterator[tuple[str, Array]]:
    for metric in CELL_METRICS:
        yield metric.column, metric.values(rows)[here]


def summarise(
    dataset: Dataset, scores: Scores, settings: dict[str, Any], circles: int, calibration: dict[str, Any] | None
) -> Summary:
    """The statistics of a report; verdicts and checksums are added later with `dataclasses.replace`.

    Parameters
    ----------
    dataset : Dataset
    scores : Scores
    settings : dict
        The validator's settings.
    circles : int
        True circles of the dataset.
    calibration : dict or None
        From `calibration_summary`.

    Returns
    -------
    Summary
        Deterministic for the same input.
    """
    width = image_widths(dataset)
    tables: dict[tuple[str, str, str], Rows] = {}
    runs, by_group, cells, failures = [], [], [], []
    for key in run_keys(scores.table):
        mine = tables[key] = run_rows(scores.table, key)
        label = dict(zip(RUN, key, strict=True))
        false = _false_table(scores, key)
        found = {**run_statistics(mine, width(mine)), **stated_statistics(mine, false)}
        runs.append({**label, **found, **_false(scores, key)})
        names = mine["group"].unique().to_pylist()
        for name in names:
            part = mine if len(names) == 1 else those(mine, where_text(mine, group=name))
            if len(names) > 1:
                beside = those(false, where_text(false, group=name))
                found = {**run_statistics(part, width(part)), **stated_statistics(part, beside)}
                by_group.append({**label, "group": name, **found})
            cells.extend(_cells(part, label, name))
        failures += [{**label, "reason": why, "count": count} for why, count in _failures(mine)]
    manifest = dataset.manifest
    main = main_key(list(tables), (dataset.study.get("solve") or {}).get("methods") or [])
    return Summary(
        metric_version=METRIC_VERSION,
        dataset={
            "dataset_id": manifest["dataset_id"],
            "name": dataset.study.get("name"),
            "seed": dataset.study.get("seed"),
            "frames": len(dataset),
            "circles": circles,
            "groups": dict(Counter(dataset.images.groups)),
            "sweeps": sweep_keys(manifest),
            **({"sweep_levels": levels} if (levels := sweep_levels(manifest)) else {}),
            **({} if (developed := developed_of(manifest)) is None else developed.record()),
            "fidelity": _fidelity(manifest.get("fidelity")),
            **({} if dataset.reference is None else {"reference": _reference(dataset.reference)}),
        },
        settings={"gate_px": GATE_PX, "gate_fraction_of_minor_semi_axis": GATE_FRACTION, **settings},
        runs=runs,
        groups=by_group,
        cells=cells,
        failures=failures,
        comparisons=comparisons(tables, main) if main else [],
        power=power_of(tables),
        calibration=calibration,
        metrics=[{key: getattr(metric, key) for key in _DEFINITION} for metric in METRICS],
        versions={"validate": versions(), "render": manifest.get("versions")},
    )


def _reference(reference: dict[str, Any]) -> dict[str, Any]:
    """What a report says of the measured poses of photographs, with its sentence."""
    sigma, source = reference["sigma"], "the same photographs"
    source = source if reference["camera"] == "photographs" else "a calibration of its own"
    sentence = (
        f"These are photographs: their poses are a reference measured from the {reference['board']} beside each "
        f"circle, with the camera of {source}, and no truth; its own standard deviation is "
        f"{number(sigma['normal_deg'])}\N{DEGREE SIGN} (normal) and {number(sigma['position_pct'])} % of the distance "
        "(centre), and errors below it are not resolved."
    )
    keys = ("kind", "board", "camera", "sigma")
    return {**{key: reference[key] for key in keys}, "sentence": sentence}


def image_widths(dataset: Dataset) -> Callable[[Rows], Array]:
    """A function that gives the width of each row's image, px."""
    width = np.fromiter((r["width_px"] for r in dataset.images.records), dtype=np.float64, count=len(dataset.images))
    if np.ptp(width) == 0.0:
        return lambda rows: np.full(rows.num_rows, width[0])
    ids = np.array(dataset.images.frame_ids)
    return lambda rows: np.asarray(width[np.searchsorted(ids, rows["frame_id"].to_numpy())])


def _failures(rows: Rows) -> list[tuple[str, int]]:
    """Why circles were not solved, with the number of each kind of reason."""
    kinds: Counter[str] = Counter()
    for entry in pc.value_counts(rows["reason"]).to_pylist():
        if entry["values"]:
            kinds[_kind_of_reason(entry["values"])] += entry["counts"]
    return sorted(kinds.items())


_FIDELITY = {"shift_x_px", "shift_y_px", "scale_px", "residual", "monte_carlo", "z_rms", "z_passed", "z_consistent"}


def _fidelity(measured: dict[str, Any] | None) -> dict[str, Any] | None:
    """Fidelity in a manifest; for older versions with another measurement, only a note."""
    if not (measured or {}).get("circles"):
        return measured
    assert measured is not None
    if all(set(part) >= _FIDELITY for part in (measured, *measured.get("by_effect", {}).values())):
        return measured
    return {"circles": 0, "reason": "measured differently by an older version; render it again"}


def _false(scores: Scores, key: tuple[str, str, str]) -> dict[str, Any]:
    """False positives; they do not depend on a reference, so they are reported only with the truth."""
    for false in scores.false_detections:
        if (false.method, false.intrinsics, "truth") == key:
            return {"detections": false.detections, "false_detections": false.count}
    return {"detections": None, "false_detections": None}


def _false_table(scores: Scores, key: tuple[str, str, str]) -> pa.Table:
    """The rows of a run's false positives; none against another reference than the truth."""
    mine = [f.table for f in scores.false_detections if (f.method, f.intrinsics, "truth") == key]
    return pa.concat_tables([FALSE_POSITIVES_SCHEMA.empty_table(), *mine])


def _kind_of_reason(reason: str) -> str:
    """A reason without its numbers, so that similar reasons are counted together."""
    head, comma, _ = reason.partition(", ")
    return "a detection, but too far from the contour" if comma and "detection" in head else reason


def versions() -> dict[str, str]:
    """Versions of the software behind a report."""
    import cv2
    import matplotlib
    import scipy

    try:
        roundel = importlib.metadata.version("roundel")
    except importlib.metadata.PackageNotFoundError:
        roundel = "not installed"
    return {
        "roundel": roundel,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "pyarrow": pa.__version__,
        "opencv": cv2.__version__,
        "matplotlib": matplotlib.__version__,
    }


def number(value: float | None, digits: int = 3) -> str:
    """A number for display, with `digits` significant digits; a dash for None."""
    if value is None or not np.isfinite(value):
        return "-"
    if value == 0:
        return "0"
    if abs(value) >= 1e7:
        return f"{value:.1e}"
    places = max(0, digits - 1 - int(np.floor(np.log10(abs(value)))))
    return f"{value:,.{places}f}" if abs(value) >= 1e-4 else f"{value:.1e}"


# The fields of a metric in summary.json.
_DEFINITION = ("column", "title", "unit", "frame", "definition", "source", "of")


def detected_without_pose(run: dict[str, Any]) -> int:
    """Number of circles that a run found without a pose: all of them if it only gives centres."""
    return max(int(run.get("detected", 0)) - int(run["solved"]), 0)
