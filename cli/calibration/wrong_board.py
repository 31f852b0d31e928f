"""When no photograph shows the board: perhaps they show another, whose counts or tags were taken for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from roundel.cli.calibration.boards import Photographed
from roundel.scenes.errors import DataError

if TYPE_CHECKING:
    from roundel.solver.photos.photo_inputs import PhotoInput

# A search takes a second in an image of twelve megapixels.
_MOST = 3
_FAMILIES = ("aruco_4x4_50", "aruco_5x5_100", "aruco_6x6_250", "apriltag_36h11")


def other_board(sources: Sequence[PhotoInput], board: Photographed) -> str:
    """What the first photographs show instead, with the options to give; empty if nothing was recognised."""
    from roundel.solver.photos.photo_file import as_stored, read_photo
    from roundel.validate.ingest.board_search import find_board

    for source in sources[:_MOST]:
        try:
            photo = read_photo(source.path, None, source.page)
        except DataError:
            continue
        levels = as_stored(photo.levels, photo.exif.orientation)
        for changed, text in _alternatives(board):
            part = replace(board.part, layout={**board.part.layout, **changed})
            if find_board(levels, part) is not None:
                options = " ".join(f"--set {key}={value}" for key, value in changed.items())
                return f"{source.name} shows {text}: give {options}"
    return ""


def _alternatives(board: Photographed) -> list[tuple[dict[str, Any], str]]:
    keys = board.part.layout
    if board.part.kind == "chessboard":
        columns, rows = int(keys["columns"]), int(keys["rows"])
        # Who counts squares counts one more each way than inner corners.
        counts = [(columns - 1, rows - 1), (columns + 1, rows + 1)]
        return [
            ({"columns": c, "rows": r}, f"a chessboard of {c} by {r} inner corners, which are what counts")
            for c, r in counts
            if min(c, r) >= 3
        ]
    if board.part.kind == "charuco":
        others = [family for family in _FAMILIES if family != keys["family"]]
        return [({"family": family}, f"tags of the family {family}") for family in others]
    return []
