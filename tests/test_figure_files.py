"""Figures as files: the SVG of the page, no leftovers of an earlier run, and nobody else's file touched."""

from __future__ import annotations

from pathlib import Path

from roundel.validate.drawing import Picture, draw_svg, standalone_svg
from roundel.validate.figure_files import write_figures


def picture(name: str) -> Picture:
    return Picture(name, "words", draw_svg(name, "title", (3.0, 2.0), lambda figure: None))


def test_figures_of_an_earlier_run_go_and_files_of_others_stay(tmp_path: Path) -> None:
    write_figures(tmp_path, [picture("a"), picture("b")])
    (tmp_path / "figures" / "mine.svg").write_text("<svg/>")
    write_figures(tmp_path, [picture("b")])
    assert sorted(p.name for p in (tmp_path / "figures").iterdir()) == ["b.svg", "mine.svg"]
    assert (tmp_path / "figures" / "b.svg").read_text() == standalone_svg(picture("b"))
