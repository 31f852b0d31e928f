"""Records as lines of JSON, each with a checksum of its own.

The key `sha256` of a record holds the first 16 digits of the sha256 of the line without it. A line that was cut short,
or in which a byte changed, is told apart from a whole one.
"""

from __future__ import annotations

import hashlib
import json
from typing import Any

Record = dict[str, Any]

KEY = "sha256"


def _text(record: Record) -> str:
    return json.dumps(record, sort_keys=True, separators=(",", ":"), allow_nan=False)


def line_of(record: Record) -> str:
    """A record as a line, without its end; equal records give equal bytes."""
    bare = {name: value for name, value in record.items() if name != KEY}
    text = _text(bare)
    return _text({**bare, KEY: hashlib.sha256(text.encode()).hexdigest()[:16]})


def record_of(line: bytes) -> Record | None:
    """The record of a line, without its checksum; None if the line is damaged."""
    try:
        record = json.loads(line)
        if not isinstance(record, dict) or line_of(record).encode() != line:
            return None
    except (ValueError, RecursionError, TypeError):
        return None
    del record[KEY]
    return record


def records_of(data: bytes) -> tuple[list[Record], int]:
    """The whole records of a file, and how many of its lines are damaged; a last line without its end is damaged."""
    *lines, rest = data.split(b"\n")
    found = [record_of(line) for line in lines]
    return [record for record in found if record is not None], sum(record is None for record in found) + bool(rest)


def document_of(record: Record) -> bytes:
    """A record as a file of JSON with a checksum of its own, the key `sha256`; equal records give equal bytes."""
    bare = {name: value for name, value in record.items() if name != KEY}
    return _pretty({**bare, KEY: hashlib.sha256(_pretty(bare)).hexdigest()})


def record_of_document(data: bytes) -> Record:
    """The record of such a file, without its checksum.

    Raises
    ------
    ValueError
        If it is no JSON, or a byte of it changed.
    """
    try:
        record = json.loads(data)
    except RecursionError as error:
        raise ValueError("nested too deeply") from error
    if not isinstance(record, dict):
        raise ValueError("not a mapping of keys")
    if document_of(record) != data:
        raise ValueError("its own checksum does not match: it was altered")
    del record[KEY]
    return record


def _pretty(record: Record) -> bytes:
    return (json.dumps(record, indent=1, sort_keys=True, allow_nan=False) + "\n").encode()
