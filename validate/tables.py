"""Tables as records: what a page, a CSV file, a Markdown file and a LaTeX file are all made from."""

from __future__ import annotations

from dataclasses import dataclass

Cell = str | int | float | None


@dataclass(frozen=True)
class Column:
    """A column's key (snake_case, with the unit), its title for people, and the unit they read."""

    key: str
    title: str
    unit: str = ""


@dataclass(frozen=True)
class Table:
    """A table: plain values row by row (None where there is none), and a note that says frame, units and statistic."""

    name: str
    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str
