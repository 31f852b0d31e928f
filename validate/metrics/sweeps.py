"""Position of a frame in its group's sweep; equal positions are the same frame at different levels."""

from __future__ import annotations

from typing import Any

import pyarrow as pa

from roundel.datasets.dataset import Dataset
from roundel.scenes.errors import DataError
from roundel.scenes.study.sampling import frame_count
from roundel.scenes.study.schema import GroupSection

COLUMNS = ("sweep_level", "sweep_frame")


def sweep_keys(dataset: Dataset) -> dict[str, str]:
    """The swept key of each group that has a sweep, such as `sensor.read_noise_e`."""
    return {name: str(sweep["key"]) for name, sweep in _sweeps(dataset).items()}


def _sweeps(dataset: Dataset) -> dict[str, dict[str, Any]]:
    groups: dict[str, dict[str, Any]] = dataset.study.get("groups") or {}
    return {name: group["sweep"] for name, group in groups.items() if group.get("sweep")}


def _first_frames(dataset: Dataset) -> dict[str, tuple[int, int]]:
    """First frame and number of frames of each group, by the study; those there are, where it does not tell."""
    sections: dict[str, Any] = dataset.study.get("groups") or {}
    first, out = 0, {}
    # Keys of a manifest are sorted: their order is told apart.
    for name in dataset.manifest.get("groups") or ():
        try:
            count = frame_count(GroupSection.model_validate(sections[name]))
        except (ValueError, KeyError) as error:
            raise DataError(f"{dataset.address}: the study in its manifest is damaged: group {name!r:.80}") from error
        out[name] = first, count
        first += count
    if out:
        return out
    frames: dict[str, list[int]] = {}
    for frame_id, group in zip(dataset.images.frame_ids, dataset.images.groups, strict=True):
        frames.setdefault(group, []).append(frame_id)
    return {group: (min(ids), len(ids)) for group, ids in frames.items()}


def sweep_positions(dataset: Dataset) -> dict[int, tuple[float | None, int]]:
    """(level, position within the level) of each frame; the level is None without a sweep.

    A group's frames are consecutive, level by level (`scenes.frame`). Some may be missing.
    """
    sweeps, ranges = _sweeps(dataset), _first_frames(dataset)
    out: dict[int, tuple[float | None, int]] = {}
    for frame_id, group in zip(dataset.images.frame_ids, dataset.images.groups, strict=True):
        first, count = ranges[group]
        levels: list[float | None] = list(sweeps[group]["levels"]) if group in sweeps else [None]
        step, position = divmod(frame_id - first, count // len(levels))
        level = levels[step]
        out[frame_id] = None if level is None else float(level), position
    return out


def with_sweep(dataset: Dataset, truth: pa.Table) -> pa.Table:
    """Rows of the truth with two more columns: `sweep_level` (null without a sweep) and `sweep_frame`.

    Raises
    ------
    DataError
        If the truth has frames that the dataset does not have.
    """
    where = sweep_positions(dataset)
    frames = truth["frame_id"].to_pylist()
    unknown = set(frames) - set(where)
    if unknown:
        raise DataError(f"the dataset's truth has frame {min(unknown)}, which its cameras do not have; render it again")
    level = pa.array([where[f][0] for f in frames], type=pa.float64())
    position = pa.array([where[f][1] for f in frames], type=pa.int64())
    return truth.append_column(COLUMNS[0], level).append_column(COLUMNS[1], position)
