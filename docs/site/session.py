"""Runs the blocks of a page in one folder, and keeps their results until the commands or Roundel change."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

from transcript import shown

_HOUSE = Path(__file__).resolve().parents[2]
_PACKAGES = ("roundel", "configs", "scenes", "render", "datasets", "solver", "validate", "cli")
_TIMEOUT_S = 600
# Set by CI or by make, and seen by commands: a reader's shell has none of them.
_NOT_PASSED_ON = ("GITHUB_STEP_SUMMARY", "MAKEFLAGS", "MAKELEVEL", "ROUNDEL_DEBUG")


@cache
def code_digest() -> str:
    """One checksum over the files of Roundel, whatever its version says."""
    digest = hashlib.sha256()
    for package in _PACKAGES:
        for path in sorted((_HOUSE / package).rglob("*")):
            if path.is_file() and path.suffix != ".pyc":
                digest.update(str(path.relative_to(_HOUSE)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


@dataclass(frozen=True)
class Ran:
    """A block that has been run. `key` covers its commands, all blocks before it, and Roundel's code."""

    key: str
    commands: str
    status: int
    output: str


class Session:
    """The blocks of one page, in order; those that ran before, unchanged, are not run again."""

    def __init__(self, page: str, room: Path) -> None:
        self.page, self.folder, self._record = page, room / page, room / f"{page}.json"
        self._count = 0  # blocks of this build
        self._ran = self._recorded()
        self._broken = False

    def _recorded(self) -> list[Ran]:
        if not (self.folder.is_dir() and self._record.is_file()):
            return []
        return [Ran(**entry) for entry in json.loads(self._record.read_text(encoding="utf-8"))]

    def run(self, commands: str, wanted: int) -> Ran | None:
        """The result of the page's next block; None after a block that has failed.

        A result with another status than `wanted` is not kept.
        """
        if self._broken:
            return None
        before = self._ran[: self._count]
        key = hashlib.sha256((before[-1].key if before else code_digest()).encode() + commands.encode()).hexdigest()
        if self._count < len(self._ran) and self._ran[self._count].key == key:
            self._count += 1
            return self._ran[self._count - 1]
        if not before or len(self._ran) > self._count:
            # The folder is not as the blocks before this one leave it.
            shutil.rmtree(self.folder, ignore_errors=True)
            self.folder.mkdir(parents=True)
            for block in before:
                self._executed(block.commands, block.key)
        result = self._executed(commands, key)
        self._ran = [*before, result]
        self._count += 1
        if result.status == wanted:
            self._record.write_text(json.dumps([asdict(one) for one in self._ran], indent=1), encoding="utf-8")
        else:
            self._broken = True
            self._record.unlink(missing_ok=True)
        return result

    def _executed(self, commands: str, key: str) -> Ran:
        environment = {k: v for k, v in os.environ.items() if k not in _NOT_PASSED_ON}
        environment["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        started = time.monotonic()
        done = subprocess.run(
            ["bash", "-e", "-c", commands],
            cwd=self.folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=_TIMEOUT_S,
            check=False,
        )
        last = next(line for line in reversed(commands.splitlines()) if line.strip())
        sys.stderr.write(f"{self.page}: {time.monotonic() - started:3.0f} s: {last[:90]}\n")
        return Ran(key, commands, done.returncode, shown(done.stdout.decode(errors="replace")))
