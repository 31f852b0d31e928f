"""Damage the files of a dataset, its estimates, its report and a baseline, and run what reads them.

Each case changes one file: a byte flipped, cut or removed, a line torn, a value of JSON exchanged for one of another
type, a link, a pipe or a folder in its place. Requirement: success, or a one-line error of Roundel that is no
`internal error`, within ten seconds and without two more gigabytes of memory. Where the bytes that a command reads have
changed, it must not succeed, unless what it read is the same.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import random
import resource
import shutil
import signal
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from roundel.cli.main import main as roundel
from roundel.datasets.store.records import document_of, line_of

_SLOW_S = 10.0
_MORE_MB = 2000.0

STUDY = """
schema: 1
name: fuzzed
seed: 5
camera: {width_px: 64, height_px: 48, focal_px: 128}
marker: {kind: disc, diameter_m: 0.08}
pose: {distance_D: {uniform: [7, 9]}, tilt_deg: {uniform: [10, 50]}}
light: {environment: 0.7}
render: {band_samples: 16}
groups: {seen: {frames: 3, sensor: {curve: gamma, gamma: 2.0}}, drawn: {mode: points, frames: 30}}
"""

# A number of another size or sign, and values of other types.
_ODD: tuple[Any, ...] = (
    None, True, -1, 0, 1e308, 10**30, 0.5, "", "x", "../../etc/passwd", "/dev/zero", [], [[]], {}, {"a": 1}, "\ud800",
)  # fmt: skip


def made(folder: Path) -> Path:
    """A dataset, an unfinished one, estimates, a report and a baseline."""
    (folder / "study.yaml").write_text(STUDY)
    (folder / "sensor.yaml").write_text("sensor: {full_well_e: 4000}\n")
    for words in (
        ["render", "study.yaml", "dataset"],
        ["render", "study.yaml", "part", "--frames", "0:2"],
        ["solve", "dataset", "estimates"],
        ["validate", "dataset", "estimates", "--out", "report"],
        ["baseline", "accept", "report", "--baseline", "baseline.parquet", "--reason", "made"],
    ):
        code, said = called(folder, words)
        assert code == 0, said
    return folder


def called(folder: Path, words: list[str]) -> tuple[int, str]:
    """Exit status and standard error of a command, run in `folder`."""
    out, err, before = io.StringIO(), io.StringIO(), os.getcwd()
    os.chdir(folder)
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            signal.alarm(int(2 * _SLOW_S))
            try:
                return roundel(words), err.getvalue()
            except SystemExit as stop:
                return int(stop.code or 0), err.getvalue()
            except _HangError:
                return -1, f"{err.getvalue()}: hangs"
    finally:
        signal.alarm(0)
        os.chdir(before)


# Commands that read a file, by the beginning of its name.
READERS: dict[str, list[list[str]]] = {
    "dataset/": [
        ["verify", "dataset", "--full"],
        ["solve", "dataset", "out"],
        ["validate", "dataset", "estimates", "--out", "out"],
        ["develop", "dataset", "out", "--sensor", "sensor.yaml"],
        ["render", "study.yaml", "dataset"],
        ["merge", "dataset", "out"],
    ],
    "part/": [["render", "study.yaml", "part", "--frames", "0:3"], ["solve", "part", "out"], ["merge", "part", "out"]],
    "estimates/": [["validate", "dataset", "estimates", "--out", "out"]],
    "report/": [
        ["gate", "report", "--baseline", "baseline.parquet"],
        ["baseline", "accept", "report", "--baseline", "out.parquet", "--reason", "x"],
        ["compare", "report", "report2", "--out", "out"],
    ],
    "baseline.parquet": [["gate", "report", "--baseline", "baseline.parquet"]],
    "study.yaml": [["check", "study.yaml"], ["render", "study.yaml", "dataset"]],
    "sensor.yaml": [["develop", "dataset", "out", "--sensor", "sensor.yaml"]],
}


def paths(value: Any, at: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Places of all values in a JSON value."""
    found = [at]
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        found += paths(inner, (*at, key))
    return found


def exchanged(value: Any, chance: random.Random) -> Any:
    """A JSON value with one value in it replaced, removed or renamed."""
    value = json.loads(json.dumps(value))
    *way, last = chance.choice([path for path in paths(value) if path] or [("x",)])
    node = value
    for key in way:
        node = node[key]
    kind = chance.randrange(4)
    if kind == 0 and isinstance(node, dict):
        node.pop(last, None)
    elif kind == 1 and isinstance(node, dict):
        node[f"{last}x"] = node.pop(last, None)
    else:
        node[last] = chance.choice(_ODD)
    return value


def mutated(data: bytes, name: str, chance: random.Random, foreign: bool) -> bytes:
    """The bytes of a file with one defect; `foreign`: of a dataset, which may come from anywhere."""
    if name.endswith((".json", ".jsonl")) and chance.random() < 0.6:
        with contextlib.suppress(ValueError, UnicodeError):
            return _mutated_json(data, name, chance, foreign)
    at = chance.randrange(max(len(data), 1))
    kind = chance.randrange(6)
    if kind == 0:
        return data[:at]
    if kind == 1:
        return data[:at] + data[at + 1 + chance.randrange(20) :]
    if kind == 2:
        return data[:at] + chance.randbytes(1 + chance.randrange(40)) + data[at:]
    if kind == 3:
        return b"" if chance.random() < 0.2 else data + chance.randbytes(3)
    return data[:at] + bytes([data[at] ^ (1 << chance.randrange(8))]) + data[at + 1 :] if data else b"\0"


def _mutated_json(data: bytes, name: str, chance: random.Random, foreign: bool) -> bytes:
    """A value exchanged; half of the time with the checksum made right again, as somebody might on purpose."""
    right = foreign and chance.random() < 0.5
    if name.endswith(".jsonl"):
        lines = data.decode().splitlines()
        at = chance.randrange(len(lines))
        record = exchanged(json.loads(lines[at]), chance)
        lines[at] = line_of(record) if right and isinstance(record, dict) else json.dumps(record)
        return ("\n".join(lines) + "\n").encode()
    record = exchanged(json.loads(data), chance)
    return document_of(record) if right and isinstance(record, dict) else json.dumps(record, indent=1).encode()


def damage(file: Path, chance: random.Random, foreign: bool) -> str:
    """Damage a file on disk; says how."""
    kind = chance.randrange(14)
    whole = file.read_bytes()
    if kind == 0:
        file.unlink()
        return "removed"
    if kind == 1:
        file.unlink()
        file.symlink_to(chance.choice(["/etc/passwd", "/dev/zero", "nowhere", file.name, "../study.yaml"]))
        return "a link"
    if kind == 2 and file.name not in ("study.yaml", "sensor.yaml"):  # which one may give as a pipe
        file.unlink()
        os.mkfifo(file)
        return "a pipe"
    if kind == 3:
        file.unlink()
        file.mkdir()
        return "a folder"
    changed = mutated(whole, file.name, chance, foreign)
    file.write_bytes(changed)
    return "unchanged" if changed == whole else "altered"


def relist(root: Path, name: str) -> None:
    """Make the manifest's checksum of a file right, as somebody might who damages a dataset on purpose."""
    import hashlib

    folder, _, inner = name.partition("/")
    manifest = root / folder / "manifest.json"
    file = root / name
    with contextlib.suppress(OSError, ValueError, KeyError):
        record = json.loads(manifest.read_bytes())
        data = file.read_bytes()
        if inner in record["files"]:
            record["files"][inner] = {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
            manifest.write_bytes(document_of(record))


def _hangs(number: int, frame: object) -> None:
    raise _HangError


class _HangError(BaseException):
    """Raised in a command that takes too long; nothing in it catches it."""


def peak_mb() -> float:
    """Peak memory of this process."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def case(source: Path, names: list[str], seed: int) -> str | None:
    """One damaged file and one command; what is wrong, or None."""
    chance = random.Random(seed)
    with tempfile.TemporaryDirectory() as work:
        root = Path(work) / "w"
        shutil.copytree(source, root)
        shutil.copytree(root / "report", root / "report2")
        name = chance.choice(names)
        how = damage(root / name, chance, name.startswith(("dataset/", "part/")))
        if how == "altered" and chance.random() < 0.4:
            relist(root, name)
            how = "altered, and its checksum too"
        words = chance.choice(next(commands for start, commands in READERS.items() if name.startswith(start)))
        outside = (root / "study.yaml").read_bytes() if name != "study.yaml" else b""
        began, memory = time.monotonic(), peak_mb()
        code, said = called(root, words)
        took = time.monotonic() - began
        told = f"seed {seed}: {name} {how}; roundel {' '.join(words)}: exit {code}: {said[-400:]}"
        errors = [line for line in said.splitlines() if line.startswith("roundel: ") and "warning:" not in line]
        if "internal error" in said or "Traceback" in said or code not in (0, 1, 2, 3, 4):
            return told
        if (code >= 2) != (len(errors) == 1) and not (code == 2 and "usage:" in said):
            return f"{told} ({len(errors)} lines of error)"
        if took > _SLOW_S or peak_mb() - memory > _MORE_MB:
            return f"{told} ({took:.0f} s, {peak_mb() - memory:.0f} MB more)"
        if outside and (root / "study.yaml").read_bytes() != outside:
            return f"{told} (a file outside was changed)"
    return None


def fuzz(run: Callable[[int], str | None], first: int, count: int, seconds: float, most: int) -> tuple[int, int]:
    """Run cases until their number, the time or the most failures are reached; returns how many ran, and failed."""
    until, failures = time.monotonic() + seconds, 0
    for done, seed in enumerate(range(first, first + count), start=1):
        wrong = run(seed)
        if wrong:
            print(f"store: {wrong}", flush=True)
            failures += 1
        if failures >= most or time.monotonic() > until:
            return done, failures
    return count, failures


def main() -> int:
    parser = argparse.ArgumentParser(description="Fuzz what reads datasets, estimates, reports and baselines.")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--cases", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--failures", type=int, default=1, help="stop after this many")
    asked = parser.parse_args()
    warnings.simplefilter("error")
    signal.signal(signal.SIGALRM, _hangs)
    with tempfile.TemporaryDirectory() as folder:
        source = made(Path(folder))
        kept = ("figures", "tables", "report.html", "timings")
        every = [str(p.relative_to(source)) for p in sorted(source.rglob("*")) if p.is_file()]
        names = [name for name in every if not any(word in name for word in kept)]
        run = partial(case, source, names)
        ran, failures = fuzz(run, asked.seed, asked.cases, asked.seconds, asked.failures)
    print(f"store: {ran} cases, {failures or 'no'} failure{'s' if failures > 1 else ''}")
    return int(failures > 0)


if __name__ == "__main__":
    sys.exit(main())
