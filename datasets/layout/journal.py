"""The journal: one line per finished frame, appended once its files are safely on disk."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from roundel.datasets.layout import files
from roundel.scenes.errors import DataError

Entry = dict[str, Any]


def line_of(entry: Entry) -> str:
    """An entry as a line; equal entries give equal bytes."""
    return json.dumps(entry, sort_keys=True, separators=(",", ":"))


def append(dataset: Path, entry: Entry) -> None:
    """Record a finished frame. Its files must already be safely on disk."""
    files.append_line(dataset / files.JOURNAL, line_of(entry))


def read(dataset: Path) -> dict[int, Entry]:
    """Entries by frame id. A last line cut short by a crash is dropped; any other broken line is an error."""
    path = dataset / files.JOURNAL
    if not path.is_file():
        return {}
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{path}: cannot read the journal; remove it to render again") from error
    entries: dict[int, Entry] = {}
    lines = text.split("\n")
    for number, line in enumerate(lines, start=1):
        if not line:
            continue
        try:
            entry = json.loads(line)
            entries[int(entry["frame_id"])] = entry
        except (ValueError, KeyError, TypeError) as error:
            if number == len(lines):
                break
            raise DataError(f"{path}:{number}: this line is corrupt; remove it to render its frame again") from error
    return entries


def rewrite(dataset: Path, entries: dict[int, Entry]) -> None:
    """Write the journal sorted by frame, so that its bytes do not depend on the order of rendering."""
    text = "".join(line_of(entries[i]) + "\n" for i in sorted(entries))
    files.write_file(dataset / files.JOURNAL, text.encode())


def is_done(dataset: Path, entry: Entry) -> bool:
    """Whether all files of the entry exist with the recorded sizes."""
    try:
        return all((dataset / name).stat().st_size == record["bytes"] for name, record in entry["files"].items())
    except OSError:
        return False
