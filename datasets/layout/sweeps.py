"""Position of a frame in its group's sweep; equal positions are the same frame at different levels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from roundel.datasets.layout.images import Images
from roundel.scenes.errors import DataError
from roundel.scenes.study.sampling import frame_count
from roundel.scenes.study.schema import GroupSection

Manifest = dict[str, Any]


def sweep_keys(manifest: Manifest) -> dict[str, str]:
    """The swept key of each group that has a sweep, such as `sensor.read_noise_e`."""
    return {name: str(sweep["key"]) for name, sweep in _sweeps(manifest).items()}


def sweep_levels(manifest: Manifest) -> dict[str, list[float | str]]:
    """The levels of each group that has a sweep."""
    return {name: list(sweep["levels"]) for name, sweep in _sweeps(manifest).items()}


def level_numbers(levels: Sequence[float | str]) -> list[float]:
    """The levels of a sweep as numbers: themselves, or their positions from 0 if they are words."""
    if any(isinstance(level, str) for level in levels):
        return [float(i) for i in range(len(levels))]
    return [float(level) for level in levels]


def _sweeps(manifest: Manifest) -> dict[str, dict[str, Any]]:
    groups: dict[str, dict[str, Any]] = manifest["study"].get("groups") or {}
    return {name: group["sweep"] for name, group in groups.items() if group.get("sweep")}


def _first_frames(images: Images, manifest: Manifest) -> dict[str, tuple[int, int]]:
    """First frame and number of frames of each group, by the study; those there are, where it does not tell."""
    sections: dict[str, Any] = manifest["study"].get("groups") or {}
    first, out = 0, {}
    # Keys of a manifest are sorted: their order is told apart.
    for name in manifest.get("groups") or ():
        try:
            count = frame_count(GroupSection.model_validate(sections[name]))
        except (ValueError, KeyError) as error:
            raise DataError(f"{images.address}: the study in its manifest is damaged: group {name!r:.80}") from error
        out[name] = first, count
        first += count
    if out:
        return out
    frames: dict[str, list[int]] = {}
    for frame_id, group in zip(images.frame_ids, images.groups, strict=True):
        frames.setdefault(group, []).append(frame_id)
    return {group: (min(ids), len(ids)) for group, ids in frames.items()}


def sweep_positions(images: Images, manifest: Manifest) -> dict[int, tuple[float | None, int]]:
    """(level, position within the level) of each frame; the level is a number, see `level_numbers`, or None
    without a sweep.

    A group's frames are consecutive, level by level (`scenes.frame`). Some may be missing.
    """
    sweeps, ranges = _sweeps(manifest), _first_frames(images, manifest)
    out: dict[int, tuple[float | None, int]] = {}
    for frame_id, group in zip(images.frame_ids, images.groups, strict=True):
        first, count = ranges[group]
        levels: list[float | None] = [*level_numbers(sweeps[group]["levels"])] if group in sweeps else [None]
        step, position = divmod(frame_id - first, count // len(levels))
        out[frame_id] = levels[step], position
    return out
