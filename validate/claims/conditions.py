"""Experimental conditions of the claims: errors by group, on or off the axis, for each kind of intrinsics."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from roundel.scenes.camera.film import DEFAULT_FOCAL_35MM_MM, FILM_DIAGONAL_MM
from roundel.scenes.camera.intrinsics_label import IntrinsicsLabel
from roundel.validate.metrics import metric
from roundel.validate.metrics.rows import Rows, column, text_column, texts_of, those, where_text
from roundel.validate.scores.summary import CHESSBOARD, levels
from roundel.validate.statistics.trends import Array, Index, Mask

NORMAL, POSITION, RELATIVE, REPROJECTION = (
    m.oracle for m in (metric.NORMAL, metric.POSITION_D, metric.POSITION, metric.REPROJECTION)
)
ALONG = metric.ALONG_RAY.oracle

# Limit of "on the optical axis" in every section of a report. The paper's camera points at the centre of the marker.
# Within this angle, a focal length wrong by 30 % turns the normal by less than 0.15 degrees.
ON_AXIS_DEG = 0.25
# Intrinsics whose focal length is closer to the truth than this are not an uncalibrated case (EXIF usually is closer).
WRONG_BY = 0.05
_MAX_LEVELS, _BINS = 12, 5


@dataclass(frozen=True)
class Condition:
    """Circles of one group, on or off the axis: arrays over n circles, errors by intrinsics and column.

    Attributes
    ----------
    group : str
    on_axis : bool
    whole_group : bool
        Whether these are all frames of the group.
    off_axis_deg, distance_D, tilt_deg : (n,) array
    frame : (n,) array of int
        Numbered from 0.
    right : str
        Label of the calibrated case.
    factor : dict
        Estimated over true focal length for each uncalibrated case, farthest below 1 first.
    pure : frozenset
        Uncalibrated cases with only the focal length wrong, by a factor known from the study. Default intrinsics also
        centre the principal point and drop the distortion.
    exact : str
        The true intrinsics if they were used, else `right`; `pure` is compared with it.
    error : dict
        (n,) array by (label, column), NaN if not solved.
    """

    group: str
    on_axis: bool
    whole_group: bool
    off_axis_deg: Array
    distance_D: Array
    tilt_deg: Array
    frame: Index
    right: str
    factor: dict[str, float]
    pure: frozenset[str]
    exact: str
    error: dict[tuple[str, str], Array]

    @property
    def wrong(self) -> list[str]:
        """The uncalibrated cases."""
        return list(self.factor)

    @property
    def name(self) -> str:
        """Displayed name."""
        return self.group + ("" if self.whole_group else ", on axis" if self.on_axis else ", off axis")

    def of(self, label: str, name: str) -> Array:
        """Errors of one kind of intrinsics."""
        return self.error[label, name]

    def distances(self) -> tuple[Array, Index]:
        """Distances in D (of the grid, or means of bins of equal count) and the index of each circle's distance."""
        return _levels(self.distance_D)

    def tilts(self) -> tuple[Array, Index]:
        """As `distances`, for tilts in degrees."""
        return _levels(self.tilt_deg, 3)

    def spans(self, ratio: float = 2.5, count: int = 3) -> bool:
        """Whether the range of distances is large enough to show a trend."""
        return self.distance_D.max() >= ratio * self.distance_D.min() and len(np.unique(self.distances()[0])) >= count


def conditions_of(table: Rows, study: dict[str, Any]) -> list[Condition]:
    """Every condition that can test the paper's claims, those on the axis first.

    Parameters
    ----------
    table : Rows
        Scores.
    study : dict
        The resolved study.

    Returns
    -------
    list of Condition
        Of the study's first method, against the truth. Empty for a study with a sweep over anything but the pose, a
        camera that changes from frame to frame, or no pair of a calibrated and an uncalibrated case.
    """
    method = _method(table, study)
    if method is None:
        return []
    mine = those(table, where_text(table, method=method, reference="truth"))
    found: list[Condition] = []
    for group in mine["group"].unique().to_pylist():
        section = (study.get("groups") or {}).get(group)
        lens = _lens(section)
        if section is None or lens is None or not _sweeps_pose_only(section):
            continue
        found.extend(_of_group(those(mine, where_text(mine, group=group)), group, lens))
    return sorted(found, key=lambda s: not s.on_axis)


def _method(table: Rows, study: dict[str, Any]) -> str | None:
    present = [name for name in texts_of(table, "method") if name != CHESSBOARD]
    asked = [str(m) for m in (study.get("solve") or {}).get("methods") or [] if m in present]
    return next(iter([*asked, *present]), None)


def _sweeps_pose_only(section: dict[str, Any]) -> bool:
    sweep = section.get("sweep")
    return not sweep or str(sweep.get("key", "")).startswith("pose.")


@dataclass(frozen=True)
class _Lens:
    focal_px: float
    aspect: float
    cx_px: float
    cy_px: float
    default_factor: float
    default_is_pure: bool


def _lens(section: dict[str, Any] | None) -> _Lens | None:
    """The group's camera, or None if it differs between frames."""
    camera = (section or {}).get("camera") or {}
    focal, mm, pitch, focus = (camera.get(n) for n in ("focal_px", "focal_mm", "pixel_pitch_um", "focus_m"))
    if isinstance(mm, (int, float)) and isinstance(pitch, (int, float)):
        sharp = focus * mm / (focus - 1e-3 * mm) if isinstance(focus, (int, float)) else mm
        focal = 1e3 * sharp / pitch
    if not isinstance(focal, (int, float)) or not focal > 0:
        return None
    width, height = camera["width_px"], camera["height_px"]
    centre = [camera.get(f"principal_point_{a}_px") for a in "xy"]
    cx, cy = (
        float(c) if isinstance(c, (int, float)) else (n - 1) / 2 for c, n in zip(centre, (width, height), strict=True)
    )
    default = DEFAULT_FOCAL_35MM_MM / FILM_DIAGONAL_MM * math.hypot(width, height)
    aspect = camera.get("aspect")
    ratio = float(aspect) if isinstance(aspect, (int, float)) else 1.0
    centred = math.hypot(cx - (width - 1) / 2, cy - (height - 1) / 2) < 1e-9
    pure = centred and ratio == 1.0 and not camera.get("distortion") and not camera.get("skew_px")
    return _Lens(float(focal), ratio, cx, cy, default / focal, pure)


def _of_group(table: Rows, group: str, lens: _Lens) -> list[Condition]:
    labels = sorted(texts_of(table, "intrinsics"), key=lambda label: IntrinsicsLabel.of(label).rank)
    right = _right(labels)
    if right is None:
        return []
    intrinsics = text_column(table, "intrinsics")
    keys = np.stack([column(table, n) for n in ("frame_id", "marker_id")], axis=1)
    circles, number = np.unique(keys, axis=0, return_inverse=True)
    number = number.ravel()

    def spread(name: str, rows: Mask) -> Array:
        values = np.full(len(circles), np.nan)
        values[number[rows]] = column(table, name)[rows]
        return values

    every = np.ones(len(number), dtype=bool)
    x, y, distance_m = (spread(n, every) for n in ("image_x_px", "image_y_px", "distance_m"))
    off = np.degrees(
        np.arctan(np.hypot((x - lens.cx_px) / lens.focal_px, (y - lens.cy_px) / (lens.focal_px * lens.aspect)))
    )
    error = {
        (label, name): spread(name, intrinsics == label)
        for label in labels
        for name in (NORMAL, POSITION, RELATIVE, REPROJECTION, ALONG)
    }
    factor, pure = {}, set()
    for label in labels:
        told = _told_factor(label, lens)
        # Depth scales with the focal length, which gives the factor if the focal length of EXIF is unknown.
        near = error[label, ALONG] / distance_m
        k = told if told is not None else 1.0 + float(np.nanmedian(near)) if np.isfinite(near).any() else math.nan
        if label != right and abs(k - 1.0) >= WRONG_BY and not label.startswith("calibrated"):
            factor[label] = k
            pure |= {label} if label.startswith("scaled") or (label == "default" and lens.default_is_pure) else set()
    if not factor:
        return []
    distance_D, tilt = spread("distance_D", every), spread("tilt_deg", every)
    usable = np.isfinite(distance_D) & np.isfinite(tilt) & np.isfinite(off)
    found = []
    for on_axis in (True, False):
        rows = usable & ((off <= ON_AXIS_DEG) == on_axis)
        if rows.any():
            frame = np.unique(circles[rows, 0], return_inverse=True)[1].astype(np.int64)
            found.append(
                Condition(
                    group,
                    on_axis,
                    bool(rows[usable].all()),
                    off[rows],
                    distance_D[rows],
                    tilt[rows],
                    frame,
                    right,
                    dict(sorted(factor.items(), key=lambda pair: pair[1])),
                    frozenset(pure),
                    _exact(labels) or right,
                    {key: values[rows] for key, values in error.items()},
                )
            )
    return found


def _right(labels: list[str]) -> str | None:
    """The calibrated case: the calibration from most views, as in the paper's real test, else the true intrinsics."""

    def views(label: str) -> tuple[bool, int]:
        value = label.partition(":")[2]
        return value.isdigit(), int(value) if value.isdigit() else 0

    calibrated = sorted((x for x in labels if x.partition(":")[0] == "calibrated"), key=views)
    if calibrated:
        return calibrated[-1]
    return _exact(labels)


def _exact(labels: list[str]) -> str | None:
    true = [x for x in labels if x == "true" or (x.startswith("scaled:") and IntrinsicsLabel.of(x).factor == 1.0)]
    return true[0] if true else None


def _told_factor(label: str, lens: _Lens) -> float | None:
    kind = label.partition(":")[0]
    if kind == "scaled":
        return IntrinsicsLabel.of(label).factor
    if kind == "true":
        return 1.0
    return lens.default_factor if label == "default" else None


def _levels(values: Array, bins: int = _BINS) -> tuple[Array, Index]:
    grid = levels(values)
    if grid is not None and len(grid) <= _MAX_LEVELS:
        return grid, np.searchsorted(grid, np.round(values, 6)).astype(np.int64)
    which = (np.argsort(np.argsort(values, kind="stable"), kind="stable") * bins // max(1, len(values))).astype(
        np.int64
    )
    return np.array([values[which == i].mean() for i in np.unique(which)]), which
