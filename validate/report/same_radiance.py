"""Reports of datasets with the same radiance: rendered once, and developed (re-exposed) for several sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.datasets.layout.developed import Developed, developed_of
from roundel.scenes.display_text import NAME_LIMIT, clean
from roundel.validate.figures.side_by_side import Entry, Pair
from roundel.validate.metrics.rows import Rows, text_column, those

Labels = NDArray[np.int64]


@dataclass(frozen=True)
class Origin:
    """Where the radiance of a report's frames comes from, and how many times each rendered frame is there.

    Attributes
    ----------
    rendered_id : str
        The dataset whose rays were traced.
    developed : Developed or None
        None if that is the report's own dataset.
    keys, levels : dict
        The swept key of each group that has one, and its levels.
    frames : dict
        Number of frames of each group.
    """

    rendered_id: str
    developed: Developed | None
    keys: Mapping[str, str]
    levels: Mapping[str, Sequence[float | str]]
    frames: Mapping[str, int]

    def repeats(self) -> list[str]:
        """A name of each image of a rendered frame: the level at which it was developed, or nothing."""
        for name, group in (self.developed.groups if self.developed else {}).items():
            levels = self.levels.get(name, ())
            if levels and self.frames.get(name, 0) > group.source_frames:
                key = self.keys[name].removeprefix("sensor.")
                return [f"{key} {level if isinstance(level, str) else f'{level:g}'}" for level in levels]
        return [""]


def origin_of(dataset: Mapping[str, Any]) -> Origin:
    """The origin of a report's frames, from the `dataset` of its summary."""
    developed = developed_of(dataset)
    rendered = developed.rendered_id if developed else str(dataset["dataset_id"])
    swept = (dataset.get(name) or {} for name in ("sweeps", "sweep_levels", "groups"))
    return Origin(rendered, developed, *swept)


def rendered_frames(origin: Origin, rows: Rows) -> tuple[Labels, Labels]:
    """The rendered frame of each row of scores, and which of its images the row is about, from 0."""
    frames = np.asarray(rows["frame_id"].to_numpy(), dtype=np.int64)
    source, repeat = frames.copy(), np.zeros(len(frames), dtype=np.int64)
    groups = text_column(rows, "group")
    for name, group in (origin.developed.groups if origin.developed else {}).items():
        mine = groups == name
        repeat[mine], place = np.divmod(frames[mine] - group.first_frame, group.source_frames)
        source[mine] = group.source_first_frame + place
    return source, repeat


def sensor_pairs(first: tuple[str, Origin, Sequence[Entry]], second: tuple[str, Origin, Sequence[Entry]]) -> list[Pair]:
    """Pair the runs of two reports whose frames have the same radiance, each image of one with that of the other.

    Parameters
    ----------
    first, second : (label, origin, runs)
        Where only one of them was developed at several levels, all of these are paired with the other; of two sweeps
        the same levels are paired, or else the levels of the second with the first level of the first.
    """
    (label, origin, entries), (other_label, other_origin, others) = first, second
    names, other_names = origin.repeats(), other_origin.repeats()
    if len(other_names) == 1:
        wanted = [(k, 0) for k in range(len(names))]
    elif names == other_names:
        wanted = [(k, k) for k in range(len(names))]
    else:
        wanted = [(0, k) for k in range(len(other_names))]
    alone = all(len({entry.run["method"] for entry in runs}) == 1 for runs in (entries, others))
    found = []
    for entry in entries:
        for other in others:
            same = entry.run["method"] == other.run["method"]
            if (not same and not alone) or entry.run["intrinsics"] != other.run["intrinsics"]:
                continue
            about = f"{entry.run['method']}, " if same else ""
            for k, m in wanted:
                a, frames = _image(entry, label, origin, names, k, with_method=not same)
                b, other_frames = _image(other, other_label, other_origin, other_names, m, with_method=not same)
                found.append(Pair(a, b, clean(about + entry.run["intrinsics"], NAME_LIMIT), (frames, other_frames)))
    return found


def _image(
    entry: Entry, label: str, origin: Origin, names: Sequence[str], k: int, with_method: bool
) -> tuple[Entry, Labels]:
    """A run on one image of each rendered frame, and the rendered frame of each of its rows."""
    source, repeat = rendered_frames(origin, entry.rows)
    mine = repeat == k
    parts = [label, *([names[k]] if names[k] else []), *([entry.run["method"]] if with_method else [])]
    return Entry(clean(", ".join(parts), NAME_LIMIT), entry.kind, entry.run, those(entry.rows, mine)), source[mine]
