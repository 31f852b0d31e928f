"""Error rates of the gate on the shipped benchmark: false alarms, a loss of 5 %, planted bugs, no samples.

    python benchmarks/gate/gate.py [--folder out/gate] [--copies 12] [--worse 10] [--out FILE]

Renders configs/benchmark.yaml unless FOLDER/dataset exists, and solves copies of it with fresh sensor noise, one after
another (one core; a copy has 3,000 frames). You can stop it at any time; it resumes where it stopped.

- False alarms: copies against copies, all with the study's sensor.
- A loss: the read noise is raised until the RMS error of the pose has risen by 5 %, and such copies are compared with
  the others. The level comes from one copy with the same random numbers at two levels; the rise is then measured on all
  copies.
- Every pair of whole copies is compared. Pairs share copies and are not independent; therefore there are also disjoint
  pairs, and mixed comparisons, which draw for each frame which two copies are compared.
"""

from __future__ import annotations

import argparse
import math
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from itertools import chain, combinations
from pathlib import Path

import numpy as np
import pyarrow as pa
from gate_bugs import verdicts, zero_samples
from gate_copies import Source, copies, open_source
from gate_tables import HEAD, row

from roundel.validate.gate.baseline import Baseline
from roundel.validate.gate.quantities import QUANTITIES, floats

STUDY = Path(__file__).parents[2] / "configs" / "benchmark.yaml"
RISE = 1.05
FIRST_WORSE = 1000  # indices of the noisier copies, so that no two copies share their noise
PILOT_READ_E = 21.8  # the value for shot noise and quantisation alone


def rms(copy: Baseline, column: str, bound: str | None) -> float:
    """RMS of an error relative to its bounds, for one copy."""
    values = floats(copy.rows, column) / (floats(copy.rows, bound) if bound else 1.0)
    return float(np.sqrt(np.nanmean(values**2)))


def read_noise_of_the_loss(source: Source, folder: Path, plain: Baseline) -> float:
    """Read noise, electrons, that raises the RMS error of the pose by 5 %; squared error is linear in squared noise."""
    (pilot,) = copies(source, folder, [0], PILOT_READ_E)
    ratio = (rms(pilot, QUANTITIES[0].column, None) / rms(plain, QUANTITIES[0].column, None)) ** 2
    own = source.frames[0].settings.sensor.read_noise_e
    slope = (ratio - 1.0) / (PILOT_READ_E**2 - own**2)
    return round(math.sqrt(own**2 + (RISE**2 - 1.0) / slope), 2)


def mixed(new: list[Baseline], old: list[Baseline], count: int) -> Iterator[tuple[Baseline, Baseline]]:
    """Pairs whose frames come from random copies, always two different ones if both sides draw from the same copies."""
    generator = np.random.default_rng(0)
    n = old[0].rows.num_rows
    tables = [pa.concat_tables([copy.rows for copy in side]).combine_chunks() for side in (new, old)]
    for _ in range(count):
        a = generator.integers(len(new), size=n)
        if new is old:
            b = (a + generator.integers(1, len(old), size=n)) % len(old)
        else:
            b = generator.integers(len(old), size=n)
        rows = [table.take(pa.array(side * n + np.arange(n))) for table, side in zip(tables, (a, b), strict=True)]
        yield replace(new[0], rows=rows[0], images="new"), replace(old[0], rows=rows[1], images="old")


def statistics(source: Source, options: argparse.Namespace) -> Iterator[str]:
    """Tables of false alarms and of the loss, line by line."""
    folder = Path(options.folder) / "copies"
    plain = copies(source, folder, range(options.copies))
    noise = read_noise_of_the_loss(source, folder, plain[0])
    worse = copies(source, folder, range(FIRST_WORSE, FIRST_WORSE + options.worse), noise)
    yield from [f"## False alarms: {len(plain)} copies of {plain[0].rows.num_rows} frames, fresh noise", "", *HEAD]
    yield row("mixed", mixed(plain, plain, options.comparisons))
    yield row("every pair of copies", combinations(plain, 2))
    yield row("disjoint pairs", zip(plain[::2], plain[1::2], strict=False))
    own = source.frames[0].settings.sensor.read_noise_e
    yield from ["", f"## A loss of 5 %: read noise {own:g} -> {noise:g} electrons, {len(worse)} copies", ""]
    yield from ["| error over its bounds | RMS before | after | rise |", "|---|---|---|---|"]
    for q in QUANTITIES:
        was, now = ([rms(copy, q.column, q.bound) for copy in side] for side in (plain, worse))
        ratio = float(np.mean(now) / np.mean(was))
        spread = ratio * math.sqrt(sum((np.std(v, ddof=1) / np.mean(v)) ** 2 / len(v) for v in (was, now)))
        rise = f"{100 * (ratio - 1):+.2f} +- {100 * spread:.2f} %"
        yield f"| {q.title} | {np.mean(was):.3f} | {np.mean(now):.3f} | {rise} |"
    yield from ["", *HEAD]
    yield row("mixed", mixed(worse, plain, options.comparisons))
    yield row("every noisier copy against every other", ((new, old) for new in worse for old in plain))
    yield row("disjoint pairs", zip(worse, plain, strict=False))


def bugs(source: Source, options: argparse.Namespace) -> Iterator[str]:
    """Tables of planted bugs and of reports without samples."""
    (fresh,) = copies(source, Path(options.folder) / "copies", [0])
    folder = Path(options.folder) / "bugs"
    yield from ["## Planted bugs: exit status of `roundel gate`, and the checks that failed", ""]
    yield from ["| bug | same images | | fresh noise | |", "|---|---|---|---|---|"]
    for name, code, checks, other_code, other in verdicts(source.path, folder, fresh):
        yield f"| {name} | {code} | {checks} | {other_code} | {other} |"
    yield from ["", "## No samples", "", "| case | exit status | message |", "|---|---|---|"]
    for case, code, line in zero_samples(source.path, folder):
        yield f"| {case} | {code} | {line.replace(str(folder), '...')} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", default="out/gate", help="folder for dataset, copies and reports")
    parser.add_argument("--copies", type=int, default=12, help="number of copies with the study's sensor")
    parser.add_argument("--worse", type=int, default=10, help="number of copies with the noise of a 5 %% loss")
    parser.add_argument("--comparisons", type=int, default=1000, help="number of mixed comparisons of each kind")
    parser.add_argument("--only", choices=("statistics", "bugs"), help="run only this half")
    parser.add_argument("--out", help="also write the tables to this file")
    options = parser.parse_args()
    import cv2

    cv2.setNumThreads(1)
    dataset = Path(options.folder) / "dataset"
    if not (dataset / "manifest.json").is_file():
        command = [Path(sys.executable).with_name("roundel"), "render", STUDY, dataset]
        subprocess.run(list(map(str, command)), check=True)
    source = open_source(dataset)
    lines: list[str] = []
    for part in (statistics, bugs):
        if options.only in (None, part.__name__):
            for line in chain(part(source, options), [""]):
                print(line, flush=True)
                lines.append(line)
    if options.out:
        Path(options.out).write_text("# The gate, measured\n\n" + "\n".join(lines).rstrip() + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
