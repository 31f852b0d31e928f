"""Position of a frame in its group's sweep; equal positions are the same frame at different levels."""

from __future__ import annotations

from typing import Any

import pyarrow as pa

from roundel.datasets.dataset import Dataset
from roundel.scenes.errors import DataError

COLUMNS = ("sweep_level", "sweep_frame")


def sweep_keys(dataset: Dataset) -> dict[str, str]:
    """The swept key of each group that has a sweep, such as `sensor.read_noise_e`."""
    return {name: str(sweep["key"]) for name, sweep in _sweeps(dataset).items()}


def _sweeps(dataset: Dataset) -> dict[str, dict[str, Any]]:
    groups: dict[str, dict[str, Any]] = dataset.study.get("groups") or {}
    return {name: group["sweep"] for name, group in groups.items() if group.get("sweep")}


def sweep_positions(dataset: Dataset) -> dict[int, tuple[float | None, int]]:
    """(level, position within the level) of each frame; the level is None without a sweep.

    A group's frames are consecutive, level by level (`scenes.frame`), and a finished dataset has all of them.

    Raises
    ------
    DataError
        If the number of a group's frames is not a multiple of its levels.
    """
    frames: dict[str, list[int]] = {}
    for frame_id, group in zip(dataset.images.frame_ids, dataset.images.groups, strict=True):
        frames.setdefault(group, []).append(frame_id)
    sweeps = _sweeps(dataset)
    out: dict[int, tuple[float | None, int]] = {}
    for group, ids in frames.items():
        levels: list[float | None] = list(sweeps[group]["levels"]) if group in sweeps else [None]
        if len(ids) % len(levels):
            raise DataError(
                f"group {group} has {len(ids)} frames, not a multiple of the {len(levels)} levels of its sweep; "
                "render the dataset again"
            )
        count = len(ids) // len(levels)
        for position, frame_id in enumerate(sorted(ids)):
            level = levels[position // count]
            out[frame_id] = None if level is None else float(level), position % count
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
