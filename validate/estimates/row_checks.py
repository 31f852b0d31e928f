"""Rows of estimates: their values as arrays, and rows that are impossible."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from roundel.scenes.camera.model import lens_problem
from roundel.scenes.errors import UsageError
from roundel.validate.estimates.schema import CENTRE, CENTRE_IMAGE, COVARIANCE, ELLIPSE, INTRINSICS, KEY, NORMAL

Array = NDArray[np.float64]

# All elements of a covariance, from its upper triangle.
_WHOLE = tuple(f"cov_{min(i, j)}{max(i, j)}" for i in range(6) for j in range(6))
# An eigenvalue may be this much below zero, beside the largest: one that is zero, of numbers written with six digits.
_ROUNDED = 1e-6


def is_ok(table: pa.Table) -> NDArray[np.bool_]:
    """Which rows have a detection."""
    return np.array([status == "ok" for status in table["status"].to_pylist()], dtype=np.bool_)


def floats(table: pa.Table, names: tuple[str, ...]) -> Array:
    """Columns of numbers, (n, names); NaN for null."""
    columns = (table[name].to_numpy(zero_copy_only=False) for name in names)
    return np.stack([np.asarray(column, dtype=np.float64) for column in columns], axis=-1)


def covariances(table: pa.Table) -> Array:
    """Covariance of each row, (n, 6, 6), of centre (m) and normal; NaN where there is none."""
    return floats(table, _WHOLE).reshape(-1, 6, 6)


def lenses_of(table: pa.Table) -> list[tuple[tuple[float, ...], str]]:
    """Coefficients and model of each row; `none` is OpenCV's model without coefficients, as in cameras.json."""
    coefficients = [
        tuple(np.nan if c is None else float(c) for c in row or ()) for row in table["distortion"].to_pylist()
    ]
    models = table["distortion_model"].to_pylist()
    return [(c, "opencv" if m == "none" and not c else m) for c, m in zip(coefficients, models, strict=True)]


def place_of(table: pa.Table, row: int) -> str:
    """A row as the text of an error."""
    values = {name: table[name][row].as_py() for name in KEY}
    return (
        f"frame {values['frame_id']}, detection {values['detection_id']}, candidate {values['candidate']} "
        f"(method {values['method']}, intrinsics {values['intrinsics']})"
    )


def check_rows(table: pa.Table, path: Path) -> None:
    """Reject rows with status `ok` that are not valid."""
    ok = is_ok(table)
    normal, centre, ellipse = floats(table, NORMAL), floats(table, CENTRE), floats(table, ELLIPSE)
    given = {
        "pose": (*NORMAL, *CENTRE),
        "ellipse": ELLIPSE,
        "centre": CENTRE_IMAGE,
        "intrinsics": INTRINSICS,
        "covariance": COVARIANCE,
    }
    # A group of columns counts as given if any value is given, even NaN; then all must be numbers.
    there = {what: _given(table, names) for what, names in given.items()}
    broken = {what: there[what] & ~np.isfinite(floats(table, names)).all(axis=-1) for what, names in given.items()}
    posed, outlined = there["pose"] & ~broken["pose"], there["ellipse"] & ~broken["ellipse"]
    focal, lenses = floats(table, INTRINSICS), lenses_of(table)
    # A run has few different lenses but many rows.
    wrong = {lens: lens_problem(lens[1], lens[0]) for lens in set(lenses)}
    lens_wrong = np.array([bool(wrong[lens]) for lens in lenses], dtype=bool)
    candidate = table["candidate"].to_numpy()
    detection = table["detection_id"].to_numpy()
    chosen = table["chosen"].to_numpy(zero_copy_only=False)
    keys = [np.array(table[name].to_pylist(), dtype=object) for name in KEY[:-1]]
    pair = np.append(np.all([key[1:] == key[:-1] for key in keys], axis=0), False) if len(ok) else np.zeros(0, bool)
    both = pair | np.append(False, pair[:-1]) if len(ok) else pair
    status = np.array(table["status"].to_pylist(), dtype=object)
    probability, confidence = _stated(table, "probability"), _stated(table, "confidence")
    some = there["pose"] | there["ellipse"] | there["centre"]
    with np.errstate(invalid="ignore", over="ignore"):
        problems = (
            ((status != "ok") & (status != "failed"), "its status is neither ok nor failed"),
            (~np.isin(candidate, [0, 1]), "the candidate is neither 0 nor 1"),
            (ok & (detection < 0), "its status is ok, but its detection_id is negative"),
            (ok & ~some, "its status is ok, but its pose, ellipse and centre are missing"),
            *(
                (ok & broken[what], f"its status is ok, but a number of its {what} is missing or not finite")
                for what in given
            ),
            (ok & ~there["intrinsics"], "its status is ok, but its intrinsics are missing"),
            (ok & posed & ~(np.abs(np.linalg.norm(normal, axis=-1) - 1) < 1e-6), "its normal is not of unit length"),
            *((ok & posed & bad, what) for bad, what in unseen_poses(normal, centre)),
            (
                ok & outlined & ~((ellipse[:, 2] >= ellipse[:, 3]) & (ellipse[:, 3] > 0)),
                "its ellipse needs semi-axes a >= b > 0",
            ),
            (ok & ~(focal[:, :2] > 0).all(axis=-1), "its focal lengths are not positive"),
            (ok & lens_wrong, f"its {wrong[lenses[int(np.argmax(ok & lens_wrong))]]}" if len(ok) else ""),
            (ok & both & ~there["pose"], "it has two candidates, but no pose to distinguish them"),
            (ok & there["covariance"] & ~there["pose"], "it has a covariance, but no pose"),
            (
                ok & there["covariance"] & indefinite(covariances(table)),
                "its covariance is not positive semidefinite",
            ),
            (ok & ((probability < 0) | (probability > 1)), "its probability is not between 0 and 1"),
            (
                ok & pair & (probability + np.append(probability[1:], np.nan) > 1 + _ROUNDED),
                "the probabilities of its two candidates add up to more than 1",
            ),
            (ok & np.isinf(confidence), "its confidence is not finite"),
            (chosen & ~ok, "it is chosen, but its status is not ok"),
            (pair & chosen & np.append(chosen[1:], False), "both candidates are chosen"),
        )
    for bad, what in problems:
        if np.any(bad):
            raise UsageError(f"{path}: {place_of(table, int(np.flatnonzero(bad)[0]))}: {what}")


def unseen_poses(normal: Array, centre_m: Array) -> list[tuple[NDArray[np.bool_], str]]:
    """Which poses (n, 3) no camera can see, for each reason: most often their axes are other ones."""
    return [
        (~(centre_m[:, 2] > 0), "its centre is behind the camera"),
        (~(np.sum(normal * centre_m, axis=-1) < 0), "its normal points away from the camera"),
    ]


def with_unseen_failed(table: pa.Table) -> pa.Table:
    """The table with poses that no camera can see as failed rows, which say so."""
    normal, centre = floats(table, NORMAL), floats(table, CENTRE)
    posed = is_ok(table) & np.isfinite(normal).all(axis=-1) & np.isfinite(centre).all(axis=-1)
    with np.errstate(invalid="ignore", over="ignore"):
        unseen = unseen_poses(normal, centre)
    for bad, what in reversed(unseen):
        table = with_rows_failed(table, posed & bad, what)
    return table


def with_rows_failed(table: pa.Table, rows: NDArray[np.bool_], reason: str) -> pa.Table:
    """The table with some rows failed, for a reason."""
    for name, value in (("status", "failed"), ("reason", reason), ("chosen", False)):
        at = table.column_names.index(name)
        column = pc.if_else(pa.array(rows), pa.scalar(value, table.schema.field(at).type), table[name])
        table = table.set_column(at, name, column)
    return table


def _stated(table: pa.Table, name: str) -> Array:
    """A column of probabilities: NaN where none is given, infinite where one is given that is no number."""
    values = floats(table, (name,))[:, 0]
    return np.where(_given(table, (name,)) & np.isnan(values), np.inf, values)


def indefinite(covariance: Array) -> NDArray[np.bool_]:
    """Which of n matrices (n, 6, 6) are no covariances; lengths and normals are compared in units of their own."""
    known = np.isfinite(covariance).all(axis=(1, 2))
    out = np.zeros(len(covariance), dtype=bool)
    some = covariance[known]
    largest = np.abs(np.diagonal(some, axis1=1, axis2=2)).reshape(-1, 2, 3).max(axis=2).repeat(3, axis=1)
    unit = np.sqrt(np.where(largest > 0, largest, 1.0))
    values = np.linalg.eigvalsh(some / unit[:, :, None] / unit[:, None, :])
    out[known] = values[:, 0] < -_ROUNDED * np.abs(values).max(axis=1)
    return out


def _given(table: pa.Table, names: tuple[str, ...]) -> NDArray[np.bool_]:
    return np.asarray(np.any([table[name].is_valid().to_numpy() for name in names], axis=0), dtype=np.bool_)
