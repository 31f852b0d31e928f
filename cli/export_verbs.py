"""The verbs that take a dataset to other formats: export."""

from __future__ import annotations

import argparse

from roundel.cli.dataset_verbs import readable
from roundel.cli.progress import progress


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
    said = ", ".join(f"{name} {count}" for name, count in counts.items())
    print(f"{arguments.out}: {arguments.format}, {sum(counts.values())} frames ({said})")
    print(f"not held by {arguments.format}: {'; '.join(FORMATS[arguments.format].left_out)}")
    return 0
