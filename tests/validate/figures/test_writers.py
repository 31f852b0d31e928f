"""Figures as files: the SVG of the page, no leftovers of an earlier run, and no other file touched."""

from __future__ import annotations

import re
from pathlib import Path

from roundel.validate.figures.svg import Picture, draw_svg, name_of, standalone_svg
from roundel.validate.figures.writers import write_figures


def picture(name: str) -> Picture:
    return Picture(name, "words", draw_svg(name, "title", (3.0, 2.0), lambda figure: None))


def test_figures_of_an_earlier_run_go_and_files_of_others_stay(tmp_path: Path) -> None:
    write_figures(tmp_path, [picture("a"), picture("b")])
    (tmp_path / "figures" / "mine.svg").write_text("<svg/>")
    write_figures(tmp_path, [picture("b")])
    assert sorted(p.name for p in (tmp_path / "figures").iterdir()) == ["b.svg", "mine.svg"]
    assert (tmp_path / "figures" / "b.svg").read_text() == standalone_svg(picture("b"))


def test_names_that_differ_do_not_share_a_file() -> None:
    names = ["on_axis", "on-axis", "on axis", "on.axis", "On_axis", "..", "a/b", "a:b", "a" * 41, "a" * 42, ""]
    files = [name_of("ml", name) for name in names]
    assert len({file.lower() for file in files}) == len(names)
    assert all(re.fullmatch(r"[a-z0-9_][a-z0-9._-]*", file) for file in files)
    assert name_of("ml", "truth", "on_axis") == "ml-truth-on_axis"
