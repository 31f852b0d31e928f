"""Which photographs are meant: files, folders, patterns such as `shots/*.HEIC`, and the pages of a TIFF."""

from __future__ import annotations

import glob
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from roundel.scenes.errors import UsageError
from roundel.solver.photos.raw_file import SUFFIXES as RAW_SUFFIXES

# What a folder is searched for; files that are named may have any suffix.
SUFFIXES = (
    *(".jpg", ".jpeg", ".jfif", ".heic", ".heif", ".hif", ".avif", ".png", ".tif", ".tiff", ".webp"),
    *(".bmp", ".gif", ".jp2", ".ppm", ".pgm", ".mpo"),
    *RAW_SUFFIXES,
)
_TIFF_SUFFIXES = (".tif", ".tiff")
_NEW_SUBFILE_TYPE = 254
# Of a scanner's stack; a damaged file may claim millions.
_MOST_PAGES = 1000


@dataclass(frozen=True)
class PhotoInput:
    """A photograph: a file, and the page of a TIFF, from 0."""

    path: Path
    page: int = 0

    @property
    def name(self) -> str:
        """The path as given, with the page unless it is the first: `scan.tif, page 2`."""
        return self.path.as_posix() + (f", page {self.page + 1}" if self.page else "")

    @property
    def stem(self) -> str:
        """For the name of a picture: the file's own, with the page unless it is the first."""
        return self.path.stem + (f"-page{self.page + 1}" if self.page else "")


def find_photographs(given: Sequence[str | Path]) -> list[PhotoInput]:
    """The photographs that arguments mean, in the order given, those of a folder or a pattern by name.

    A folder means the images in it, by their suffixes; its sub-folders are not searched. A pattern (`*`, `?`, `[...]`,
    `**`) is for shells that do not expand it, and for Python. A TIFF means each of its pages, without thumbnails. A
    file that does not exist is kept: whoever reads it says so.

    Raises
    ------
    UsageError
        If a folder has no image, or a pattern matches nothing.
    """
    files = [path for one in given for path in _files(one)]
    return [PhotoInput(path, page) for path in files for page in pages_of(path)]


def _files(given: str | Path) -> list[Path]:
    path = Path(given)
    if path.is_dir():
        found = images_in(path)
        if not found:
            raise UsageError(f"{path}: no photographs in this folder (its sub-folders are not searched)")
        return found
    if path.exists() or not glob.has_magic(str(given)):
        return [path]
    matches = sorted(Path(name) for name in glob.glob(str(given), recursive=True))
    found = [match for match in matches if match.suffix.lower() in SUFFIXES and match.is_file()]
    if not found:
        raise UsageError(f"{given}: no photographs match this pattern")
    return found


def images_in(folder: Path) -> list[Path]:
    """Images of a folder by their suffixes, sorted by name; hidden files (`._IMG.jpg`) are left out."""
    return [
        path
        for path in sorted(folder.iterdir())
        if path.suffix.lower() in SUFFIXES and path.is_file() and not path.name.startswith(".")
    ]


def pages_of(path: Path) -> list[int]:
    """Pages of a TIFF that are images of their own; [0] for any other file, and for one that cannot be read."""
    if path.suffix.lower() not in _TIFF_SUFFIXES:
        return [0]
    from PIL import Image

    pages: list[int] = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            with Image.open(path, formats=["TIFF"]) as image:
                for page in range(min(getattr(image, "n_frames", 1), _MOST_PAGES)):
                    image.seek(page)
                    # Bit 0: a reduced version of another page.
                    if not int(getattr(image, "tag_v2", {}).get(_NEW_SUBFILE_TYPE, 0)) & 1:
                        pages.append(page)
        # A damaged file: its first page says what is wrong when it is read. Pillow raises many types.
        except Exception:
            return pages or [0]
    return pages or [0]
