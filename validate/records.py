"""Estimates read back and checked: a file that lies is refused in one line, before anything is scored."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from roundel.datasets.dataset import Dataset
from roundel.scenes.camera import Camera, lens_problem
from roundel.scenes.errors import DataError, NotComparableError
from roundel.validate.estimates_file import CENTRE, ELLIPSE, INTRINSICS, KEY, NORMAL, read_estimates

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Run:
    """All rows of one method with one kind of intrinsics, sorted by frame, detection and candidate.

    `cameras[camera[i]]` is the camera that row i used; `ok[i]` says whether it holds a pose.
    """

    method: str
    intrinsics: str
    frame_id: NDArray[np.int64]
    detection_id: NDArray[np.int64]
    candidate: NDArray[np.int64]
    chosen: NDArray[np.bool_]
    ok: NDArray[np.bool_]
    normal: Array
    centre_m: Array
    ellipse: Array
    camera: NDArray[np.int64]
    cameras: list[Camera]
    reason: list[str]


def read_runs(paths: list[Path], dataset: Dataset) -> list[Run]:
    """Estimates of all files, checked against the dataset, one `Run` for each method and intrinsics, sorted.

    Raises
    ------
    UsageError, DataError
        As `read_estimates`; DataError also for a pose that cannot be.
    NotComparableError
        If there is nothing to compare, or the estimates are of another dataset's frames.
    """
    if not paths:
        raise NotComparableError("no estimates given; give one or more files that `roundel solve` wrote")
    tables = [read_estimates(path) for path in paths]
    table = pa.concat_tables(tables)
    if table.num_rows == 0:
        raise NotComparableError(f"{', '.join(map(str, paths))}: no rows, so there is nothing to score")
    for name in (*KEY, "chosen", "status"):
        if table[name].null_count:
            raise DataError(f"estimates: column {name} has empty values; every row needs one")
    _check_frames(table, dataset)
    table = table.sort_by([(name, "ascending") for name in ("method", "intrinsics", *KEY[:2], "candidate")])
    _check_keys(table)
    ok = np.array(table["status"].to_pylist()) == "ok"
    _check_poses(table, ok)
    frame_size = {int(r["frame_id"]): (int(r["width_px"]), int(r["height_px"])) for r in dataset.images.records}
    labels = [np.array(table[name].to_pylist(), dtype=object) for name in ("method", "intrinsics")]
    change = np.flatnonzero(np.any([label[1:] != label[:-1] for label in labels], axis=0)) + 1
    bounds = pairwise([0, *change.tolist(), table.num_rows])
    return [_run(table.slice(a, b - a), ok[a:b], frame_size) for a, b in bounds]


def _floats(table: pa.Table, names: tuple[str, ...]) -> Array:
    # Nulls become NaN.
    return np.stack([np.asarray(table[name].to_numpy(), dtype=np.float64) for name in names], axis=-1)


def _lenses(table: pa.Table) -> list[tuple[tuple[float, ...], str]]:
    """Coefficients and model of each row; `none` is OpenCV's model without coefficients, as in cameras.json."""
    coefficients = [
        tuple(np.nan if c is None else float(c) for c in row or ()) for row in table["distortion"].to_pylist()
    ]
    models = table["distortion_model"].to_pylist()
    return [(c, "opencv" if m == "none" and not c else m) for c, m in zip(coefficients, models, strict=True)]


def _run(table: pa.Table, ok: NDArray[np.bool_], frame_size: dict[int, tuple[int, int]]) -> Run:
    frame_id = table["frame_id"].to_numpy()
    values = _floats(table, INTRINSICS)
    known: dict[tuple[Any, ...], int] = {}
    cameras: list[Camera] = []
    index = np.full(table.num_rows, -1)
    for i, (distortion, model) in enumerate(_lenses(table)):
        if np.isnan(values[i, 0]):
            continue
        key = (*frame_size[int(frame_id[i])], *values[i].tolist(), model, *distortion)
        if key not in known:
            known[key] = len(cameras)
            fx, fy, skew, cx, cy = values[i]
            k = np.array([[fx, skew, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
            cameras.append(Camera(key[0], key[1], k, distortion, distortion_model=model))
        index[i] = known[key]
    return Run(
        table["method"][0].as_py(),
        table["intrinsics"][0].as_py(),
        frame_id,
        table["detection_id"].to_numpy(),
        table["candidate"].to_numpy(),
        table["chosen"].to_numpy(zero_copy_only=False),
        ok,
        _floats(table, NORMAL),
        _floats(table, CENTRE),
        _floats(table, ELLIPSE),
        index,
        cameras,
        [reason or "" for reason in table["reason"].to_pylist()],
    )


def _where(table: pa.Table, row: int) -> str:
    values = {name: table[name][row].as_py() for name in KEY}
    return (
        f"frame {values['frame_id']}, detection {values['detection_id']}, candidate {values['candidate']} "
        f"(method {values['method']}, intrinsics {values['intrinsics']})"
    )


def _check_frames(table: pa.Table, dataset: Dataset) -> None:
    unknown = sorted(set(table["frame_id"].unique().to_pylist()) - set(dataset.images.frame_ids))
    if unknown:
        more = f" and {len(unknown) - 1} more" if len(unknown) > 1 else ""
        raise NotComparableError(
            f"the estimates have frame {unknown[0]}{more}, which {dataset.path} does not have; "
            "give the dataset that they were made from"
        )


def _check_keys(table: pa.Table) -> None:
    columns = [table[name].to_numpy(zero_copy_only=False) for name in KEY]
    same = np.all([column[1:] == column[:-1] for column in columns], axis=0)
    if same.any():
        raise DataError(f"estimates: two rows for {_where(table, int(np.flatnonzero(same)[0]))}; each may stand once")


def _check_poses(table: pa.Table, ok: NDArray[np.bool_]) -> None:
    """Refuse what no solver may claim with status `ok`."""
    normal, centre, ellipse = _floats(table, NORMAL), _floats(table, CENTRE), _floats(table, ELLIPSE)
    focal, lenses = _floats(table, INTRINSICS), _lenses(table)
    # A run has few different lenses, and many rows.
    wrong = {lens: lens_problem(lens[1], lens[0]) for lens in set(lenses)}
    lens_wrong = np.array([bool(wrong[lens]) for lens in lenses])
    which = int(np.argmax(ok & lens_wrong))
    candidate = table["candidate"].to_numpy()
    detection = table["detection_id"].to_numpy()
    chosen = table["chosen"].to_numpy(zero_copy_only=False)
    finite = np.isfinite(np.concatenate([normal, centre, ellipse, focal], axis=-1)).all(axis=-1)
    keys = [table[name].to_numpy(zero_copy_only=False) for name in KEY[:-1]]
    pair = np.append(np.all([key[1:] == key[:-1] for key in keys], axis=0), False)
    with np.errstate(invalid="ignore"):
        problems = (
            (~np.isin(np.array(table["status"].to_pylist()), ["ok", "failed"]), "its status is neither ok nor failed"),
            (~np.isin(candidate, [0, 1]), "the candidate is neither 0 nor 1"),
            (ok & (detection < 0), "its status is ok, but its detection_id is negative"),
            (
                ok & ~finite,
                "its status is ok, but a number of its pose, ellipse or intrinsics is missing or not finite",
            ),
            (ok & ~(np.abs(np.linalg.norm(normal, axis=-1) - 1) < 1e-6), "its normal is not of unit length"),
            (ok & ~(centre[:, 2] > 0), "its centre is behind the camera"),
            (ok & ~(np.sum(normal * centre, axis=-1) < 0), "its normal points away from the camera"),
            (ok & ~((ellipse[:, 2] >= ellipse[:, 3]) & (ellipse[:, 3] > 0)), "its ellipse needs semi-axes a >= b > 0"),
            (ok & ~(focal[:, :2] > 0).all(axis=-1), "its focal lengths are not positive"),
            (ok & lens_wrong, f"its {wrong[lenses[which]]}"),
            (chosen & ~ok, "it is chosen, but its status is not ok"),
            (pair & chosen & np.append(chosen[1:], False), "both candidates are chosen"),
        )
    for bad, what in problems:
        if np.any(bad):
            raise DataError(f"estimates: {_where(table, int(np.flatnonzero(bad)[0]))}: {what}")
