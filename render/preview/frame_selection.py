"""Which frames a preview renders: spread over the groups, within a cost.

The choice is a function of the study alone: the same study has the same preview on every machine.
"""

from __future__ import annotations

from collections.abc import Iterator

from roundel.scenes.study.schema import GroupSection
from roundel.scenes.study.study import Study
from roundel.scenes.world.frame import group_ranges

# Frames that are rendered, and those that are placed to see the ranges of sizes and distances.
MOST_FRAMES, MOST_PLACED = 12, 24
# A frame in a world costs about so many on a plain wall: its meshes, textures and paths. The first frames of groups may
# cost `_MOST_OF_FIRST` together.
_COST_OF_A_WORLD, _MOST_COST, _MOST_OF_FIRST = 5, 20, 30


def spread_ids(ids: range, count: int) -> list[int]:
    """At most `count` frame ids, evenly over a range, the first and the last among them.

    Examples
    --------
    >>> spread_ids(range(10, 20), 4)
    [10, 13, 16, 19]
    """
    count = min(count, len(ids))
    return [ids[round(i * (len(ids) - 1) / max(1, count - 1))] for i in range(count)]


def chosen_ids(study: Study) -> dict[str, list[int]]:
    """Frame ids to render, by group: one of each group in turn, until their number or their cost is reached.

    Groups come in the order of the study; of more groups than frames the first have one each. The first frame of a
    group may cost more than further ones: a group without a picture tells little.
    """
    counts = dict.fromkeys(study.groups, 0)
    ranges, cost = group_ranges(study), 0
    for name in _in_turn(ranges):
        cost += _cost(study.groups[name])
        most = _MOST_COST if counts[name] else _MOST_OF_FIRST
        if cost > most or sum(counts.values()) == MOST_FRAMES:
            break
        counts[name] += 1
    return {name: spread_ids(ranges[name], count) for name, count in counts.items() if count}


def placed_ids(study: Study) -> dict[str, list[int]]:
    """Frame ids whose markers are placed, by group: at least two of each group."""
    ranges = group_ranges(study)
    each = max(2, MOST_PLACED // len(ranges))
    return {name: spread_ids(ids, each) for name, ids in ranges.items()}


def _in_turn(ranges: dict[str, range]) -> Iterator[str]:
    for turn in range(MOST_FRAMES):
        yield from (name for name, ids in ranges.items() if len(ids) > turn)


def _cost(group: GroupSection) -> int:
    return _COST_OF_A_WORLD if group.mode == "images" and group.world.kind != "plain" else 1
