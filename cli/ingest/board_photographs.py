"""Photographs read one by one, and the board that each shows."""

from __future__ import annotations

import hashlib
import io
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from roundel.scenes.errors import DataError, UsageError

if TYPE_CHECKING:
    from roundel.scenes.camera.response_curve import ResponseCurve
    from roundel.scenes.markers.marker import Part, Sheet
    from roundel.solver.intrinsics.exif import ExifTags
    from roundel.validate.calibration.board_bundle import BoardCorners

# Others in the folder, such as notes, are passed over in silence.
_PICTURES = (".jpg", ".jpeg", ".png", ".heic", ".heif", ".tif", ".tiff", ".webp", ".avif", ".dng")
# Photographs that are looked at at the same time: one of twelve megapixels takes 0.6 GB meanwhile.
_TOGETHER = 2
_MIRRORED = (2, 4, 5, 7)
_GPS = 0x8825


@dataclass(frozen=True, eq=False)
class BoardPhotograph:
    """A photograph that shows the board; `size_px` and `board` are those of the image as it is stored."""

    path: Path
    suffix: str
    sha256: str
    size_px: tuple[int, int]
    bits: int
    curve: ResponseCurve
    exif: ExifTags
    located: bool
    board: BoardCorners

    def load(self) -> bytes:
        """The bytes of the file.

        Raises
        ------
        DataError
            If they changed since the board was found.
        """
        data = _bytes(self.path)
        if hashlib.sha256(data).hexdigest() != self.sha256:
            raise DataError(f"{self.path}: changed while it was being imported; run again")
        return data


@dataclass
class Album:
    """The photographs of a folder: those that show the board, and why others are left out, by name."""

    shown: list[BoardPhotograph] = field(default_factory=list)
    left_out: dict[str, str] = field(default_factory=dict)

    def size_px(self) -> tuple[int, int]:
        """Width and height of all.

        Raises
        ------
        UsageError
            If they differ.
        """
        sizes = Counter(photo.size_px for photo in self.shown)
        common = sizes.most_common(1)[0][0]
        odd = next((photo for photo in self.shown if photo.size_px != common), None)
        if odd is not None:
            width, height = odd.size_px
            raise UsageError(
                f"{odd.path}: has {width}x{height} px, but others have {common[0]}x{common[1]}; import photographs of "
                "one camera in one setting, as it wrote them"
            )
        return common


def photographs_in(folder: str | Path) -> list[Path]:
    """The pictures of a folder, by name.

    Raises
    ------
    UsageError
        If it is no folder, or has none.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise UsageError(f"{folder}: is no folder; name the folder of the photographs")
    found = sorted(p for p in folder.iterdir() if p.suffix.lower() in _PICTURES and not p.name.startswith("."))
    if not found:
        raise UsageError(f"{folder}: has no photographs; JPEG and PNG are imported")
    return found


def look_through(
    paths: list[Path], sheet: Sheet, board: Part, circles: list[Part], progress: Callable[[int, int], None] | None
) -> Album:
    """Find the board in each photograph; those without are left out, with the reason."""

    def look(path: Path) -> BoardPhotograph | str:
        try:
            return _looked_at(path, sheet, board, circles)
        except DataError as error:
            return str(error).removeprefix(f"{path}: ")

    album = Album()
    # Each result depends on its photograph alone, and OpenCV releases the interpreter lock.
    with ThreadPoolExecutor(_TOGETHER) as pool:
        for done, (path, found) in enumerate(zip(paths, pool.map(look, paths), strict=True), start=1):
            if isinstance(found, str):
                album.left_out[path.name] = found
            else:
                album.shown.append(found)
            if progress:
                progress(done, len(paths))
    return album


def _looked_at(path: Path, sheet: Sheet, board: Part, circles: list[Part]) -> BoardPhotograph:
    import numpy as np

    from roundel.datasets.ingest.photographs import suffix_of
    from roundel.solver.photos.photo_file import as_stored, read_photo
    from roundel.validate.ingest.board_search import find_board, shows_circle

    photo, data = read_photo(path), _bytes(path)
    suffix, turn = suffix_of(data), photo.exif.orientation
    if suffix is None:
        raise DataError("is neither JPEG nor PNG; export it as JPEG, with its metadata")
    if turn in _MIRRORED:
        raise DataError(f"is stored mirrored (EXIF orientation {turn}); switch mirroring off")
    pixels = as_stored(photo.levels, turn)
    found = find_board(pixels, board)
    if found is None:
        raise DataError(f"no {board.kind} found")
    if not all(shows_circle(pixels, found, sheet, board, circle) for circle in circles):
        raise DataError("the circle is not where the sheet has it: another sheet, or mirrored?")
    return BoardPhotograph(
        path,
        suffix,
        hashlib.sha256(data).hexdigest(),
        (pixels.shape[1], pixels.shape[0]),
        # Of colour with 16 bits a dataset delivers the upper 8.
        16 if pixels.dtype == np.uint16 and pixels.ndim == 2 else 8,
        photo.photometry.curve,
        photo.exif,
        _is_located(data),
        found,
    )


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise DataError(f"{path}: cannot read: {error.strerror or error}") from error


def _is_located(data: bytes) -> bool:
    """Whether the file tells where it was taken."""
    from PIL import Image

    try:
        with Image.open(io.BytesIO(data)) as image:
            return bool(image.getexif().get_ifd(_GPS))
    except Exception:  # damaged metadata make Pillow raise many types
        return False
