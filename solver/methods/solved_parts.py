"""Results of blocks of frames as they come: parts on disk, joined into the final files at the end.

A killed run leaves its parts, and the same command solves only the frames that have none. Memory holds one block, and
while the parts are joined one row group.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from roundel.datasets.store.writing import new_file, temporary_name, write_failure, write_file
from roundel.scenes.errors import DataError
from roundel.solver.estimates import CHECKSUM, ESTIMATES, Estimate, estimates_schema, estimates_table

PARTS = ".estimates.parts"
TIMINGS = "timings.jsonl"
_ABOUT = b"roundel_part"
_ROWS = 8_192  # of a row group: few more than the frames of a shard have, which are read together


@dataclass
class Tally:
    """What is known of solved frames beside their estimates.

    Attributes
    ----------
    counts : dict
        Numbers of frames, detections, frames without detections, and failed estimates.
    failures : dict
        Third-party methods that failed: number of frames, first frame_id, first reason.
    timings : list of str
        A line of `timings.jsonl` for each frame.
    """

    counts: dict[str, int] = field(
        default_factory=lambda: dict.fromkeys(("frames", "detections", "empty_frames", "failed_estimates"), 0)
    )
    failures: dict[str, tuple[int, int, str]] = field(default_factory=dict)
    timings: list[str] = field(default_factory=list)

    def add(self, other: Tally) -> None:
        """Add that of later frames, without its timings."""
        for name, number in other.counts.items():
            self.counts[name] += number
        for method, (frames, first, reason) in other.failures.items():
            before = self.failures.get(method, (0, first, reason))
            self.failures[method] = (before[0] + frames, *before[1:])


def part_name(number: int, *contents: bytes) -> str:
    """File name of a part: its number, and a hash of everything that its results depend on."""
    digest = hashlib.sha256()
    for content in contents:
        digest.update(hashlib.sha256(content).digest())
    return f"{number:07d}-{digest.hexdigest()[:32]}.arrow"


def source_stamp() -> tuple[Any, ...]:
    """What tells two versions of the solver apart."""
    rooms = Path(__file__).parents[2]
    files = sorted(f for room in ("scenes", "solver") for f in (rooms / room).rglob("*.py"))
    packages = [version(name) for name in ("roundel", "numpy", "scipy", "numba")]
    return (*packages, *((f.stat().st_mtime_ns, f.stat().st_size) for f in files))


def write_part(path: Path, estimates: Sequence[Estimate], tally: Tally) -> None:
    """Write the results of a block.

    It is not synced to disk: a part that a power cut damaged is solved again.

    Raises
    ------
    DataError
        If it cannot be written.
    """
    write_table_part(path, estimates_table(estimates), tally)


def write_table_part(path: Path, table: pa.Table, tally: Tally) -> None:
    """Likewise, of estimates as a table.

    Raises
    ------
    DataError
        If it cannot be written.
    """
    about = json.dumps([tally.counts, tally.failures, tally.timings]).encode()
    buffer = io.BytesIO()
    with pa.ipc.new_file(buffer, table.schema.with_metadata({_ABOUT: about})) as writer:
        writer.write_table(table.replace_schema_metadata({_ABOUT: about}))
    temporary = temporary_name(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.write_bytes(buffer.getvalue())
        os.replace(temporary, path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise write_failure(path, error) from error


def read_part(path: Path) -> tuple[pa.Table, Tally] | None:
    """The results of a block; None if there is no such part, or it is damaged."""
    try:
        with pa.ipc.open_file(io.BytesIO(path.read_bytes())) as reader:
            table = reader.read_all()
        counts, failures, timings = json.loads(table.schema.metadata[_ABOUT])
    except (OSError, ValueError, TypeError, KeyError, pa.ArrowException):
        return None
    return table, Tally(counts, {name: tuple(value) for name, value in failures.items()}, timings)


def whole_part(path: Path) -> tuple[pa.Table, Tally]:
    """The results of a block.

    Raises
    ------
    DataError
        If there is no such part, or it is damaged.
    """
    found = read_part(path)
    if found is None:
        raise DataError(f"{path}: a part of the results is gone or damaged; run the same command again")
    return found


def join_parts(parts: Sequence[Path], out: Path, dataset_id: str | None, images_sha256: str | None) -> Tally:
    """Join all parts, in order, into `estimates.parquet` and `timings.jsonl`, and remove them.

    Raises
    ------
    DataError
        If a file cannot be written, or a part vanished.
    """
    schema, whole = estimates_schema(dataset_id, images_sha256), Tally()
    waiting: list[pa.Table] = []

    def flush(writer: pq.ParquetWriter) -> None:
        if waiting:
            joined = pa.concat_tables(waiting).combine_chunks()
            writer.write_table(joined.replace_schema_metadata(schema.metadata))
            waiting.clear()

    checksum = out / f"{ESTIMATES}{CHECKSUM}"
    checksum.unlink(missing_ok=True)
    with (
        new_file(out / TIMINGS) as timings,
        new_file(out / ESTIMATES) as estimates,
        pq.ParquetWriter(estimates, schema) as writer,
    ):
        for path in parts:
            table, tally = whole_part(path)
            whole.add(tally)
            timings.writelines(f"{line}\n".encode() for line in tally.timings)
            waiting.append(table)
            if sum(t.num_rows for t in waiting) >= _ROWS:
                flush(writer)
        flush(writer)
    if dataset_id is not None:
        write_file(checksum, checksum_line(out / ESTIMATES))
    shutil.rmtree(out / PARTS, ignore_errors=True)
    return whole


def checksum_line(file: Path) -> bytes:
    """The file's checksum as `sha256sum` writes it."""
    with file.open("rb") as opened:
        return f"{hashlib.file_digest(opened, 'sha256').hexdigest()}  {file.name}\n".encode()
