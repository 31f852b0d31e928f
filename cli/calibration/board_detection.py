"""What each photograph shows: the board in it, or why it does not count."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from roundel.cli.calibration.boards import Photographed
from roundel.scenes.errors import DataError, UsageError

if TYPE_CHECKING:
    from roundel.scenes.camera.response_curve import ResponseCurve
    from roundel.solver.calibration.grid_image import GridImage
    from roundel.solver.photos.photo_inputs import PhotoInput

Array = NDArray[np.float64]

# A photograph of twelve megapixels takes 0.6 GB meanwhile.
_TOGETHER = 2
_THUMBNAIL_PX = 240
# Points that agree so closely are those of a burst, or of a second copy: a tripod does not count twice.
_SAME_PX = 0.5
# Of a focal length: phones round the 35-mm equivalent to whole millimetres.
_SAME_FOCAL = 0.02
_WHY = {
    "chessboard": "no chessboard of {0} by {1} inner corners found: all of it has to be in the picture, sharp and "
    "without glare",
    "charuco": "fewer than six corners of the ChArUco board found: show more of it, closer, without blur or glare",
    "circle_grid": "fewer than six dots of the circle grid found: show more of it, closer, without blur or glare",
}


@dataclass(frozen=True, eq=False)
class BoardDetection:
    """A photograph as its file stores it.

    Attributes
    ----------
    name : str
    size_px : (int, int)
        (0, 0) if it could not be read.
    orientation : int
        Of its EXIF.
    reason : str
        Why it does not count; empty if it does.
    pixels, points_m : (N, 2), (N, 3) arrays
        Corners, or centres of dots, and where they are on the board.
    grid : GridImage or None
        Of a circle grid.
    picture : (h, w, 3) uint8 array or None
        Small.
    focal_mm : float or None
        Focal length of its EXIF, with digital zoom; None if it does not say.
    """

    name: str
    size_px: tuple[int, int] = (0, 0)
    orientation: int = 1
    reason: str = ""
    pixels: Array = field(default_factory=lambda: np.empty((0, 2)))
    points_m: Array = field(default_factory=lambda: np.empty((0, 3)))
    grid: GridImage | None = None
    picture: NDArray[np.uint8] | None = None
    focal_mm: float | None = None


def detect_boards(
    sources: Sequence[PhotoInput],
    board: Photographed,
    curve: ResponseCurve | None,
    progress: Callable[[int, int], None],
) -> list[BoardDetection]:
    """Look for the board in each photograph; other cameras and repeated views are left to `exclude_inconsistent`.

    Raises
    ------
    DataError
        If a file does not exist.
    """
    for source in sources:
        if not source.path.exists():
            raise DataError(f"{source.path}: no such file")
    seen: dict[tuple[str, int], str] = {}
    twins: dict[int, str] = {}
    for i, source in enumerate(sources):
        key = (_digest(source.path), source.page)
        if key in seen:
            twins[i] = seen[key]
        seen.setdefault(key, source.name)

    def detect(number: int) -> BoardDetection:
        source = sources[number]
        if number in twins:
            return BoardDetection(source.name, reason=f"is the same file as {twins[number]}")
        try:
            return _detect(source, board, curve)
        except DataError as error:
            return BoardDetection(source.name, reason=str(error).removeprefix(f"{source.path}: "))

    found = []
    # Each result depends on its photograph alone, and OpenCV releases the interpreter lock.
    with ThreadPoolExecutor(1 if board.layout is not None else _TOGETHER) as pool:
        for one in pool.map(detect, range(len(sources))):
            found.append(one)
            progress(len(found), len(sources))
    return found


def _digest(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return path.as_posix()  # whoever reads it says what is wrong


def _detect(source: PhotoInput, board: Photographed, curve: ResponseCurve | None) -> BoardDetection:
    from roundel.scenes.camera.quarter_turns import TURNS
    from roundel.solver.photos.photo_file import as_stored, read_photo
    from roundel.validate.ingest.board_search import find_board

    photo = read_photo(source.path, curve, source.page)
    turn = photo.exif.orientation
    stored = as_stored(photo.levels, turn)
    tags = photo.exif
    focal_mm = tags.focal_35mm_mm or tags.focal_mm
    base = BoardDetection(
        source.name,
        (stored.shape[1], stored.shape[0]),
        turn,
        picture=_small(as_stored(photo.picture, turn)),
        focal_mm=None if focal_mm is None else focal_mm * tags.digital_zoom,
    )
    if turn not in TURNS:
        return replace(base, reason=f"is stored mirrored (EXIF orientation {turn}): switch mirroring off")
    if board.layout is not None:
        return _with_grid(base, source, board, curve)
    linear = None
    if photo.photometry.curve.known:
        linear = as_stored(photo.grey, turn) * (255.0 / photo.saturation_dn)
    found = find_board(stored, board.part, linear)
    if found is None:
        keys = board.part.layout
        return replace(base, reason=_WHY[board.part.kind].format(keys["columns"], keys["rows"]))
    return replace(base, pixels=found.pixels, points_m=found.points_m)


def _with_grid(
    base: BoardDetection, source: PhotoInput, board: Photographed, curve: ResponseCurve | None
) -> BoardDetection:
    from roundel.solver.calibration.calibrate_images import photographed_grid

    assert board.layout is not None
    grid = photographed_grid(source, board.layout, curve)
    if not len(grid.index):
        return replace(base, reason=_WHY["circle_grid"])
    pixels = np.array([d.edges.ellipse[:2] for d in grid.detections])
    return replace(base, grid=grid, pixels=pixels, points_m=board.board.points_m[grid.index])


def _small(picture: NDArray[Any]) -> NDArray[np.uint8]:
    from PIL import Image

    image = Image.fromarray(picture)
    image.thumbnail((_THUMBNAIL_PX, _THUMBNAIL_PX))
    return np.asarray(image)


def exclude_inconsistent(found: Sequence[BoardDetection]) -> tuple[list[BoardDetection], tuple[int, int]]:
    """The photographs with the reasons that follow from the others: another size, or the same view once more.

    Returns
    -------
    detections : list of BoardDetection
    size_px : (int, int)
        That of most photographs with a board, as stored; that of most photographs if none has one.

    Raises
    ------
    UsageError
        If none could be read.
    """
    read = [photo for photo in found if photo.size_px != (0, 0)]
    if not read:
        raise UsageError(f"{found[0].name}: {found[0].reason}; none of the {len(found)} photographs can be used")
    shown = [photo for photo in read if not photo.reason] or read
    size = Counter(photo.size_px for photo in shown).most_common(1)[0][0]
    stated = Counter(photo.focal_mm for photo in shown if photo.size_px == size and photo.focal_mm is not None)
    focal_mm = stated.most_common(1)[0][0] if stated else None
    out: list[BoardDetection] = []
    for photo in found:
        if not photo.reason and photo.size_px != size:
            photo = replace(photo, reason=_other_size(photo, size))
        if not photo.reason and photo.focal_mm and focal_mm and abs(photo.focal_mm / focal_mm - 1) > _SAME_FOCAL:
            why = f"its EXIF has a focal length of {photo.focal_mm:g} mm, most have {focal_mm:g} mm"
            photo = replace(photo, reason=f"{why}: another lens or zoom is another camera")
        twin = next((other for other in out if not other.reason and _same_view(photo, other)), None)
        if not photo.reason and twin is not None:
            photo = replace(photo, reason=f"shows the board exactly where {twin.name} does: it would count twice")
        out.append(photo)
    return out, size


def _other_size(photo: BoardDetection, size: tuple[int, int]) -> str:
    width, height = photo.size_px
    if photo.size_px == size[::-1]:
        why = "it was turned without a note in its EXIF; use the file as the camera wrote it"
    elif abs(width * size[1] - height * size[0]) <= max(size) * 2:
        why = "it was scaled, or taken in another mode; use the file as the camera wrote it"
    else:
        why = "it was cropped, or is from another camera; use the file as the camera wrote it"
    return f"has {width}x{height} px, but most have {size[0]}x{size[1]}: {why}"


def _same_view(photo: BoardDetection, other: BoardDetection) -> bool:
    if photo.size_px != other.size_px or photo.points_m.shape != other.points_m.shape:
        return False
    if not np.array_equal(photo.points_m, other.points_m):
        return False
    return bool(np.sqrt(np.mean(np.sum((photo.pixels - other.pixels) ** 2, axis=-1))) < _SAME_PX)
