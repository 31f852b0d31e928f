"""The metrics: column, title, unit, scale, definition and bound of each, in one place."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.validate.metrics.rows import Rows, column

Array = NDArray[np.float64]

# Incremented when a definition changes; scores of different versions are not compared.
METRIC_VERSION = 3


@dataclass(frozen=True)
class Metric:
    """A metric: its column, displayed name, unit, frame, definition, source and bound.

    Attributes
    ----------
    column : str
        Column of scores.parquet. A metric of a pose has a second column with the prefix `oracle_`, for the candidate
        nearer to the truth.
    title, unit : str
        Displayed name and unit.
    frame, definition, source : str
        The frame in which it is measured, its definition, and the source of the definition.
    of : {"pose", "ellipse", "image"}
        The measured object; both candidates share the ellipse, and what is measured from the image as a whole.
    signed : bool
        Whether it may be negative.
    shown_unit, shown_scale : str, float
        The displayed unit, if it differs from the column's, and the number of them in one unit of the column.
    bound, bound_per, bound_scale : str, str, float
        Column of the frame's Cramer-Rao bound, the column it is divided by, and a factor; empty if there is none.
    """

    column: str
    title: str
    unit: str
    frame: str
    definition: str
    source: str
    of: str = "pose"
    signed: bool = False
    shown_unit: str = ""
    shown_scale: float = 1.0
    bound: str = ""
    bound_per: str = ""
    bound_scale: float = 1.0

    @property
    def name(self) -> str:
        """The column without its unit: `normal`, `position`, `ellipse_centre`."""
        return re.sub(r"(_error)?_(deg|m|D|pct|px|bounds)$", "", self.column)

    @property
    def oracle(self) -> str:
        """Column of the better candidate."""
        return f"oracle_{self.column}" if self.of == "pose" else self.column

    @property
    def table_unit(self) -> str:
        """Displayed unit."""
        return self.shown_unit or self.unit

    @property
    def table_column(self) -> str:
        """Name of the column in the displayed unit."""
        return re.sub(rf"_{self.unit}$", f"_{self.shown_unit}", self.column) if self.shown_unit else self.column

    @property
    def words(self) -> str:
        """The title within a sentence."""
        return self.title if self.title.isupper() else self.title[0].lower() + self.title[1:]

    @property
    def label(self) -> str:
        """Label of an axis, or of a row of several errors."""
        return f"{self.words} [{self.unit}]"

    @property
    def short_label(self) -> str:
        """Label of a column in the terminal."""
        return f"{self.words} {self.unit.split()[0]}"

    @property
    def suffix(self) -> str:
        """The unit as written after a number."""
        return {"deg": "\N{DEGREE SIGN}", "% of distance": " %"}.get(self.unit, f" {self.unit}")

    def values(self, table: Rows, which: str = "oracle") -> Array:
        """(n,) values in `unit`, NaN if missing; `which` is `oracle` or `chosen`."""
        return column(table, self.oracle if which == "oracle" else self.column)

    def bounds(self, table: Rows) -> Array:
        """(n,) Cramer-Rao bounds in `unit`; NaN if missing."""
        if not self.bound:
            return np.full(table.num_rows, np.nan)
        bound = self.bound_scale * column(table, self.bound)
        return bound / column(table, self.bound_per) if self.bound_per else bound

    def over_bound(self, table: Rows) -> Array:
        """(n,) values of the better candidate over their bounds; NaN without a positive bound."""
        values, bound = self.values(table), self.bounds(table)
        return np.asarray(np.divide(values, bound, out=np.full(len(values), np.nan), where=bound > 0))


_PAPER = "Mariyanayagam et al., Pose estimation of a single circle using default intrinsic calibration, section V"
_OWN = "Roundel"
_BOP = "Hodan et al., BOP Challenge 2020 on 6D object localization, section 2.2"

NORMAL = Metric(
    "normal_error_deg",
    "Normal",
    "deg",
    "camera",
    "Angle between the estimated and the true normal, atan2(|a x b|, a . b).",
    _PAPER,
    bound="normal_bound_deg",
)
POSITION_M = Metric(
    "position_error_m",
    "Position",
    "m",
    "camera",
    "Distance between the estimated and the true centre.",
    _PAPER,
    bound="position_bound_m",
)
POSITION_D = Metric(
    "position_error_D",
    "Position",
    "D",
    "camera",
    "The position error in marker diameters.",
    _PAPER,
)
POSITION = Metric(
    "position_error_pct",
    "Position",
    "% of distance",
    "camera",
    "The position error in percent of the true distance.",
    _OWN,
    bound="position_bound_m",
    bound_per="distance_m",
    bound_scale=100.0,
)
ALONG_RAY = Metric(
    "along_ray_m",
    "Along the ray",
    "m",
    "true ray",
    "Signed component of the position error along the true ray; positive: too far.",
    _OWN,
    signed=True,
    shown_unit="mm",
    shown_scale=1000.0,
)
ACROSS_RAY = Metric(
    "across_ray_m",
    "Across the ray",
    "m",
    "true ray",
    "Length of the component of the position error perpendicular to the true ray.",
    _OWN,
)
REPROJECTION = Metric(
    "reprojection_error_px",
    "Reprojection",
    "px",
    "delivered image",
    "Mean over a 3x3 grid in the marker's plane of the distance between its true image and the image of the "
    "estimated grid with the intrinsics used by the estimate; in-plane rotation by the minimal rotation.",
    _PAPER,
)
CENTRE_IMAGE = Metric(
    "centre_image_error_px",
    "Centre's image",
    "px",
    "delivered image",
    "Distance between the image of the true circle's centre and that of the estimated centre with the intrinsics "
    "used by the estimate; for a method without poses, the point that it gives.",
    _OWN,
)
POSE = Metric(
    "pose_error_bounds",
    "Pose",
    "bounds",
    "true marker",
    "sqrt(e^T F e / 5): e consists of the rotation about the marker's X and Y axes from the true to the estimated "
    "normal and the error of the centre, F is the frame's Fisher information; about 1 for an efficient method.",
    "Mahalanobis 1936; F as in scenes/geometry/information.py",
)
MSSD = Metric(
    "mssd_m",
    "MSSD",
    "m",
    "camera",
    "Maximum symmetry-aware surface distance: the largest distance between corresponding points of the true and "
    "the estimated rim, at the rotation about the disc's normal that minimises it.",
    _BOP,
)
MSPD = Metric(
    "mspd_px",
    "MSPD",
    "px",
    "delivered image",
    "Maximum symmetry-aware projection distance: the same in the image, with both rims projected by the true "
    "camera, whatever intrinsics the estimate used.",
    _BOP,
)
ELLIPSE_CENTRE = Metric(
    "ellipse_centre_error_px",
    "Ellipse centre",
    "px",
    "delivered image",
    "Distance between the centres of the estimated and the true ellipse.",
    _OWN,
    of="ellipse",
    bound="ellipse_centre_bound_px",
)
CONTOUR = Metric(
    "contour_error_px",
    "Contour",
    "px",
    "delivered image",
    "Mean distance from the true contour to the nearest point on the estimated ellipse.",
    _OWN,
    of="ellipse",
    bound="ellipse_centre_bound_px",
)
FOCAL = Metric(
    "focal_error_pct",
    "Focal length",
    "%",
    "camera",
    "Magnitude of the relative error of the focal length that the method measured from the image alone.",
    _OWN,
    of="image",
)
FUSED_FOCAL = Metric(
    "fused_focal_error_pct",
    "Fused focal length",
    "%",
    "camera",
    "The same after fusion with the default phone's prior (11.5 %), by the inverse variances of log f.",
    _OWN,
    of="image",
)
METRICS: tuple[Metric, ...] = (
    NORMAL,
    POSITION_M,
    POSITION_D,
    POSITION,
    ALONG_RAY,
    ACROSS_RAY,
    REPROJECTION,
    CENTRE_IMAGE,
    POSE,
    MSSD,
    MSPD,
    ELLIPSE_CENTRE,
    CONTOUR,
    FOCAL,
    FUSED_FOCAL,
)

# The shift of the ellipse's centre, which the gate checks: it shows a convention that is off by half a pixel.
SHIFT_X, SHIFT_Y = (
    Metric(
        f"ellipse_centre_{axis}_error_px",
        f"Shift of the ellipse centre in {axis}",
        "px",
        "delivered image",
        f"Difference of the {axis} coordinates of the estimated and the true ellipse's centre.",
        _OWN,
        of="ellipse",
        signed=True,
    )
    for axis in ("x", "y")
)

# The headline errors of a page: one of each kind, lengths in percent of the distance.
HEADLINE: tuple[Metric, ...] = (NORMAL, POSITION, REPROJECTION)
# The errors of the paper's figures, whose unit of length is the marker's diameter.
PAPER: tuple[Metric, ...] = (NORMAL, POSITION_D, REPROJECTION)

POSE_METRICS: tuple[str, ...] = tuple(m.column for m in METRICS if m.of == "pose")
IMAGE_METRICS: tuple[str, ...] = tuple(m.column for m in METRICS if m.of == "image")
ELLIPSE_METRICS: tuple[str, ...] = tuple(m.column for m in METRICS if m.of == "ellipse")
