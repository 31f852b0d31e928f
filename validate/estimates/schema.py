"""Columns of a file of estimates: which are required, and the defaults of the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from roundel.scenes.errors import UsageError, did_you_mean
from roundel.solver.estimates import estimates_schema

DATASET = "dataset_id"
KEY = ("frame_id", "detection_id", "method", "intrinsics", "candidate")
NORMAL = ("normal_x", "normal_y", "normal_z")
CENTRE = ("centre_x_m", "centre_y_m", "centre_z_m")
ELLIPSE = ("ellipse_x_px", "ellipse_y_px", "ellipse_a_px", "ellipse_b_px", "ellipse_angle_deg")
CENTRE_IMAGE = ("centre_image_x_px", "centre_image_y_px")
COVARIANCE = tuple(f"cov_{i}{j}" for i in range(6) for j in range(i, 6))
INTRINSICS = ("fx_px", "fy_px", "skew_px", "cx_px", "cy_px")


@dataclass(frozen=True)
class Given:
    """A group of columns: their type, unit, meaning, and default."""

    names: tuple[str, ...]
    type: str
    unit: str
    meaning: str
    otherwise: str


COLUMNS: tuple[Given, ...] = (
    Given(("frame_id",), "integer", "", "the frame, as in cameras.json", "required"),
    Given(
        (*NORMAL, *CENTRE),
        "number",
        "1; m",
        "pose in OpenCV's camera frame: unit normal out of the printed face, toward the camera; the circle's centre",
        "one of pose, ellipse and centre is required; both poses of the ellipse, if there is one; a centre alone has "
        "no errors of pose",
    ),
    Given(
        ELLIPSE,
        "number",
        "px; deg",
        "image of the circle in undistorted pixel coordinates of the camera that was used: centre, semi-axes a >= b, "
        "angle from +x toward +y",
        "computed from the pose, with the diameter of the nearest printed circle",
    ),
    Given(
        CENTRE_IMAGE,
        "number",
        "px",
        "image of the circle's centre in the delivered image; (0, 0) is the centre of the top-left pixel",
        "the centre of the pose, projected",
    ),
    Given(
        ("fx_px", "fy_px", "cx_px", "cy_px"),
        "number",
        "px",
        "the intrinsics that were used",
        "the frame's true camera, where intrinsics is `true`",
    ),
    Given(("skew_px",), "number", "px", "likewise", "0"),
    Given(("distortion",), "list of numbers; in CSV between spaces", "", "likewise, OpenCV's order", "none"),
    Given(("distortion_model",), "text", "", "`opencv` or `fisheye`", "opencv"),
    Given(("method",), "text", "", "name of the method", "the file's name without its ending"),
    Given(("intrinsics",), "text", "", "name of the intrinsics, as `true`, `default`", "`true`"),
    Given(("detection_id",), "integer, 0 or more", "", "tells detections of one frame apart", "0: one a frame"),
    Given(("candidate",), "0 or 1", "", "tells the two poses of a detection apart", "0"),
    Given(
        ("chosen",), "true or false", "", "whether the method means this pose", "true where a detection has one pose"
    ),
    Given(
        ("probability",),
        "number, 0 to 1",
        "",
        "probability that the method gives this candidate, of the two of a detection; together at most 1",
        "none is stated, and none scored",
    ),
    Given(
        ("confidence",),
        "number, 0 to 1",
        "",
        "probability that the detection is the image of a circle; a value that is not from 0 to 1 is not scored",
        "likewise",
    ),
    Given(
        COVARIANCE,
        "number",
        "m^2; m; 1",
        "upper triangle of the covariance of (centre_x, centre_y, centre_z in m, normal_x, normal_y, normal_z), all 21 "
        "or none; an angle is in radians, as a step of the unit normal; what is stated along the normal is not used",
        "likewise",
    ),
    Given(
        ("clipped_fraction", "rejected_fraction", "misfit"),
        "number",
        "",
        "fraction of the edge's pixels that are clipped; fraction of the contour that was left out; reduced chi-square "
        "of the edge's pixels",
        "unknown",
    ),
    Given(
        ("fit_used", "curve"), "text", "", "the fit of the ellipse, and the response curve that was undone", "unknown"
    ),
    Given(
        ("caveats",),
        "text",
        "",
        "what the method's model did not hold for, sentences joined by semicolons; the report counts them",
        "none",
    ),
    Given(("identity",), "integer", "", "what the marker's code says", "none was read"),
    Given(
        ("focal_px", "focal_sigma_px"),
        "number",
        "px",
        "focal length measured from the image alone, and its standard deviation",
        "none was measured",
    ),
    Given(("status",), "`ok` or `failed`", "", "", "`failed` where pose, ellipse and centre are empty, else `ok`"),
    Given(("reason",), "text", "", "why it failed", "empty"),
    Given(
        (DATASET,),
        "text",
        "",
        "the dataset_id of manifest.json, or its first 12 digits or more, the same in all rows; estimates of another "
        "dataset are refused; in CSV also a comment above the header, `# dataset_id: 0123456789ab`",
        "only the frames are checked",
    ),
)
REQUIRED = ("frame_id",)


def check_columns(file: Path, names: Sequence[str]) -> None:
    """Reject a file whose columns are not those of estimates.

    Raises
    ------
    UsageError
        If a column is duplicated or misspelt, or a required column is missing.
    """
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise UsageError(f"{file}: column {twice[0]!r} appears twice; keep one of them")
    known = [*estimates_schema().names, DATASET]
    absent = [name for name in known if name not in names]
    for name in names:
        hint = "" if name in known else did_you_mean(name.lower(), absent, cutoff=0.85)
        if hint:
            raise UsageError(f"{file}: unknown column {name!r}; {hint}")
    groups = {"pose": (*NORMAL, *CENTRE), "ellipse": ELLIPSE, "centre": CENTRE_IMAGE}
    needed = list(REQUIRED)
    for group in (*groups.values(), COLUMNS[4].names, COVARIANCE):
        if any(name in names for name in group):
            needed += group
    missing = [name for name in needed if name not in names]
    if missing:
        raise UsageError(
            f"{file}: has no column {', '.join(missing)}; `roundel validate --schema` prints the required columns"
        )
    if not any(group[0] in names for group in groups.values()):
        offers = ", nor ".join(f"{what} ({group[0]} .. {group[-1]})" for what, group in groups.items())
        raise UsageError(f"{file}: has no columns of a {offers}; `roundel validate --schema` prints what is required")


def columns_markdown() -> str:
    """The columns as a Markdown table, for `roundel validate --schema` and docs/your-own-method.md."""
    lines = ["| column | type | unit | meaning | where it is left out |", "|---|---|---|---|---|"]
    for given in COLUMNS:
        names = ", ".join(f"`{name}`" for name in given.names)
        lines.append(f"| {names} | {given.type} | {given.unit} | {given.meaning} | {given.otherwise} |")
    return "\n".join(lines)


def columns_json() -> list[dict[str, Any]]:
    """The columns, one record per column."""
    return [
        {"column": name, "type": g.type, "unit": g.unit, "meaning": g.meaning, "otherwise": g.otherwise}
        for g in COLUMNS
        for name in g.names
    ]
