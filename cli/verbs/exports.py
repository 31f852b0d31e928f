"""The verbs that take a dataset to others: export, card."""

from __future__ import annotations

import argparse
from pathlib import Path

from roundel.cli.progress import progress
from roundel.cli.verbs.datasets import readable
from roundel.scenes.errors import UsageError


def do_export(arguments: argparse.Namespace) -> int:
    """Write a dataset in another format."""
    from roundel.datasets.dataset import open_dataset
    from roundel.datasets.export.export import FORMATS, export_dataset
    from roundel.datasets.stream.splits import Splits, parse_fractions

    dataset = open_dataset(readable(arguments.dataset))
    seed = dataset.study.get("seed", 0) if arguments.split_seed is None else arguments.split_seed
    splits = Splits(parse_fractions(arguments.split), arguments.split_by, seed)
    with progress("export") as show:
        counts = export_dataset(
            dataset,
            arguments.out,
            arguments.format,
            splits,
            arguments.groups,
            not arguments.no_depth,
            arguments.url,
            show,
        )
    numbers = ", ".join(f"{name} {count}" for name, count in counts.items())
    print(f"{arguments.out}: {arguments.format}, {sum(counts.values())} frames ({numbers})")
    print(f"not stored in {arguments.format}: {'; '.join(FORMATS[arguments.format].left_out)}")
    return 0


def do_card(arguments: argparse.Namespace) -> int:
    """Write a dataset's data card."""
    from roundel.datasets.card.card import PAGE, RECORD, card_json, card_of, card_page
    from roundel.datasets.dataset import open_dataset
    from roundel.datasets.layout.files import check_no_dataset
    from roundel.datasets.store.writing import write_file

    dataset = open_dataset(readable(arguments.dataset))
    out = Path(arguments.out)
    check_no_dataset(out)
    if out.exists() and not out.is_dir():
        raise UsageError(f"{out}: is a file; give a folder for the card")
    card = card_of(dataset)
    write_file(out / PAGE, card_page(card, dataset))
    write_file(out / RECORD, card_json(card))
    print(f"{out / PAGE}, {out / RECORD}: {len(dataset)} frames, dataset_id {card['dataset_id'][:12]}")
    return 0
