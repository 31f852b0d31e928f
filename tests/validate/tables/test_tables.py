"""Tables for people and for programs: joined columns, plain values, and inert user text."""

from __future__ import annotations

import csv
import io
import re
import unicodedata
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from roundel.scenes.display_text import clean
from roundel.validate.tables.table import Column, Table, shown_rows
from roundel.validate.tables.writers import WRITERS, csv_text, latex_text, markdown_text, write_tables

COLUMNS = (
    Column("method", "Method"),
    Column("solved", "Solved"),
    Column("circles", "", role="of"),
    Column("normal_deg", "Normal", "deg"),
    Column("low_deg", "", role="low"),
    Column("high_deg", "", role="high"),
    Column("p95_deg", "", role="tail"),
    Column("rms_deg", "", role="file"),
    Column("along_mm", "Along", "mm", signed=True),
)
ROW = ("a_b", 35, 36, 0.022, 0.02, 0.024, 0.11, 0.05, -3.0)
TABLE = Table("results", "Results", COLUMNS, (ROW,), "100 % & more.")

HOSTILE = (
    '</style><script>alert(1)</script>',
    '"><img src=x onerror=alert(1)>',
    "=HYPERLINK(\"http://x\")",
    "+1", "-1", "@SUM(A1)", "\t=1", "\r=1",
    "a|b\nc", "[x](javascript:alert(1))", "![](http://x)", "`code`", "<b>",
    "a\u202egnp.exe", "\u2066x", "a\x00b\x1b[31m",
    r"\input{/etc/passwd}", r"$\def\x{\x}\x$", "% comment", "a & b \\\\ c", "x" * 10_000,
)  # fmt: skip


def of(text: str) -> Table:
    return Table("t", text, (Column("name", "Name"), Column("n", "N")), ((text, 1.5),), text)


def test_people_see_joined_columns() -> None:
    (row,) = shown_rows(TABLE)
    assert [cell.text() for cell in row] == ["a_b", "35 / 36", "0.0220 [0.0200, 0.0240] / 0.110", "\N{MINUS SIGN}3.00"]
    assert [cell.kind for cell in row] == ["text", "number", "number", "number"]


def test_programs_see_every_value() -> None:
    head, row = csv.reader(io.StringIO(csv_text(TABLE)))
    assert head == [column.key for column in COLUMNS]
    assert [float(v) for v in row[1:]] == list(TABLE.rows[0][1:])


def test_a_value_that_is_missing() -> None:
    table = Table("t", "T", COLUMNS, (("a", 0, 3, None, None, None, None, None, None),), "")
    assert [cell.text() for cell in shown_rows(table)[0]] == ["a", "0 / 3", "-", "-"]
    assert csv_text(table).splitlines()[1] == "a,0,3,,,,,,"


def test_markdown_and_latex() -> None:
    text = markdown_text(TABLE)
    assert "| Method | Solved | Normal [deg] | Along [mm] |" in text
    assert "| --- | ---: | ---: | ---: |" in text
    assert r"| a\_b |" in text
    latex = latex_text(TABLE)
    assert r"a\_b & 35 / 36 & 0.0220 {[}0.0200, 0.0240{]} / 0.110 & $-$3.00 \\" in latex
    for word in (r"\toprule", r"\midrule", r"\bottomrule", r"\label{tab:results}", r"100 \% \& more."):
        assert word in latex
    assert "siunitx" not in latex


@pytest.mark.parametrize("text", HOSTILE)
def test_no_text_acts_in_a_spreadsheet(text: str) -> None:
    rows = list(csv.reader(io.StringIO(csv_text(of(text)))))
    assert len(rows) == 2
    assert len(rows[1]) == 2
    assert not rows[1][0].startswith(("=", "+", "-", "@", "\t", "\r"))


@pytest.mark.parametrize("text", HOSTILE)
def test_no_text_acts_in_markdown(text: str) -> None:
    made = markdown_text(of(text))
    assert "<" not in made
    (row,) = [line for line in made.splitlines() if line.endswith("1.50 |")]
    assert len(re.findall(r"(?<!\\)\|", row)) == 3
    assert not re.search(r"(?<!\\)[\[\]`*_!]", row)
    assert "http:" not in made


@pytest.mark.parametrize("text", HOSTILE)
def test_no_text_acts_in_latex(text: str) -> None:
    made = latex_text(of(text))
    row = next(line for line in made.splitlines() if line.endswith(r"& 1.50 \\"))
    commands = [
        "backslash",
        "asciicircum",
        "asciitilde",
        "less",
        "greater",
        "bar",
        "quotedbl",
        "quotesingle",
        "asciigrave",
        "degree",
    ]
    words = "|".join([*(f"text{name}" for name in commands), "dots"])
    allowed = rf"\\({words})" + r"\{\}|\\[{}$&#%_]|\{[\[\]]\}|\$-\$|\$\\pm\$"
    rest = re.sub(allowed, "", row.removesuffix(r"& 1.50 \\"))
    assert not re.search(r"[\\{}$&#%_^~]", rest)


@given(st.text(max_size=60))
def test_clean_text_is_one_line_without_controls(text: str) -> None:
    shown = clean(text, 40)
    assert len(shown) <= 40
    assert not [c for c in shown if unicodedata.category(c) in ("Cc", "Cf", "Cs")]
    assert clean(shown, 40) == shown


def test_tables_of_an_earlier_run_do_not_stay(tmp_path: Path) -> None:
    write_tables(tmp_path, [TABLE, of("x")], ("results", "t"))
    (tmp_path / "tables" / "mine.csv").write_text("notes of the user's")
    write_tables(tmp_path, [TABLE], ("results", "t"))
    names = sorted(p.name for p in (tmp_path / "tables").iterdir())
    assert names == sorted(["mine.csv", *(f"results{suffix}" for suffix in WRITERS)])
