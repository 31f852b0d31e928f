"""Tables and the figure of `benefit.py`."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from scipy.stats import chi2

from roundel.validate.claims.benefit_over_cameras import camera_errors as errors_of_camera
from roundel.validate.figures.svg import CURVES, Picture, draw_svg, standalone_svg
from roundel.validate.metrics.metric import HEADLINE
from roundel.validate.statistics.intervals import rate_interval
from roundel.validate.statistics.nested import CameraErrors, nested_factor

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LEVELS = (0.5, 0.9, 0.95, 0.99)
ERRORS = ("normal", "position")
COUNTS = (5, 10, 20, 40)
SPLITS = 400
# Of an interval that has to hold the estimate of another half: both halves scatter.
BOTH = 2.0**0.5


def report(table: pa.Table, own: pa.Table, views: int) -> str:
    """The Markdown page."""
    cameras = len(pc.unique(table["camera"]))
    frames = len(pc.unique(table.filter(pc.equal(table["camera"], 0))["frame_id"]))
    return "\n".join(
        [
            "# What a calibration is worth, over cameras",
            "",
            f"{cameras} cameras with the focal lengths of phones, {views} views of a board each, dealt out into "
            f"independent sets; {frames} circles a camera, solved with every calibration. Made by `benefit.py`.",
            "",
            "## The factor",
            "",
            "Median error without a calibration over that with it: the geometric mean over cameras, its 95 % interval "
            "(nested bootstrap over cameras, sets and circles), and the factors that 80 % of single pairs of a camera "
            "and a set have.",
            "",
            "| error | without | views | sets | factor | 95 % interval | 80 % of cameras and sets |",
            "|---|---|---|---|---|---|---|",
            *_factor_rows(table),
            "",
            "## Does the interval mean what it says?",
            "",
            f"{SPLITS} random splits of the cameras into halves: how often the interval of one half holds the estimate "
            "of the other. Both halves scatter, so 83 % are expected of a right 95 % interval; widened by the square "
            "root of two about the estimate, in the logarithm, 95 % are.",
            "",
            "| error | views | 95 % interval | widened for both halves |",
            "|---|---|---|---|",
            *_split_rows(table),
            "",
            "## One camera, one set",
            "",
            "The same statistic for single cameras, each with the interval that a bootstrap over its circles and its "
            "sets gives: the interval of one camera says nothing about the next.",
            "",
            "| camera | factor of the position, 5 views | over its sets | smallest set | largest set |",
            "|---|---|---|---|---|",
            *_camera_rows(table),
            "",
            "## Coverage of the stated regions",
            "",
            "Share of circles whose truth lies inside the stated region of the pose (five degrees of freedom, the "
            "candidate nearer to the truth). The interval of the 95 % region is Wilson's, with cameras as clusters.",
            "",
            "| intrinsics | circles | cameras | 50 % | 90 % | 95 % | interval | 99 % | |",
            "|---|---|---|---|---|---|---|---|---|",
            *_coverage_rows(table, "phones"),
            *_coverage_rows(own, "drawn from the prior of `default`"),
            "",
            "The priors of phones are told of cameras of the whole table, of 2009 to 2026: see docs/phones.md for the "
            "phones of which each holds. `exif` has the focal length rounded to a millimetre.",
            "",
        ]
    )


def _known(value: float | None) -> float:
    assert value is not None, "there are enough cameras for an interval"
    return value


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


def camera_errors(table: pa.Table, error: str, without: str, count: int) -> list[CameraErrors]:
    """The errors of each camera without a calibration, and with each set of `count` views."""
    metric = next(m for m in HEADLINE if m.name == error)
    out = []
    for camera in pc.unique(table["camera"]).to_pylist():
        mine = table.filter(pc.equal(table["camera"], camera))
        labels = pc.unique(mine["intrinsics"]).to_pylist()
        found = errors_of_camera(
            {label: mine.filter(pc.equal(mine["intrinsics"], label)) for label in labels}, metric, without, count
        )
        assert found is not None, "every camera has every calibration"
        out.append(found)
    return out


def _factor_rows(table: pa.Table) -> Iterable[str]:
    for error in ERRORS:
        for without in ("default", "default:2020s", "exif"):
            for count in COUNTS:
                cameras = camera_errors(table, error, without, count)
                found = nested_factor(cameras)
                single = np.concatenate([c.factors for c in cameras])
                low, high = np.percentile(single, [10, 90])
                yield (
                    f"| {error} | {without} | {count} | {len(single)} | {_number(found.value)} | "
                    f"{_number(found.low)} to {_number(found.high)} | {_number(low)} to {_number(high)} |"
                )


def _split_rows(table: pa.Table) -> Iterable[str]:
    rng = np.random.default_rng(7)
    for error in ERRORS:
        for count in (5, 40):
            cameras = camera_errors(table, error, "default", count)
            plain = wide = 0
            for _ in range(SPLITS):
                order = rng.permutation(len(cameras))
                halves = [[cameras[i] for i in half] for half in np.array_split(order, 2)]
                one, other = (nested_factor(half, seed=int(rng.integers(2**31))) for half in halves)
                middle, low, high, off = np.log([_known(x) for x in (one.value, one.low, one.high, other.value)])
                off, end = off - middle, high if off > middle else low
                plain += abs(off) <= abs(end - middle)
                wide += abs(off) <= BOTH * abs(end - middle)
            yield f"| {error} | {count} | {100 * plain / SPLITS:.1f} % | {100 * wide / SPLITS:.1f} % |"


def _camera_rows(table: pa.Table) -> Iterable[str]:
    for number, camera in enumerate(camera_errors(table, "position", "default", 5)[:6]):
        found = nested_factor([camera])
        factors = camera.factors
        yield (
            f"| {number} | {_number(found.value)} | {_number(found.low)} to {_number(found.high)} | "
            f"{_number(factors.min())} | {_number(factors.max())} |"
        )


def _coverage_rows(table: pa.Table, cameras: str) -> Iterable[str]:
    labels = pc.unique(table["intrinsics"]).to_pylist()
    plain = [label for label in labels if not label.startswith("calibrated:")]
    named = {label: [label] for label in plain}
    for count in COUNTS:
        sets = [label for label in labels if label.startswith(f"calibrated:{count}_")]
        if sets:
            named[f"calibrated, {count} views"] = sets
    for name, of in named.items():
        rows = table.filter(pc.is_in(table["intrinsics"], pa.array(of)))
        squares = rows["oracle_pose_chi2"].to_numpy(zero_copy_only=False).astype(np.float64)
        known = np.isfinite(squares)
        # A calibration is one draw of an error: its circles share it.
        cluster = np.unique(
            [f"{c} {i}" for c, i in zip(rows["camera"].to_pylist(), rows["intrinsics"].to_pylist(), strict=True)],
            return_inverse=True,
        )[1][known]
        inside = {level: squares[known] < chi2.ppf(level, 5) for level in LEVELS}
        held = rate_interval(inside[0.95], cluster)
        shares = [f"{100 * inside[level].mean():.1f}" for level in LEVELS]
        verdict = "" if held.value is not None and 0.90 <= held.value <= 0.98 else "outside 90 to 98 %"
        interval = f"{100 * (held.low or 0):.1f} to {100 * (held.high or 0):.1f}"
        yield (
            f"| {name}, {cameras} | {int(known.sum())} | {len(np.unique(rows['camera'].to_numpy()))} | {shares[0]} | "
            f"{shares[1]} | {shares[2]} | {interval} | {shares[3]} | {verdict} |"
        )


def figure(table: pa.Table, path: Path) -> None:
    """The factor of every camera and set by the error of the default focal length; means with their intervals."""
    name = "calibration-benefit-over-cameras"
    title = "Factor by which a calibration from 5 views divides the error, for each camera and set of views"

    def draw(drawing: Figure) -> None:
        panels = drawing.subplots(1, len(ERRORS))
        for panel, error in zip(panels, ERRORS, strict=True):
            cameras = camera_errors(table, error, "default", 5)
            off = [np.median(c.without) for c in camera_errors(table, "position", "default", 5)]
            for x, camera in zip(off, cameras, strict=True):
                panel.plot(np.full(len(camera.factors), x), camera.factors, ".", color=CURVES[0], alpha=0.5, ms=4)
            found = nested_factor(cameras)
            value, low, high = (_known(x) for x in (found.value, found.low, found.high))
            panel.axhspan(low, high, color=CURVES[1], alpha=0.25, lw=0)
            panel.axhline(value, color=CURVES[1], lw=1)
            panel.set(xscale="log", yscale="log", title=f"{error}: a factor of {value:.3g} [{low:.3g}, {high:.3g}]")
            panel.set_xlabel("median position error with default intrinsics [%]")
        panels[0].set_ylabel("median error, default / calibrated")

    svg = draw_svg(name, title, (9.0, 3.4), draw)
    path.write_text(standalone_svg(Picture(name, title, svg)))
