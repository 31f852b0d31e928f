"""Summary text and record of the benefit of a calibration."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.intrinsics_label import IntrinsicsLabel
from roundel.validate.claims.calibration_benefit import (
    BOARD,
    ERRORS,
    FACTOR,
    CalibrationBenefit,
    Panel,
    error_ratio,
    level_of,
    median_of,
    verdict_of,
)
from roundel.validate.claims.conditions import ON_AXIS_DEG
from roundel.validate.metrics.metric import NORMAL, Metric
from roundel.validate.scores.summary import number
from roundel.validate.statistics.intervals import Interval

_DEGREE = "\N{DEGREE SIGN}"
_UNITS = {"distance_D": " D", "tilt_deg": f"{_DEGREE} of tilt", "off_axis_deg": _DEGREE}
Rows = NDArray[np.int64]

# Other boards of the same camera change the factor several times over, another camera by an order of magnitude
# (benchmarks/calibration/benefit.md).
ONE_CAMERA = (
    "This is one camera, and one set of views for each calibration: the intervals are over the circles in front of "
    "them. Another camera, or other views of the boards, give other factors."
)


def title_of(label: str) -> str:
    """Displayed name of intrinsics or of the chessboard."""
    return "chessboard, solvePnP" if label == BOARD else IntrinsicsLabel.of(label).title


def answer(benefit: CalibrationBenefit) -> list[str]:
    """Sentences: the overall answer, then one per error, then the effect of more views and of other intrinsics."""
    views = IntrinsicsLabel.of(benefit.calibrated).views
    source = "A calibration" if views is None else f"A calibration from {views} views"
    places = {error.words: _in_short(benefit, error) for error in ERRORS}
    names = list(places)
    alike = set(places.values()) in ({"everywhere"}, {"nowhere"})
    short = (
        f"{', '.join(names[:-1])} and {names[-1]}: {places[names[0]]}"
        if alike
        else "; ".join(f"{name}: {place}" for name, place in places.items())
    )
    return [
        f"{source} is beneficial, that is, it reduces the median error with {title_of(benefit.uncalibrated)} "
        f"intrinsics by more than a factor of {FACTOR:g}, for the {short}.",
        *(_of_error(benefit, error) for error in ERRORS),
        ONE_CAMERA,
        *_more_views(benefit),
        *_other_intrinsics(benefit),
        *_focal_alone(benefit),
        *_chessboard(benefit),
    ]


def where(verdicts: Sequence[str], low: Sequence[float], high: Sequence[float], unit: str) -> str:
    """Range of a variable in which verdicts are `yes`: everywhere, nowhere, from a value on, up to one, or a list.

    Examples
    --------
    >>> where(["no", "open", "yes", "yes"], [10, 20, 30, 40], [10, 20, 30, 40], " D")
    'from 30 D on'
    """
    yes = [v == "yes" for v in verdicts]
    if all(yes):
        return "everywhere"
    if not any(yes):
        return "nowhere"
    first, last = yes.index(True), len(yes) - 1 - yes[::-1].index(True)
    if all(yes[first:]):
        return f"from {_plain(low[first])}{unit} on"
    if all(yes[: last + 1]):
        return f"up to {_plain(high[last])}{unit}"
    if all(yes[first : last + 1]):
        return f"from {_plain(low[first])} to {_plain(high[last])}{unit}"
    places = [
        _plain(a) if a == b else f"{_plain(a)} to {_plain(b)}" for a, b, y in zip(low, high, yes, strict=True) if y
    ]
    return f"at {', '.join(places)}{unit}"


def _plain(value: float) -> str:
    return f"{value:.3g}"


def _panel(benefit: CalibrationBenefit, part: str, variable: str) -> Panel | None:
    return next((p for p in benefit.panels if (p.part, p.variable) == (part, variable)), None)


def _where(benefit: CalibrationBenefit, error: Metric, panel: Panel, beyond: float = -1.0) -> str:
    bins = [i for i in range(len(panel.bins)) if panel.low[i] > beyond]
    verdicts = [verdict_of(panel.gains[error.name][i]) for i in bins]
    low, high = panel.low[bins].tolist(), panel.high[bins].tolist()
    return where(verdicts, low, high, _UNITS[panel.variable])


def _parts(benefit: CalibrationBenefit) -> list[tuple[str, str, Rows]]:
    named_parts = (("on_axis", "on the axis", benefit.on_axis), ("off_axis", "off the axis", benefit.off_axis))
    found = [p for p in named_parts if _panel(benefit, p[0], "distance_D") is not None]
    everything = np.union1d(benefit.on_axis, benefit.off_axis)
    return found or [("all", "over all frames", everything)]


def _of_part(benefit: CalibrationBenefit, error: Metric, part: str) -> str:
    """Range with a benefit in this part: by offset off the axis, else by distance."""
    offset = _panel(benefit, "all", "off_axis_deg")
    if part == "off_axis" and offset is not None:
        return _where(benefit, error, offset, ON_AXIS_DEG)
    panel = _panel(benefit, part, "distance_D")
    return "nowhere" if panel is None else _where(benefit, error, panel)


def _in_short(benefit: CalibrationBenefit, error: Metric) -> str:
    places = [(words, _of_part(benefit, error, part)) for part, words, _ in _parts(benefit)]
    if len({place for _, place in places}) == 1 and places[0][1] in ("everywhere", "nowhere"):
        return places[0][1]
    return ", ".join(f"{words} {place}" for words, place in places)


def _of_error(benefit: CalibrationBenefit, error: Metric) -> str:
    texts = []
    for part, words, rows in _parts(benefit):
        without = median_of(benefit, error.name, benefit.uncalibrated, rows)
        with_it = median_of(benefit, error.name, benefit.calibrated, rows)
        gain = error_ratio(benefit, error.name, rows)
        text = f"{words} {number(without)}{error.suffix} and {number(with_it)}{error.suffix}, {_times(gain)}"
        panels = [_panel(benefit, part, name) for name in ("distance_D", "tilt_deg")]
        places = dict.fromkeys(_where(benefit, error, p) for p in panels if p is not None and len(p.bins) > 1)
        mixed = [place for place in places if place not in ("everywhere", "nowhere")]
        texts.append(text + (f" (more than {FACTOR:g} {' and '.join(mixed)})" if mixed else ""))
    return f"Median {error.words} error without and with calibration: {'; '.join(texts)}."


def _times(gain: Interval) -> str:
    if gain.value is None:
        return "no frames in common"
    bounds = "" if gain.low is None else f" [{number(gain.low, 2)}, {number(gain.high, 2)}]"
    return f"a factor of {number(gain.value, 2)}{bounds}"


def _levels(benefit: CalibrationBenefit, label: str, rows: Rows) -> str:
    values = (median_of(benefit, error.name, label, rows) for error in ERRORS)
    return ", ".join(f"{number(v)}{error.suffix}" for v, error in zip(values, ERRORS, strict=True))


def _more_views(benefit: CalibrationBenefit) -> list[str]:
    counted = [label for label in benefit.labels if IntrinsicsLabel.of(label).views is not None]
    if len(counted) < 2:
        return []
    _, words, rows = _parts(benefit)[-1]
    ordered = sorted(counted, key=lambda label: IntrinsicsLabel.of(label).views or 0)
    texts = "; ".join(f"{IntrinsicsLabel.of(label).views} views {_levels(benefit, label, rows)}" for label in ordered)
    truth = f"; the true camera {_levels(benefit, 'true', rows)}" if "true" in benefit.labels else ""
    return [f"Median errors with more views, {words} ({', '.join(e.words for e in ERRORS)}): {texts}{truth}."]


def _other_intrinsics(benefit: CalibrationBenefit) -> list[str]:
    others = [x for x in benefit.labels if x not in (benefit.uncalibrated, "true") and not x.startswith("calibrated:")]
    if not others:
        return []
    every = [benefit.uncalibrated, *others]
    return [
        f"Median errors without a calibration, {words}: "
        f"{'; '.join(f'{title_of(x)} {_levels(benefit, x, rows)}' for x in every)}."
        for _, words, rows in _parts(benefit)
    ]


def _focal_alone(benefit: CalibrationBenefit) -> list[str]:
    """A remark if default intrinsics harm the normal but a wrong focal length alone does not."""
    scaled = [label for label in benefit.labels if label.startswith("scaled:")]
    found = next(((words, rows) for part, words, rows in _parts(benefit) if part == "on_axis"), None)
    if found is None or not scaled:
        return []
    words, rows = found
    harmless = all(verdict_of(error_ratio(benefit, NORMAL.name, rows, label)) == "no" for label in scaled)
    if not harmless or verdict_of(error_ratio(benefit, NORMAL.name, rows)) != "yes":
        return []
    return [
        f"{words[:1].upper()}{words[1:]}, a wrong focal length alone does not change the normal. The error of "
        f"{title_of(benefit.uncalibrated)} intrinsics there comes from the principal point and the distortion, which "
        "the paper's synthetic camera does not have."
    ]


def _chessboard(benefit: CalibrationBenefit) -> list[str]:
    if BOARD not in benefit.errors[NORMAL.name]:
        return []
    _, words, rows = _parts(benefit)[-1]
    found = int(np.isfinite(benefit.errors[NORMAL.name][BOARD][rows]).sum())
    return [
        f"Median errors of the same circles from the chessboard beside the marker (solvePnP), {words}: "
        f"{_levels(benefit, BOARD, rows)}; the board was found in {found} of {len(rows)} frames."
    ]


def benefit_record(benefit: CalibrationBenefit) -> dict[str, Any]:
    """The numbers for summary.json, as plain values."""
    panels = []
    for panel in benefit.panels:
        for error in ERRORS:
            panels.append(
                {
                    "error": error.name,
                    "column": error.oracle,
                    "part": panel.part,
                    "variable": panel.variable,
                    "low": panel.low.tolist(),
                    "high": panel.high.tolist(),
                    "n": [len(rows) for rows in panel.bins],
                    "median": {
                        label: [median_of(benefit, error.name, label, rows) for rows in panel.bins]
                        for label in benefit.errors[error.name]
                    },
                    "gain": [{**_numbers(gain), "beneficial": verdict_of(gain)} for gain in panel.gains[error.name]],
                }
            )
    parts = {"on_axis": benefit.on_axis, "off_axis": benefit.off_axis}
    return {
        "method": benefit.method,
        "calibrated": benefit.calibrated,
        "uncalibrated": benefit.uncalibrated,
        "factor": FACTOR,
        "statistic": "median",
        "on_axis_deg": ON_AXIS_DEG,
        "answer": answer(benefit),
        "overall": [
            {
                "error": error.name,
                "part": part,
                "intrinsics": label,
                **_numbers(level_of(benefit, error.name, label, rows)),
                "gain": None
                if label in (benefit.calibrated, BOARD)
                else _numbers(error_ratio(benefit, error.name, rows, label)),
            }
            for part, rows in parts.items()
            if len(rows)
            for error in ERRORS
            for label in benefit.errors[error.name]
        ],
        "panels": panels,
    }


def _numbers(interval: Interval) -> dict[str, Any]:
    return {"value": interval.value, "low": interval.low, "high": interval.high, "n": interval.n}
