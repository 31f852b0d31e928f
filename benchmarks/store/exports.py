"""Peak memory, and time a frame, of every export and of the card, over datasets of several sizes.

python benchmarks/store/exports.py DATASET [DATASET ...]

For example the datasets of images that size.py leaves in its folder. Exports are written beside each and removed.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from pathlib import Path

from size import run

from roundel.datasets.dataset import open_dataset
from roundel.datasets.export.export import FORMATS


def main() -> int:
    """Measure and print a table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("datasets", type=Path, nargs="+")
    asked = parser.parse_args()
    print("| frames | export | peak memory, MB | s | ms a frame |")
    print("|---:|---|---:|---:|---:|")
    for dataset in asked.datasets:
        frames = len(open_dataset(dataset))
        with tempfile.TemporaryDirectory(dir=dataset.parent) as folder:
            here = Path(folder)
            for name in [*FORMATS, "card"]:
                how = ["card"] if name == "card" else ["export", "--format", name, "--split", "80/10/10"]
                seconds, peak = run(here, [how[0], str(dataset), str(here / "out"), *how[1:]])
                shutil.rmtree(here / "out")
                print(
                    f"| {frames:,} | {name} | {peak:.0f} | {seconds:.1f} | {1000 * seconds / frames:.2f} |", flush=True
                )
    return 0


if __name__ == "__main__":
    sys.exit(main())
