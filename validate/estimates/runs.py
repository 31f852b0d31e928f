"""Estimates as runs, checked for consistency before anything is scored."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from roundel.datasets.dataset import Dataset
from roundel.scenes.camera.model import Camera
from roundel.scenes.errors import NotComparableError, UsageError
from roundel.validate.estimates.both_poses import FROM_ELLIPSE, with_both_poses
from roundel.validate.estimates.defaults import centres_px, ellipses_of_poses, radii_m, true_intrinsics
from roundel.validate.estimates.reader import dataset_of, frame_ids_of, images_of, read_estimates
from roundel.validate.estimates.row_checks import (
    check_rows,
    covariances,
    floats,
    is_ok,
    lenses_of,
    place_of,
    with_unseen_failed,
)
from roundel.validate.estimates.schema import CENTRE, CENTRE_IMAGE, ELLIPSE, INTRINSICS, KEY, NORMAL

Array = NDArray[np.float64]

# A circle whose image is smaller than this cannot have been detected: its pose must be in other units.
_LEAST_SEMI_AXIS_PX = 0.25

_TRUE_CAMERA = "not given: the frame's true camera"


@dataclass(frozen=True)
class Run:
    """All rows of one method with one kind of intrinsics, sorted by frame, detection and candidate.

    `cameras[camera[i]]` is the camera that row i used; `ok[i]` tells whether it has a detection, `posed[i]` whether the
    detection has a pose. `ellipse` is NaN if there is none; `centre_px` is the image of the circle's centre in the
    delivered image, for a pose its projection. `filled` lists the defaults that were used; `caveats` has those of each
    row. `identity`, `focal_px`, `focal_sigma_px`, `covariance` (of centre in m and normal, (n, 6, 6)), `probability`
    (of the candidate) and `confidence` (of the detection) are NaN where the method gives none.
    """

    method: str
    intrinsics: str
    frame_id: NDArray[np.int64]
    detection_id: NDArray[np.int64]
    candidate: NDArray[np.int64]
    chosen: NDArray[np.bool_]
    ok: NDArray[np.bool_]
    posed: NDArray[np.bool_]
    normal: Array
    centre_m: Array
    ellipse: Array
    centre_px: Array
    camera: NDArray[np.int64]
    cameras: list[Camera]
    reason: list[str]
    filled: tuple[str, ...] = ()
    caveats: tuple[tuple[str, ...], ...] = ()
    identity: Array = field(default_factory=lambda: np.empty(0))
    focal_px: Array = field(default_factory=lambda: np.empty(0))
    focal_sigma_px: Array = field(default_factory=lambda: np.empty(0))
    covariance: Array = field(default_factory=lambda: np.empty((0, 6, 6)))
    probability: Array = field(default_factory=lambda: np.empty(0))
    confidence: Array = field(default_factory=lambda: np.empty(0))


def read_runs(
    paths: list[Path], dataset: Dataset, whole: Dataset | None = None, tolerated: Collection[Path] = ()
) -> list[Run]:
    """Estimates of all files, checked against the dataset, as one `Run` per method and intrinsics, sorted.

    Parameters
    ----------
    paths : list of path
    dataset : Dataset
    whole : Dataset, optional
        The dataset of which `dataset` is a shard: only the rows of its frames are read.
    tolerated : collection of path
        Files in another convention (see `roundel.validate.diagnosis`): rows of unknown frames are left out, and poses
        that cannot be fail, with the reason.

    Raises
    ------
    UsageError
        As `read_estimates`; also for invalid or duplicate rows.
    DataError
        As `read_estimates`.
    NotComparableError
        If there is nothing to compare, or the estimates are of another dataset.
    """
    if not paths:
        raise NotComparableError("no estimates given; give one or more files written by `roundel solve`")
    parted = whole is not None and len(whole.contents.parts) > 1
    ids = dataset.images.frame_ids
    wanted = range(ids[0], ids[-1] + 1) if parted and ids else None
    tables = [_read(path, dataset, wanted, path in tolerated) for path in paths]
    _check_apart(tables, paths)
    table = pa.concat_tables([t.replace_schema_metadata(None) for t in tables])
    if table.num_rows == 0:
        if parted:
            return []
        raise NotComparableError(f"{', '.join(map(str, paths))}: no rows, so there is nothing to score")
    table = _sorted(table)
    _check_keys(table, " and ".join(map(str, paths)))
    return _split(table, dataset, bool(tolerated))


def runs_of(table: pa.Table, dataset: Dataset, path: Path) -> list[Run]:
    """The runs of a table from `read_estimates`, tolerant as `read_runs` can be; an ellipse alone stays alone.

    Raises
    ------
    UsageError
        If rows are invalid for other reasons than a convention.
    """
    checked = _checked(table, dataset, path, tolerant=True)
    return _split(checked, dataset, tolerant=True, both_poses=False) if checked.num_rows else []


def _split(table: pa.Table, dataset: Dataset, tolerant: bool, both_poses: bool = True) -> list[Run]:
    """The runs of a sorted table."""
    frame_size = {int(r["frame_id"]): (int(r["width_px"]), int(r["height_px"])) for r in dataset.images.records}
    labels = [np.array(table[name].to_pylist(), dtype=object) for name in ("method", "intrinsics")]
    change = np.flatnonzero(np.any([label[1:] != label[:-1] for label in labels], axis=0)) + 1
    bounds = pairwise([0, *change.tolist(), table.num_rows])
    return [_run(table.slice(a, b - a), dataset, frame_size, tolerant, both_poses) for a, b in bounds]


def touched_groups(paths: list[Path], dataset: Dataset, tolerated: Collection[Path] = ()) -> frozenset[str]:
    """Groups of which the files have frames.

    Raises
    ------
    NotComparableError
        If they have frames that the dataset does not have, unless this is tolerated, or no rows at all.
    """
    images = dataset.images
    ids, groups = np.array(images.frame_ids), np.array(images.groups, dtype=object)
    touched: set[str] = set()
    rows = 0
    for path in paths:
        found = frame_ids_of(path)
        rows += len(found)
        unknown = np.setdiff1d(found, ids)
        if len(unknown) and path not in tolerated:
            more = f" and {len(unknown) - 1} more" if len(unknown) > 1 else ""
            raise NotComparableError(
                f"{path}: the estimates have frame {unknown[0]}{more}, which {dataset.address} does not have; "
                "give the dataset that they were made from"
            )
        touched |= set(groups[np.isin(ids, found)].tolist())
    if not rows:
        raise NotComparableError(f"{', '.join(map(str, paths))}: no rows, so there is nothing to score")
    return frozenset(touched)


def _read(path: Path, dataset: Dataset, frames: range | None, tolerant: bool) -> pa.Table:
    """One file, or its rows of some frames, checked for consistency and against the dataset."""
    table = read_estimates(path, frames)
    made_of, here = dataset_of(table), str(dataset.manifest["dataset_id"])
    if made_of is not None and not here.startswith(made_of):
        raise NotComparableError(
            f"{path}: the estimates are of dataset {made_of[:12]}, but {dataset.address} is {here[:12]}; "
            "give the dataset that they were made from"
        )
    images = images_of(table)
    if images is not None and images != dataset.images.images_sha256:
        raise NotComparableError(
            f"{path}: the estimates were made from other images of {dataset.address} ({images[:12]}, now "
            f"{dataset.images.images_sha256[:12]}); solve it again"
        )
    return _checked(table, dataset, path, tolerant)


def _checked(table: pa.Table, dataset: Dataset, path: Path, tolerant: bool) -> pa.Table:
    """The rows sorted, with cameras, and checked for consistency and against the dataset's frames."""
    for name in (*KEY, "chosen", "status"):
        if table[name].null_count:
            row = int(np.flatnonzero(table[name].is_null().to_numpy())[0])
            raise UsageError(f"{path}: column {name} has empty values, the first in row {row + 1}; every row needs one")
    if tolerant:
        table = table.filter(pc.is_in(table["frame_id"], value_set=pa.array(dataset.images.frame_ids, pa.int64())))
    _check_frames(table, dataset, path)
    table = _sorted(table)
    _check_keys(table, str(path))
    table = _with_cameras(table, dataset, path)
    if tolerant:
        table = with_unseen_failed(table)
    check_rows(table, path)
    return table


def _sorted(table: pa.Table) -> pa.Table:
    return table.sort_by([(name, "ascending") for name in ("method", "intrinsics", *KEY[:2], "candidate")])


def _with_cameras(table: pa.Table, dataset: Dataset, path: Path) -> pa.Table:
    """The table with each frame's true camera if rows have none; other labels require a camera in the file."""
    bare = table[INTRINSICS[0]].is_null().to_numpy() & (is_ok(table))
    if not bare.any():
        return table
    label = table["intrinsics"].to_pylist()
    other = [i for i in np.flatnonzero(bare).tolist() if label[i] != "true"]
    if other:
        raise UsageError(
            f"{path}: {place_of(table, other[0])}: it has no fx_px, fy_px, cx_px, cy_px; they are optional only for "
            "intrinsics `true`"
        )
    values, distortion, model = true_intrinsics(dataset, table["frame_id"].to_numpy())
    made: dict[str, list[Any]] = {name: values[:, i].tolist() for i, name in enumerate(INTRINSICS)}
    made |= {"distortion": distortion, "distortion_model": model, "intrinsics_basis": [_TRUE_CAMERA] * len(label)}
    for name, instead in made.items():
        at = table.column_names.index(name)
        mixed = [new if b else old for b, new, old in zip(bare, instead, table[name].to_pylist(), strict=True)]
        table = table.set_column(at, name, pa.array(mixed, table.schema.field(at).type))
    return table


def _run(
    table: pa.Table, dataset: Dataset, frame_size: dict[int, tuple[int, int]], tolerant: bool, both_poses: bool
) -> Run:
    index, cameras = _cameras(table, frame_size)
    if both_poses:
        table, index = with_both_poses(table, dataset, index, cameras)
    frame_id = table["frame_id"].to_numpy()
    ok = is_ok(table)
    normal, centre, ellipse = floats(table, NORMAL), floats(table, CENTRE), floats(table, ELLIPSE)
    posed = ok & np.isfinite(normal).all(axis=-1)
    centre_px = floats(table, CENTRE_IMAGE)
    reason = [why or "" for why in table["reason"].to_pylist()]
    bare = posed & np.isnan(ellipse[:, 0])
    for number, camera in enumerate(cameras):
        mine = np.flatnonzero(posed & (index == number))
        centre_px[mine] = centres_px(centre[mine], camera)
        mine = np.flatnonzero(bare & (index == number))
        radius = radii_m(dataset, frame_id[mine], centre_px[mine])
        ellipse[mine] = ellipses_of_poses(normal[mine], centre[mine], radius, camera)
        small = np.flatnonzero(ellipse[mine, 2] < _LEAST_SEMI_AXIS_PX)
        for row in mine[small].tolist():
            what = f"its circle would be {2 * ellipse[row, 2]:.2g} px wide; is its centre in metres?"
            if not tolerant:
                raise UsageError(f"estimates: {place_of(table, row)}: {what}")
            ok[row] = posed[row] = False
            ellipse[row], reason[row] = np.nan, what
    filled = {
        "intrinsics: each frame's true camera": _TRUE_CAMERA in table["intrinsics_basis"].to_pylist(),
        "ellipse: from the pose": bool(bare.any()),
        "pose: both poses of the ellipse": FROM_ELLIPSE in table["choice_basis"].to_pylist(),
    }
    identity, focal_px, focal_sigma_px = floats(table, ("identity", "focal_px", "focal_sigma_px")).T
    return Run(
        table["method"][0].as_py(),
        table["intrinsics"][0].as_py(),
        frame_id,
        table["detection_id"].to_numpy(),
        table["candidate"].to_numpy(),
        table["chosen"].to_numpy(zero_copy_only=False) & ok,
        ok,
        posed,
        normal,
        centre,
        ellipse,
        centre_px,
        index,
        cameras,
        reason,
        tuple(what for what, is_so in filled.items() if is_so),
        tuple(_sentences(text or "") for text in table["caveats"].to_pylist()),
        identity,
        focal_px,
        focal_sigma_px,
        covariances(table),
        *floats(table, ("probability", "confidence")).T,
    )


def _cameras(table: pa.Table, frame_size: dict[int, tuple[int, int]]) -> tuple[NDArray[np.int64], list[Camera]]:
    """The distinct cameras of a table, and the index of each row's; -1 if it has none."""
    frame_id = table["frame_id"].to_numpy()
    values = floats(table, INTRINSICS)
    known: dict[tuple[Any, ...], int] = {}
    cameras: list[Camera] = []
    index = np.full(table.num_rows, -1)
    for i, (distortion, model) in enumerate(lenses_of(table)):
        if np.isnan(values[i, 0]):
            continue
        key = (*frame_size[int(frame_id[i])], *values[i].tolist(), model, *distortion)
        if key not in known:
            known[key] = len(cameras)
            fx, fy, skew, cx, cy = values[i]
            k = np.array([[fx, skew, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
            cameras.append(Camera(key[0], key[1], k, distortion, distortion_model=model))
        index[i] = known[key]
    return index, cameras


def _sentences(text: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in text.split(";") if part.strip())


def _check_frames(table: pa.Table, dataset: Dataset, path: Path) -> None:
    unknown = sorted(set(table["frame_id"].unique().to_pylist()) - set(dataset.images.frame_ids))
    if unknown:
        more = f" and {len(unknown) - 1} more" if len(unknown) > 1 else ""
        raise NotComparableError(
            f"{path}: the estimates have frame {unknown[0]}{more}, which {dataset.address} does not have; "
            "give the dataset that they were made from"
        )


def _check_apart(tables: list[pa.Table], paths: list[Path]) -> None:
    """Reject a run that two files have for the same frame; a run may be split into files of different frames."""
    owner: dict[tuple[str, str, int], Path] = {}
    for table, path in zip(tables, paths, strict=True):
        keys = set(zip(*(table[n].to_pylist() for n in ("method", "intrinsics", "frame_id")), strict=True))
        twice = sorted(keys & owner.keys())
        if twice:
            method, intrinsics, frame = twice[0]
            raise UsageError(
                f"{path}: has method {method} with {intrinsics} intrinsics for frame {frame}, as does "
                f"{owner[twice[0]]}; give each its own name in the column `method`, or validate them separately and "
                "use `roundel compare`"
            )
        owner.update(dict.fromkeys(keys, path))


def _check_keys(table: pa.Table, where: str) -> None:
    columns = [np.array(table[name].to_pylist(), dtype=object) for name in KEY]
    same = np.all([column[1:] == column[:-1] for column in columns], axis=0)
    if same.any():
        row = int(np.flatnonzero(same)[0])
        raise UsageError(
            f"{where}: two rows for {place_of(table, row)}; each may appear once: several detections in a frame need "
            "detection_id, two poses of a detection need candidate 0 and 1"
        )
