"""Which other convention makes the estimates of a file fit, and by how much."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from roundel.datasets.dataset import Dataset
from roundel.scenes.errors import RoundelError
from roundel.solver.catalogue import is_own
from roundel.validate.diagnosis.conventions import CONVENTIONS, PARTS, Convention, Part
from roundel.validate.diagnosis.fit import detections_of, errors_px
from roundel.validate.estimates.reader import dataset_of, frame_ids_of, images_of, read_estimates
from roundel.validate.metrics.ground_truth import Targets, true_targets

Array = NDArray[np.float64]

# A convention is wrong everywhere: these are enough to see it.
_FRAMES = 100
_PAIRS = 10_000  # of a detection and a circle

# Fewer circles may fit a convention by accident: one whose estimates did not match at all, and one whose did.
_LEAST, _LEAST_MATCHED = 3, 8
# Of the circles that fit, this share must fit better than as given, and the median error must fall below this part.
_SHARE_BETTER, _MEDIAN_BELOW = 0.8, 0.6
# Estimates that fit this well are right.
_RIGHT_SHARE, _RIGHT_PX = 0.95, 0.05


@dataclass(frozen=True)
class Diagnosis:
    """A wrong convention of a run.

    Attributes
    ----------
    file, method, intrinsics : str
        The file's name, and the run.
    part, convention : str
        The part of its estimates, and the name of the convention.
    circles, fit_before, fit_after : int
        Circles that were looked at, and how many of them match the estimates as given and with the convention undone.
    median_before_px, median_after_px : float or None
        Median distance of the contours (or centres) of those that match; None if none does.
    text, remedy : str
        See `Convention`.
    """

    file: str
    method: str
    intrinsics: str
    part: str
    convention: str
    circles: int
    fit_before: int
    fit_after: int
    median_before_px: float | None
    median_after_px: float | None
    text: str
    remedy: str

    @property
    def sentence(self) -> str:
        """The diagnosis as a warning."""
        before = f"{self.fit_before} do" + (f", {self.median_before_px:.2g} px away" if self.median_before_px else "")
        return (
            f"{self.file}: it seems that the file {self.text}. With that undone, the {self.part} of method "
            f"{self.method} ({self.intrinsics}) fits {self.fit_after} of {self.circles} circles, "
            f"{self.median_after_px:.2g} px away in the median; as given {before}. To correct it, {self.remedy}"
        )

    def record(self) -> dict[str, Any]:
        """The diagnosis in summary.json."""
        return {**asdict(self), "sentence": self.sentence}


def diagnose(file: Path, dataset: Dataset) -> list[Diagnosis]:
    """The wrong conventions of a file of estimates, at most one for each part of a run.

    A convention is named only if it makes estimates fit that did not: right ones, merely bad ones and those of another
    dataset have none. A file that cannot be read has none either; reading it for the scores says why.
    """
    try:
        return _of_file(file, dataset)
    except RoundelError:
        return []


def _of_file(file: Path, dataset: Dataset) -> list[Diagnosis]:
    part = _shard_of(dataset, frame_ids_of(file))
    if part is None:
        return []
    ids = part.images.frame_ids
    table = read_estimates(file, range(min(ids) - 1, max(ids) + 2))
    made_of = dataset_of(table)
    if made_of is not None and not str(dataset.manifest["dataset_id"]).startswith(made_of):
        return []
    targets = true_targets(part, 1.0)
    out: list[Diagnosis] = []
    for method, intrinsics in sorted(set(zip(*(table[n].to_pylist() for n in ("method", "intrinsics")), strict=True))):
        if is_own(method) and images_of(table) is not None:
            continue  # `roundel solve` wrote it, and knows its conventions
        mine = table.filter(pc.and_(pc.equal(table["method"], method), pc.equal(table["intrinsics"], intrinsics)))
        for what in PARTS:
            rows = detections_of(mine, what)
            found = _of_part(rows, what, part, targets, file) if rows.num_rows else None
            # Frames, pixels and axes are those of all parts: one sentence is enough.
            if found and all(
                (d.method, d.intrinsics, d.convention) != (method, intrinsics, found[0].name) for d in out
            ):
                convention, before, after = found
                out.append(_diagnosis(file.name, method, intrinsics, what, convention, before, after))
    return out


def _shard_of(dataset: Dataset, frames: NDArray[np.int64]) -> Dataset | None:
    """The first shard of which a file has frames; None if it has none of the dataset."""
    for number in range(len(dataset.contents.parts)):
        part = dataset.of_part(number)
        if np.isin(frames, part.images.frame_ids).any():
            return part
    return None


def _of_part(
    rows: pa.Table, part: Part, dataset: Dataset, targets: Targets, file: Path
) -> tuple[Convention, Array, Array] | None:
    """The convention of a part of a run, and the errors of the circles as given and without it; None if it is right."""
    rows, looked_at = _sample(rows, targets)
    if not len(looked_at):
        return None
    before = errors_px(rows, part, None, dataset, looked_at, file)
    fits = np.isfinite(before)
    if fits.mean() >= _RIGHT_SHARE and np.median(before[fits]) <= _RIGHT_PX:
        return None
    best: tuple[Convention, Array] | None = None
    for convention in (c for c in CONVENTIONS if part in c.parts):
        after = errors_px(rows, part, convention, dataset, looked_at, file)
        if _explains(before, after) and (best is None or _rank(after) > _rank(best[1])):
            best = convention, after
    return None if best is None else (best[0], before, best[1])


def _sample(rows: pa.Table, targets: Targets) -> tuple[pa.Table, Targets]:
    """Detections and circles of the first frames that have both."""
    there = rows["frame_id"].to_numpy()
    frames, circles = np.unique(targets.frame_id[np.isin(targets.frame_id, there)], return_counts=True)
    detections = np.array([np.count_nonzero(there == frame) for frame in frames[:_FRAMES].tolist()], dtype=np.int64)
    count = int(np.searchsorted(np.cumsum(circles[:_FRAMES] * detections), _PAIRS)) + 1
    kept = frames[:_FRAMES][:count]
    looked_at = targets.take(np.flatnonzero(np.isin(targets.frame_id, kept)))
    # A frame before and one after, for frame numbers that are off by one.
    near = np.unique(np.concatenate([kept - 1, kept, kept + 1]))
    return rows.filter(pc.is_in(rows["frame_id"], value_set=pa.array(near, pa.int64()))), looked_at


def _explains(before: Array, after: Array) -> bool:
    """Whether estimates fit with a convention undone that did not fit as given."""
    fits, fitted = np.isfinite(after), np.isfinite(before)
    if fits.sum() < _LEAST or fits.sum() < fitted.sum():
        return False
    either = fits | fitted
    better = np.count_nonzero(after < before) >= _SHARE_BETTER * either.sum()
    if fits.sum() >= 2 * fitted.sum() + _LEAST:
        return bool(better)
    both = fits & fitted
    if both.sum() < _LEAST_MATCHED:
        return False
    return bool(better) and bool(np.median(after[both]) <= _MEDIAN_BELOW * np.median(before[both]))


def _rank(errors: Array) -> tuple[int, float]:
    """How well circles fit: the number that do, then their median error."""
    fits = np.isfinite(errors)
    return int(fits.sum()), -float(np.median(errors[fits]))


def _diagnosis(
    file: str, method: str, intrinsics: str, part: str, convention: Convention, before: Array, after: Array
) -> Diagnosis:
    def fit(errors: Array) -> tuple[int, float | None]:
        fits = np.isfinite(errors)
        return int(fits.sum()), float(np.median(errors[fits])) if fits.any() else None

    (count_before, median_before), (count_after, median_after) = fit(before), fit(after)
    return Diagnosis(
        file,
        method,
        intrinsics,
        part,
        convention.name,
        len(before),
        count_before,
        count_after,
        median_before,
        median_after,
        convention.text,
        convention.remedy,
    )
