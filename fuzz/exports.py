"""Fuzz what reads exports back: python fuzz/exports.py [--seconds 60] [--seed 0].

Every format of a small dataset is damaged in one file and held against the dataset: a difference, or one line of error.
"""

from __future__ import annotations

import argparse
import random
import re
import shutil
import sys
import tempfile
import time
import warnings
from pathlib import Path

from roundel.datasets.dataset import Dataset
from roundel.datasets.export.check import check_against, check_files, read_export
from roundel.datasets.export.export import FORMATS, export_dataset
from roundel.datasets.stream.splits import Splits
from roundel.render.run import render_study
from roundel.scenes.errors import RoundelError
from roundel.scenes.study.study import load_study

STUDY = """\
schema: 1
name: fuzzed
seed: 3
frames: 4
camera: {width_px: 96, height_px: 72, focal_px: 96}
marker: {kind: disc, diameter_m: 0.08}
pose: {distance_m: 0.4, tilt_deg: {uniform: [10, 40]}, azimuth_deg: {uniform: [-180, 180]}}
light: {environment: 0.7}
"""
WORDS = (b"nan", b"null", b"[]", b"{}", b"-1", b"1e400", b'"x"', b"99999999999999")
NUMBERS = (b"0", b"-7", b"1e308", b"NaN", b"null", b"12345678901234567890", b'"a"')


def damage(file: Path, chance: random.Random) -> str:
    """Damage a file; says how."""
    data, how = bytearray(file.read_bytes()), chance.choice(("flipped", "cut", "text", "number", "removed"))
    if how == "removed":
        file.unlink()
        return how
    if how == "flipped" and data:
        for _ in range(chance.randint(1, 4)):
            data[chance.randrange(len(data))] = chance.randrange(256)
    elif how == "cut":
        del data[chance.randrange(len(data) + 1) :]
    elif how == "text" and data:
        at = chance.randrange(len(data))
        data[at : at + chance.randint(0, 9)] = chance.choice(WORDS)
    elif how == "number" and (found := list(re.finditer(rb"\d+(\.\d+)?", bytes(data)))):
        one = chance.choice(found)
        data[one.start() : one.end()] = chance.choice(NUMBERS)
    file.write_bytes(data)
    return how


def case(exports: Path, dataset: Dataset, seed: int) -> str | None:
    """One damaged file; what is wrong, or None."""
    chance = random.Random(seed)
    name = chance.choice(list(FORMATS))
    with tempfile.TemporaryDirectory() as work:
        folder = Path(work) / "export"
        shutil.copytree(exports / name, folder)
        files = [p for p in sorted(folder.rglob("*")) if p.is_file() and not p.name.startswith("card.")]
        file = chance.choice(files)
        how = damage(file, chance)
        began = time.monotonic()
        try:
            record = read_export(folder)
            check_files(folder, record)
            check_against(folder, record, dataset)
        except RoundelError as error:
            if "\n" in str(error):
                return f"seed {seed}: {name}/{file.relative_to(folder)} {how}: several lines: {error}"
        except Exception as error:
            return f"seed {seed}: {name}/{file.relative_to(folder)} {how}: {type(error).__name__}: {error}"
        took = time.monotonic() - began
        return f"seed {seed}: {name} {how}: {took:.0f} s" if took > 10 else None


def main() -> int:
    """Fuzz until the time is over."""
    parser = argparse.ArgumentParser(description="Fuzz what reads exports back.")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        here = Path(folder)
        (here / "study.yaml").write_text(STUDY)
        dataset = render_study(load_study(here / "study.yaml"), here / "ds")
        assert dataset is not None
        for name in FORMATS:
            export_dataset(dataset, here / "exports" / name, name, Splits((0.5, 0.25, 0.25), seed=1))
        warnings.simplefilter("error")
        until, seed, failures = time.monotonic() + asked.seconds, asked.seed, 0
        while time.monotonic() < until and not failures:
            wrong = case(here / "exports", dataset, seed)
            if wrong:
                print(f"exports: {wrong}", flush=True)
                failures += 1
            seed += 1
    print(f"exports: {seed - asked.seed} cases, {failures or 'no'} failure")
    return int(failures > 0)


if __name__ == "__main__":
    sys.exit(main())
