"""Tables as records, the source of HTML, CSV, Markdown and LaTeX."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from roundel.scenes.display_text import TEXT_LIMIT, clean
from roundel.validate.scores.summary import number

Cell = str | int | float | None

# Length at which a cell wraps.
_PROSE = 44


@dataclass(frozen=True)
class Column:
    """A column: its key (snake_case, with the unit), its displayed title and its displayed unit.

    `role` joins a column to the preceding column without a role: `of` (35 / 36), `tail` (a second statistic after a
    slash), `low` and `high` (an interval in brackets), `file` (only in CSV). A `signed` number always shows its sign.
    """

    key: str
    title: str
    unit: str = ""
    role: str = ""
    signed: bool = False


@dataclass(frozen=True)
class Table:
    """A table: plain values row by row (None if missing), and a note that states frame, units and statistic."""

    name: str
    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str


@dataclass(frozen=True)
class Shown:
    """A cell as displayed: its value, a second value after a slash, and an interval."""

    value: str
    tail: str
    interval: str
    kind: str

    def text(self) -> str:
        """The cell as one line."""
        return " ".join(part for part in (self.value, self.interval, self.tail and f"/ {self.tail}") if part)


def signed(value: float | None) -> str:
    """A number with its sign, or a dash for None."""
    text = number(None if value is None else abs(value))
    # A number that rounds to zero has no sign.
    if value is None or not text.strip("0.-"):
        return text
    return ("+" if value > 0 else "\N{MINUS SIGN}") + text


def heads(table: Table) -> list[Column]:
    """The columns that are displayed."""
    return [column for column in table.columns if not column.role]


def shown_rows(table: Table) -> list[list[Shown]]:
    """The cells that are displayed, row by row."""
    parts = _parts(table)
    kinds = [_kind([row[own] for row in table.rows]) for own, _ in parts]
    return [
        [_shown(table, row, own, more, kind) for (own, more), kind in zip(parts, kinds, strict=True)]
        for row in table.rows
    ]


def _kind(cells: Sequence[Cell]) -> str:
    """Kind of a column: number, text on one line, or text that wraps."""
    texts = [cell for cell in cells if isinstance(cell, str)]
    return "number" if not texts else "prose" if max(map(len, texts)) > _PROSE else "text"


def _parts(table: Table) -> list[tuple[int, dict[str, int]]]:
    parts: list[tuple[int, dict[str, int]]] = []
    for i, column in enumerate(table.columns):
        if not column.role:
            parts.append((i, {}))
        elif column.role != "file":
            parts[-1][1][column.role] = i
    return parts


def _shown(table: Table, row: tuple[Cell, ...], own: int, more: dict[str, int], kind: str) -> Shown:
    def text(i: int) -> str:
        return formatted(row[i], table.columns[i].signed)

    known = {role: i for role, i in more.items() if row[i] is not None}
    value = text(own) + (f" / {text(known['of'])}" if "of" in known else "")
    tail = text(known["tail"]) if "tail" in known else ""
    interval = ""
    if "low" in known and "high" in known:
        unit = table.columns[known["low"]].unit
        interval = f"[{text(known['low'])}, {text(known['high'])}]" + (f" {unit}" if unit == "%" else "")
    return Shown(value, tail, interval, kind)


def formatted(value: Any, sign: bool = False) -> str:
    """A cell's value as displayed."""
    if value is None:
        return "-"
    if isinstance(value, str):
        return clean(value, TEXT_LIMIT)
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:+d}" if sign else str(value)
    return signed(value) if sign else number(value)
