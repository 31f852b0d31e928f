"""HTML pages from templates; all text from users is escaped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from importlib import resources
from typing import TYPE_CHECKING, Any

from roundel.scenes.display_text import NAME_LIMIT, TEXT_LIMIT, clean
from roundel.validate.figures.svg import Picture
from roundel.validate.scores.summary import Summary
from roundel.validate.tables.table import Table, heads, shown_rows

if TYPE_CHECKING:
    from jinja2 import Template

_HERE = "roundel.validate.report"

# A page shows at most this many rows of a table (about 200 kB); the CSV file has all.
_MAX_ROWS = 500

# Keys whose values are names given by a user. Names are truncated; other text only loses its control characters.
_NAMES = ("name", "method", "methods", "intrinsics", "group", "groups", "reference")


def fill(name: str, /, **values: Any) -> str:
    """Fill a template of a report's pages, see `template`."""
    from markupsafe import Markup

    css = Markup((resources.files(_HERE) / "report.css").read_text(encoding="utf-8"))
    return template(_HERE, name).render(css=css, **values).strip() + "\n"


def template(package: str, name: str) -> Template:
    """A page template of a package. Everything except Markup is escaped; undefined names are errors."""
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    room = resources.files(package)
    environment = Environment(
        loader=FunctionLoader(lambda name: (room / name).read_text(encoding="utf-8")),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name)


def presentable(value: Any, key: str = "") -> Any:
    """A copy that is safe to display: names truncated, control characters and reordering characters replaced."""
    if isinstance(value, str):
        if "\n" in value:
            return "\n".join(clean(line, TEXT_LIMIT) for line in value.split("\n"))
        return clean(value, NAME_LIMIT if key in _NAMES else TEXT_LIMIT)
    if isinstance(value, dict):
        return {clean(str(k), NAME_LIMIT): presentable(v, str(k)) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [presentable(v, key) for v in value]
    return value


def presentable_summary(summary: Summary) -> Summary:
    """A summary whose texts are safe to display."""
    return replace(summary, **{f.name: presentable(getattr(summary, f.name), f.name) for f in fields(summary)})


def figures(pictures: Sequence[Picture]) -> list[dict[str, Any]]:
    """Figures for a template. Roundel makes their SVG, so it is inserted without escaping."""
    from markupsafe import Markup

    return [
        {"name": p.name, "caption": clean(p.caption, TEXT_LIMIT), "svg": Markup(p.svg), "folded": p.folded}
        for p in pictures
    ]


def shown_table(table: Table) -> dict[str, Any]:
    """A table for a template."""
    rows = shown_rows(table)
    numbers = [all(row[i].kind == "number" for row in rows) for i in range(len(heads(table)))]
    return {
        "name": table.name,
        "title": table.title,
        "heads": heads(table),
        "numbers": numbers,
        "rows": rows[:_MAX_ROWS],
        "left_out": max(0, len(rows) - _MAX_ROWS),
        "note": table.note,
    }


class Tables(dict[str, Any]):
    """Tables for a template, by name; None for a table that the report does not have."""

    def __init__(self, tables: dict[str, Table]) -> None:
        super().__init__({name: shown_table(table) for name, table in tables.items()})
        seen: dict[str, str] = {}
        for name, table in tables.items():
            # A long note appears once on the page; the files have it in full.
            if table.note in seen and len(table.note) > 100:
                self[name]["note"] = f"Statistic, frame and units as under \u201c{seen[table.note]}\u201d."
            seen.setdefault(table.note, table.title)

    def __missing__(self, name: str) -> None:
        return None
