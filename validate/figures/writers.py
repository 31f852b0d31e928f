"""Figures as SVG files beside the report; they follow the reader's light or dark scheme."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from roundel.datasets.store.writing import write_file
from roundel.validate.figures.svg import Picture, standalone_svg

FOLDER = "figures"
_OURS = b'<svg class="figure"'  # how `draw_svg` begins


def write_figures(folder: Path, pictures: Sequence[Picture]) -> None:
    """Write every figure as `folder`/figures/NAME.svg and delete figures of earlier runs that this run lacks.

    Parameters
    ----------
    folder : Path
        The report's folder.
    pictures : sequence of Picture
        Their names are safe in paths (`svg.name_of`).
    """
    inside = folder / FOLDER
    for old in set(inside.glob("*.svg")) - {inside / f"{picture.name}.svg" for picture in pictures}:
        if old.read_bytes().startswith(_OURS):
            old.unlink()
    for picture in pictures:
        write_file(inside / f"{picture.name}.svg", standalone_svg(picture).encode())
