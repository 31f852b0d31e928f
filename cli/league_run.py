"""`roundel league run`: render the study, solve it with every entry that is installed, score, and write the page."""

from __future__ import annotations

import json
import sys
from functools import partial
from pathlib import Path
from typing import Any

from roundel.cli.progress import progress
from roundel.scenes.errors import UsageError

LABELS = ("true", "default")


def solve_entries(dataset: Path, out: Path, jobs: int) -> list[tuple[Any, str, Path]]:
    """Estimates of every installed entry with known and with default intrinsics, each in a folder of its own.

    Each is solved by itself, so that its time is its own. A folder that is complete is left as it is.

    Returns
    -------
    list of (Entry, str, Path)
        Entry, label of the intrinsics, and folder.
    """
    from roundel.datasets.layout.images import open_images
    from roundel.solver.ambiguity.parse_prior import parse_knowledge
    from roundel.solver.methods.registry import installed_methods
    from roundel.solver.methods.solve import solve_dataset
    from roundel.validate.league.entries import ENTRIES

    images = open_images(dataset)
    groups = list(dict.fromkeys(images.groups))
    there = {method.name for method in installed_methods()}
    made = []
    for entry in ENTRIES:
        mine = [group for group in groups if group.partition(".")[2] in entry.variants]
        if entry.method not in there or not mine:
            continue
        for label in LABELS:
            folder = out / f"{entry.name.replace(', ', '-')}-{label}"
            stamp = folder / "entry.json"
            told = json.dumps([images.dataset_id, entry.method, entry.knowledge, mine])
            if not (stamp.is_file() and stamp.read_text(encoding="utf-8") == told):
                with progress(f"{entry.name}, {label}") as show:
                    solve_dataset(
                        dataset,
                        folder,
                        [entry.method],
                        [label],
                        groups=mine,
                        knowledge=parse_knowledge(entry.knowledge),
                        progress=partial(show, step="solve"),
                        jobs=jobs,
                    )
                stamp.write_text(told, encoding="utf-8")
            made.append((entry, label, folder))
    if not made:
        raise UsageError(f"{dataset}: has no group named CONDITION.VARIANT that an entry of the league reads")
    return made


def left_out() -> list[str]:
    """Entries whose methods are not installed."""
    from roundel.solver.methods.registry import installed_methods
    from roundel.validate.league.entries import ENTRIES

    there = {method.name for method in installed_methods()}
    return sorted({entry.method for entry in ENTRIES} - there)


def tell(text: str) -> None:
    """A line of progress."""
    print(text, file=sys.stderr)
