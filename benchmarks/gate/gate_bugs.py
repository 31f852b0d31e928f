"""Bugs planted in the solver, and the result of `roundel gate` for each: on the same images, and on fresh noise.

Detection and fitting run once; the fits then go through the solver again, with a bug after the fit.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import mock

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from roundel.cli.main import main as roundel
from roundel.solver.estimates import ESTIMATES, Estimate
from roundel.solver.fit.ellipse import EllipseFit, FailedFit
from roundel.solver.methods import solve_image
from roundel.solver.methods.roundel_fits import Detections
from roundel.solver.methods.solve import solve_dataset
from roundel.validate.gate.baseline import Baseline, baseline_of_report, write_baseline

Fit = EllipseFit | FailedFit


class Memory:
    """Detections and fits of existing estimates, frame by frame in their order."""

    def __init__(self, estimates: pa.Table) -> None:
        self.frames: dict[int, list[Any]] = {}
        for row in estimates.filter(pc.equal(estimates["candidate"], 0)).to_pylist():
            found = self.frames.setdefault(row["frame_id"], [])
            if row["ellipse_x_px"] is not None:
                ellipse = np.array([row[f"ellipse_{n}"] for n in ("x_px", "y_px", "a_px", "b_px", "angle_deg")])
                unknown = np.full((5, 5), np.nan)
                fit = EllipseFit(ellipse, unknown, row["edge_sigma_px"], row["edge_points"], unknown, np.zeros(0))
                edges = SimpleNamespace(contrast_dn=row["contrast_dn"], blur_px=row["blur_px"])
                found.append(SimpleNamespace(confidence=row["confidence"], edges=edges, fit=fit))
        self.order = sorted(self.frames)
        self.next = 0

    def detect_circles(self, grey: Any, full_scale_dn: float, own_ellipses: bool = True) -> Detections:
        frame = self.order[self.next % len(self.order)]
        self.next += 1
        return Detections(grey, full_scale_dn, self.frames[frame])


def _moved(dx: float = 0.0, dy: float = 0.0, turn_deg: float = 0.0) -> Callable[[Fit, int], Fit]:
    step = np.array([dx, dy, 0.0, 0.0, turn_deg])
    return lambda fit, _: replace(fit, ellipse=fit.ellipse + step) if isinstance(fit, EllipseFit) else fit


def _lost_every(n: int) -> Callable[[Fit, int], Fit]:
    return lambda fit, count: FailedFit("planted") if count % n == n - 1 else fit


def _smallest_lost(b_px: float) -> Callable[[Fit, int], Fit]:
    return lambda fit, _: FailedFit("planted") if isinstance(fit, EllipseFit) and fit.ellipse[3] < b_px else fit


def _turned(matrix: list[list[float]]) -> Callable[[Estimate], Estimate]:
    m = np.array(matrix)
    return lambda e: e if e.normal is None else replace(e, normal=e.normal @ m.T)


# Name: change of each fit (given the number of fits so far), change of each estimate.
BUGS: dict[str, tuple[Callable[[Fit, int], Fit] | None, Callable[[Estimate], Estimate] | None]] = {
    "none": (None, None),
    "sign of the normal's x flipped": (None, _turned([[-1, 0, 0], [0, 1, 0], [0, 0, 1]])),
    "ellipse half a pixel to the right": (_moved(dx=0.5), None),
    "x and y of the normal swapped": (None, _turned([[0, 1, 0], [1, 0, 0], [0, 0, 1]])),
    "axes of the ellipse swapped": (_moved(turn_deg=90.0), None),
    "ellipse 0.02 px too low": (_moved(dy=0.02), None),
    "ellipse 0.002 px too low": (_moved(dy=0.002), None),
    "one circle in 200 lost": (_lost_every(200), None),
    "one circle in 1,000 lost": (_lost_every(1000), None),
    "the smallest 5 % given up (b < 10.7 px)": (_smallest_lost(10.7), None),
}


@contextlib.contextmanager
def planted(memory: Memory, name: str) -> Iterator[None]:
    """The solver with a planted bug."""
    on_fit, on_estimate = BUGS[name]
    count = iter(range(10**9))

    def fit(seen: Detections, detection: Any, *_: Any) -> Fit:
        return on_fit(detection.fit, next(count)) if on_fit else detection.fit

    def estimate(*arguments: Any) -> Estimate:
        made = original(*arguments)
        return on_estimate(made) if on_estimate else made

    original = solve_image.estimate_of
    with (
        mock.patch.object(solve_image, "detect_circles", memory.detect_circles),
        mock.patch.object(solve_image, "fit_detection", fit),
        mock.patch.object(solve_image, "estimate_of", estimate),
    ):
        yield


def said(*arguments: str) -> tuple[int, list[str]]:
    """Exit status of the `roundel` command, and its output lines."""
    out, error = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(error):
        code = roundel(list(arguments))
    return code, [*out.getvalue().splitlines(), *error.getvalue().splitlines()]


def verdicts(dataset: Path, folder: Path, fresh: Baseline) -> Iterator[tuple[str, int, str, int, str]]:
    """For each bug: exit status and failed checks on the same images, then against another copy's noise.

    Parameters
    ----------
    dataset : path
    folder : path
        Estimates and reports are written here.
    fresh : Baseline
        Scores of a copy with different noise.
    """
    clean = folder / "clean"
    if not (clean / ESTIMATES).is_file():
        solve_dataset(dataset, clean)
    memory = Memory(pq.read_table(clean / ESTIMATES))
    same, other = folder / "same.parquet", folder / "fresh.parquet"
    for i, name in enumerate(BUGS):
        estimates, report = folder / f"bug-{i}" / "estimates", folder / f"bug-{i}" / "report"
        if name == "none":
            estimates = clean
        else:
            with planted(memory, name):
                solve_dataset(dataset, estimates)
        code, lines = said("validate", str(dataset), str(estimates), "--out", str(report))
        assert code == 0, lines
        if name == "none":
            accept = ["baseline", "accept", str(report), "--baseline", str(same), "--reason", "before the bug"]
            assert said(*accept)[0] == 0
            settings = baseline_of_report(report).settings
            write_baseline(replace(fresh, settings=settings), other)
        found = [said("gate", str(report), "--baseline", str(file)) for file in (same, other)]
        (code, lines), (other_code, other_lines) = found
        yield name, code, failed(lines), other_code, failed(other_lines)


def failed(lines: list[str]) -> str:
    """Names of the checks that failed, or the error."""
    worse = [line.split(": ", 1)[1] for line in lines if line.startswith("worse")]
    if not worse:
        return next((line.split(": ", 1)[1] for line in lines if line.startswith("roundel:")), "")
    return ", ".join("golden frames" if line.startswith("frame ") else line.split(":")[0] for line in worse)


def zero_samples(dataset: Path, folder: Path) -> list[tuple[str, int, str]]:
    """Results for reports without samples: (case, exit status, message). Runs after `verdicts`, on its files."""
    report, baseline = folder / "bug-0" / "report", folder / "same.parquet"
    table = pq.read_table(folder / "clean" / ESTIMATES)
    cases = []
    empty = folder / "empty" / ESTIMATES
    empty.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(table.slice(0, 0), empty)
    code, lines = said("validate", str(dataset), str(empty), "--out", str(folder / "empty"))
    cases.append(("estimates without rows", code, lines[-1]))
    failed = folder / "failed" / ESTIMATES
    failed.parent.mkdir(parents=True, exist_ok=True)
    at = table.column_names.index("status")
    nothing = table.set_column(at, table.schema.field(at), pa.array(["failed"] * table.num_rows))
    pq.write_table(nothing, failed)
    assert said("validate", str(dataset), str(failed), "--out", str(folder / "failed" / "report"))[0] == 0
    code, lines = said("gate", str(folder / "failed" / "report"), "--baseline", str(baseline))
    cases.append(("a report without any pose", code, lines[-1]))
    rows = baseline_of_report(report)
    write_baseline(replace(rows, rows=rows.rows.slice(0, 0)), folder / "none.parquet")
    code, lines = said("gate", str(report), "--baseline", str(folder / "none.parquet"))
    cases.append(("a baseline without rows", code, lines[-1]))
    return cases
