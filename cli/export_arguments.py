"""Arguments of `export` and `card`."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from roundel.cli.arguments import on_disk

_DATASET = "dataset: its folder, or an address such as s3://bucket/name"


def add_export(add: Callable[[str, str], argparse.ArgumentParser]) -> None:
    """Add the verbs to the parser."""
    export = add("export", "write a dataset in another format: BOP, COCO, YOLO, Hugging Face and others")
    export.add_argument("dataset", metavar="DATASET", help=_DATASET)
    export.add_argument("out", type=on_disk, metavar="OUT", help="a new folder")
    export.add_argument(
        "--format",
        required=True,
        metavar="NAME",
        help="bop, coco, yolo, webdataset, huggingface, croissant, colmap, kalibr, ros, tum or kitti",
    )
    export.add_argument(
        "--split", default="100/0/0", metavar="T/V/T", help="percentages of train/val/test (default 100/0/0)"
    )
    export.add_argument(
        "--split-by",
        choices=("pose", "group", "world", "camera"),
        default="pose",
        metavar="WHAT",
        help="what the splits must not share: pose (default), group, world or camera",
    )
    export.add_argument("--split-seed", type=int, metavar="N", help="seed of the split (default: the study's)")
    export.add_argument("--groups", nargs="+", metavar="GROUP", help="only frames of these groups")
    export.add_argument("--no-depth", action="store_true", help="leave depth out")
    export.add_argument(
        "--url",
        default="",
        metavar="URL",
        help="address at which the dataset is published, for formats that contain it",
    )

    card = add("card", "write a dataset's data card: a page, and a record for programs")
    card.add_argument("dataset", metavar="DATASET", help=_DATASET)
    card.add_argument("out", type=on_disk, metavar="OUT", help="folder to write to")
