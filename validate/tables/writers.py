"""Tables as files: CSV, Markdown and LaTeX, with all text from users escaped."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from pathlib import Path

from roundel.datasets.store.writing import write_file
from roundel.scenes.display_text import clean
from roundel.validate.tables.table import Cell, Table, heads, shown_rows

FOLDER = "tables"

# Spreadsheets interpret a cell that begins with one of these as a formula.
_FORMULA = ("=", "+", "-", "@")
_MARKDOWN = re.compile(r"([\\`*_{}\[\]()#+!|~$-])")
_LATEX = {
    "\\": r"\textbackslash{}", "{": r"\{", "}": r"\}", "$": r"\$", "&": r"\&", "#": r"\#", "%": r"\%", "_": r"\_",
    "^": r"\textasciicircum{}", "~": r"\textasciitilde{}", "<": r"\textless{}", ">": r"\textgreater{}",
    "|": r"\textbar{}", '"': r"\textquotedbl{}", "'": r"\textquotesingle{}", "`": r"\textasciigrave{}",
    "[": "{[}", "]": "{]}", "\N{MINUS SIGN}": "$-$", "\N{DEGREE SIGN}": r"\textdegree{}",
    "\N{PLUS-MINUS SIGN}": r"$\pm$", "\N{HORIZONTAL ELLIPSIS}": r"\dots{}", "\N{REPLACEMENT CHARACTER}": "?",
}  # fmt: skip


def csv_text(table: Table) -> str:
    """CSV (RFC 4180, UTF-8, LF): one plain value per cell, units in the header keys, missing values are empty.

    Text that a spreadsheet would interpret as a formula is prefixed with an apostrophe.
    """
    sink = io.StringIO()
    writer = csv.writer(sink, lineterminator="\n")
    writer.writerow([column.key for column in table.columns])
    writer.writerows([[_csv_cell(cell) for cell in row] for row in table.rows])
    return sink.getvalue()


def _csv_cell(value: Cell) -> str:
    if value is None:
        return ""
    if isinstance(value, str):
        text = clean(value)
        return f"'{text}" if text.startswith(_FORMULA) else text
    return repr(value)


def markdown_text(table: Table) -> str:
    """A Markdown table with its title and note, as GitHub and pandoc read it."""
    columns, rows = heads(table), shown_rows(table)
    numbers = [all(row[i].kind == "number" for row in rows) for i in range(len(columns))]
    lines = [f"**{_markdown(table.title)}**", ""]
    lines.append(_line([_markdown(c.title) + (f" [{_markdown(c.unit)}]" if c.unit else "") for c in columns]))
    lines.append(_line(["---:" if n else "---" for n in numbers]))
    lines += [_line([_markdown(cell.text()) for cell in row]) for row in rows]
    return "\n".join([*lines, "", _markdown(table.note), ""])


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _markdown(text: str) -> str:
    entities = clean(text).replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    # A zero-width space before the colon or dot prevents automatic links.
    entities = re.sub(r"(?i)\b(https?|ftp|www|mailto)([:.])", r"\1&#8203;\2", entities)
    return _MARKDOWN.sub(r"\\\1", entities.replace("&#8203;", "\0")).replace("\0", "&#8203;")


def latex_text(table: Table) -> str:
    r"""A LaTeX table; needs `\usepackage{booktabs,textcomp}` and, for non-Latin names, a font that has them."""
    columns, rows = heads(table), shown_rows(table)
    numbers = [all(row[i].kind == "number" for row in rows) for i in range(len(columns))]
    head = [_latex(c.title) + (f" [{_latex(c.unit)}]" if c.unit else "") for c in columns]
    label = re.sub(r"[^a-z0-9]+", "-", table.name.lower()).strip("-")
    body = [" & ".join(_latex(cell.text()) for cell in row) + r" \\" for row in rows]
    return "\n".join([
        "% Needs \\usepackage{booktabs,textcomp}.", r"\begin{table}", r"  \centering\small",
        f"  \\caption{{{_latex(table.title)}. {_latex(table.note)}}}", f"  \\label{{tab:{label}}}",
        f"  \\begin{{tabular}}{{{''.join('r' if n else 'l' for n in numbers)}}}", r"    \toprule",
        "    " + " & ".join(head) + r" \\", r"    \midrule", *(f"    {line}" for line in body), r"    \bottomrule",
        r"  \end{tabular}", r"\end{table}", "",
    ])  # fmt: skip


def _latex(text: str) -> str:
    return "".join(_LATEX.get(character, character) for character in clean(text))


WRITERS = {".csv": csv_text, ".md": markdown_text, ".tex": latex_text}


def write_tables(folder: Path, tables: Sequence[Table], known: Sequence[str]) -> None:
    """Write every table as `folder`/tables/NAME.csv, .md and .tex.

    Parameters
    ----------
    folder : Path
        The report's folder.
    tables : sequence of Table
        Their names consist of lower-case letters, digits and underscores.
    known : sequence of str
        All names that such a report may have; files of tables that this run lacks are deleted.
    """
    inside = folder / FOLDER
    for name in set(known) - {table.name for table in tables}:
        for suffix in WRITERS:
            (inside / f"{name}{suffix}").unlink(missing_ok=True)
    for table in tables:
        for suffix, text_of in WRITERS.items():
            write_file(inside / f"{table.name}{suffix}", text_of(table).encode())
