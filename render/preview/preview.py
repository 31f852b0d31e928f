"""Preview a study: render a few small frames, write the page and the contact sheet, summarise each group."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from roundel.datasets.store.writing import write_file
from roundel.render.preview.frame_facts import FrameFacts, facts_of
from roundel.render.preview.frame_selection import chosen_ids, placed_ids
from roundel.render.preview.group_facts import group_facts
from roundel.render.preview.page import Tile, contact_sheet, points_picture, preview_page
from roundel.render.preview.small_frame import SIDE_PX, render_small
from roundel.scenes.study.study import Study
from roundel.scenes.world.frame import frame_of, group_ranges
from roundel.scenes.world.plausibility import implausible_values

CONTACT_SHEET, PAGE = "contact_sheet.png", "preview.html"

Progress = Callable[[int, int], None]


def preview_study(study: Study, out: Path, progress: Progress | None = None) -> list[str]:
    """Write `contact_sheet.png` and `preview.html` into a folder.

    Parameters
    ----------
    study : Study
    out : Path
        Folder; older files of these names are replaced.
    progress : callable, optional
        Called with (frames done, total frames).

    Returns
    -------
    list of str
        A line for each group, for the terminal.

    Raises
    ------
    StudyError
        If one of the frames looked at is impossible.
    BackendError
        If the renderer cannot start.
    DataError
        If the files cannot be written.
    """
    chosen, placed = chosen_ids(study), placed_ids(study)
    wanted = {i for ids in (*chosen.values(), *placed.values()) for i in ids}
    shown = {i for ids in chosen.values() for i in ids}
    facts: dict[int, FrameFacts] = {}
    tiles: list[Tile] = []
    for done, i in enumerate(sorted(wanted)):
        if progress:
            progress(done, len(wanted))
        facts[i] = facts_of(frame_of(study, i))
        if i in shown:
            tiles.append(_tile(facts[i]))
    if progress:
        progress(len(wanted), len(wanted))
    groups = [
        group_facts(
            name,
            study.groups[name],
            len(ids),
            [facts[i] for i in sorted({*placed[name], *chosen.get(name, [])})],
            [facts[i] for i in chosen.get(name, [])],
        )
        for name, ids in group_ranges(study).items()
    ]
    out.mkdir(parents=True, exist_ok=True)
    write_file(out / CONTACT_SHEET, contact_sheet(tiles))
    write_file(out / PAGE, preview_page(study.name, groups, tiles, implausible_values(study)))
    return [group.line for group in groups]


def _tile(facts: FrameFacts) -> Tile:
    if facts.frame.settings.mode == "points":
        return Tile(points_picture(facts, SIDE_PX), facts)
    return Tile(render_small(facts.frame), facts)
