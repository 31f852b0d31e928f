"""Flags of frames that may mislead: saturated, occluded, outside the image.

`saturated`: the marker's sheet is overexposed; `dark`: there was no light, or too little for 1 DN; `occluded`: no part
of the marker is visible.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

FLAGS = ("saturated", "dark", "occluded")


def marker_flags(frame_flags: Iterable[str], visible_fraction: float) -> list[str]:
    """Flags of one marker of a frame, in the order of `FLAGS`."""
    own = {*frame_flags} - {"occluded"} | ({"occluded"} if visible_fraction == 0 else set())
    return [flag for flag in FLAGS if flag in own]


def frame_flags(developed: Iterable[str], visible_fractions: Iterable[float]) -> list[str]:
    """Flags of a frame: those of its image, and `occluded` if one of its markers is."""
    return marker_flags(developed, min(visible_fractions, default=1.0))


def count_flags(flagged: Iterable[tuple[int, Iterable[str]]]) -> dict[str, int]:
    """Number of frames with each flag, from pairs (frame_id, flags); frames may occur more than once."""
    frames: dict[str, set[int]] = {flag: set() for flag in FLAGS}
    for frame_id, flags in flagged:
        for flag in flags:
            frames[flag].add(frame_id)
    return {flag: len(ids) for flag, ids in frames.items()}


def warning_of(flagged: Iterable[tuple[int, Iterable[str]]], total: int) -> str | None:
    """One line that counts the flagged frames of a dataset and names the first; None if there is none."""
    pairs = [(frame_id, tuple(flags)) for frame_id, flags in flagged]
    marked = [frame_id for frame_id, flags in pairs if flags]
    if not marked:
        return None
    counts = ", ".join(f"{count} {flag}" for flag, count in count_flags(pairs).items() if count)
    first = min(marked)
    what = ", ".join(flag for flag in FLAGS if any(flag in flags for i, flags in pairs if i == first))
    return f"{len(set(marked))} of {total} frames show little or nothing ({counts}); the first is frame {first}, {what}"


def flags_of_rows(rows: Iterable[dict[str, Any]]) -> list[tuple[int, list[str]]]:
    """Pairs (frame_id, flags) of rows of the truth."""
    return [(int(row["frame_id"]), [f for f in str(row["flags"] or "").split(",") if f]) for row in rows]
