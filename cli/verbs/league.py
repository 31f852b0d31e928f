"""`roundel league`: run every entry over the study, score a submission, hold a part back."""

from __future__ import annotations

import argparse
import json
import sys
from functools import partial
from pathlib import Path
from typing import Any

from roundel.cli.progress import progress
from roundel.scenes.errors import UsageError

LABELS = ("true", "default")
STUDY = "league"


def run_league(arguments: argparse.Namespace) -> int:
    """Render the league, solve it with every entry that is installed, and write its page."""
    from roundel.validate.league.league import PAGE, Solved, outcomes_of_entries, write_league

    if arguments.truth and not arguments.dataset:
        raise UsageError("--truth belongs to published images: give them with --dataset")
    out = Path(arguments.out)
    dataset_path = Path(arguments.dataset) if arguments.dataset else _rendered(out / "dataset", arguments)
    solved, missing = _solved(dataset_path, out / "estimates", arguments)
    dataset = _opened(dataset_path, arguments.truth)
    outcomes = outcomes_of_entries(dataset, [Solved(entry, folder) for entry, folder in solved])
    record = write_league(dataset, outcomes, out / "league", missing)
    if missing:
        print(f"not installed: {', '.join(missing)}", file=sys.stderr)
    _print_standings(record)
    print(f"league: {out / 'league' / PAGE}")
    return 0


def score_submission(arguments: argparse.Namespace) -> int:
    """Score the estimates of an outside method against the league."""
    import pyarrow as pa

    from roundel.validate.league.league import PAGE, write_league
    from roundel.validate.league.submission import published, submitted_outcomes

    dataset = _opened(Path(arguments.dataset), arguments.truth)
    mine = submitted_outcomes(arguments.submission, dataset, arguments.name)
    outcomes = mine
    if arguments.against:
        theirs = published(arguments.against, dataset)
        taken = set(mine["entry"].to_pylist()) & set(theirs["entry"].to_pylist())
        if taken:
            raise UsageError(f"{sorted(taken)[0]!r} is an entry of the league already; give --name")
        outcomes = pa.concat_tables([mine, theirs])
    out = Path(arguments.out)
    record = write_league(dataset, outcomes, out)
    names = set(mine["entry"].to_pylist())
    _print_standings(record, names)
    print(f"league: {out / PAGE}")
    return 0


def hold_back(arguments: argparse.Namespace) -> int:
    """Split a dataset into images to publish and a truth to keep."""
    from roundel.validate.league import held_back

    both = held_back.hold_back(arguments.dataset, arguments.public, arguments.kept)
    print(f"{both.public}: images to publish, without truth, study and seed")
    print(f"{both.kept}: truth and salt; keep them until the league ends")
    return 0


def _opened(dataset: Path, truth: str | None) -> Any:
    from roundel.datasets.dataset import open_dataset
    from roundel.validate.league.held_back import open_held_back

    return open_dataset(dataset) if truth is None else open_held_back(dataset, truth)


def _rendered(dataset: Path, arguments: argparse.Namespace) -> Path:
    from roundel.cli.verbs.studies import find_study
    from roundel.render.run import render_study
    from roundel.scenes.study.study import load_study

    study = load_study(find_study(arguments.study))
    if not any("." in group for group in study.groups):
        raise UsageError(f"{study.path}: no group is named CONDITION.VARIANT; add `variants` with a marker each")
    with progress("render") as show:
        render_study(
            study,
            dataset,
            jobs=arguments.jobs,
            progress=show,
            check_progress=partial(show, step="check"),
        )
    return dataset


def _solved(dataset: Path, out: Path, arguments: argparse.Namespace) -> tuple[list[tuple[Any, Path]], list[str]]:
    """Estimates of every installed entry with known and with default intrinsics, each in a folder of its own.

    Each is solved by itself, so that its time is its own. A folder that is complete is left as it is. Also the methods
    that are not installed.
    """
    from importlib.metadata import version

    from roundel.datasets.layout.images import open_images
    from roundel.solver.ambiguity.parse_prior import parse_knowledge
    from roundel.solver.methods.registry import installed_methods
    from roundel.solver.methods.solve import solve_dataset
    from roundel.validate.league.entries import ENTRIES

    images = open_images(dataset)
    groups = list(dict.fromkeys(images.groups))
    there = {method.name: method.source for method in installed_methods()}
    made = []
    for entry in ENTRIES:
        mine = [group for group in groups if group.partition(".")[2] in entry.variants]
        if entry.method not in there or not mine:
            continue
        for label in LABELS:
            folder = out / f"{entry.name.replace(', ', '-')}-{label}"
            stamp = folder / "entry.json"
            about = [images.dataset_id, version("roundel"), entry.method, there[entry.method], entry.knowledge, mine]
            told = json.dumps(about)
            if not (stamp.is_file() and stamp.read_text(encoding="utf-8") == told):
                with progress(f"{entry.name}, {label}") as show:
                    solve_dataset(
                        dataset,
                        folder,
                        [entry.method],
                        [label],
                        groups=mine,
                        knowledge=parse_knowledge(entry.knowledge),
                        progress=show,
                    )
                stamp.write_text(told, encoding="utf-8")
            made.append((entry, folder))
    if not made:
        raise UsageError(f"{dataset}: has no group named CONDITION.VARIANT that an entry of the league reads")
    return made, sorted({entry.method for entry in ENTRIES} - set(there))


def _print_standings(record: dict[str, Any], only: set[str] | None = None) -> None:
    rows = [s for s in record["standings"] if s["condition"] == "all" and (only is None or s["entry"] in only)]
    print(
        f"{'marker':<14}{'entry':<18}{'intrinsics':<12}{'found %':>8}{'false':>7}{'normal deg':>12}{'position %':>12}"
    )
    for s in rows:
        errors = ("-" if s[n] is None else f"{s[n]:.3g}" for n in ("normal_error_deg", "position_error_pct"))
        normal, position = errors
        print(
            f"{s['variant']:<14}{s['entry']:<18}{s['intrinsics']:<12}{100 * s['found']:>8.1f}"
            f"{s['false_per_frame']:>7.2f}{normal:>12}{position:>12}"
        )
