"""Check an environment-map file: it exists, is OpenEXR or Radiance HDR within the size limit, and matches its recorded
checksum.

Only the header is read here; the renderer decodes the pixels. OpenEXR, "File Layout": magic number, version, then
attributes of name, type, size and value, ended by a zero byte. Radiance (Ward, "Real Pixels", 1991): lines of text, an
empty one, and the size of the picture.
"""

from __future__ import annotations

import hashlib
import re
import struct
from pathlib import Path

from roundel.scenes.assets.files import inside

_MAGIC = b"\x76\x2f\x31\x01"
# Rows from top to bottom, as all writers have them; others are flipped or turned.
_RADIANCE_SIZE = re.compile(rb"\n\n-Y (\d{1,9}) \+X (\d{1,9})\n")
_MAX_HEADER_BYTES = 1_000_000

MAX_WIDTH_PX = 16_384
MAX_BYTES = 1_000_000_000

# An equirectangular map spans 360 by 180 degrees; a deviation of one pixel is accepted.
_ASPECT = (1.9, 2.1)


def map_sha256(folder: Path, name: str, recorded: str | None) -> str:
    """Checksum of the map that a study in `folder` names.

    Returns
    -------
    str
        Checksum of the file; the recorded one if there is no file, as for the study inside a dataset.

    Raises
    ------
    ValueError
        If the file is missing, not a map, too large, or does not match the recorded checksum.
    """
    path = inside(folder, name)
    if not path.is_file():
        if recorded is not None:
            return recorded
        raise ValueError(f"no such file: {name}; the path is relative to the study")
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise ValueError(f"{name}: {size / 1e9:.1f} GB is too large for a map; scale it down")
        with path.open("rb") as file:
            _check_size(name, *_size_and_channels(name, file.read(_MAX_HEADER_BYTES)))
            file.seek(0)
            digest = hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise ValueError(f"{name}: cannot be read ({error.strerror})") from error
    if recorded not in (None, digest):
        raise ValueError(
            f"{name}: is not the recorded map (sha256 {digest[:12]}, not {recorded[:12]}); restore it, or remove sha256"
        )
    return digest


def _size_and_channels(name: str, header: bytes) -> tuple[int, int, int]:
    """Width, height and number of channels of an EXR or HDR file from its first bytes."""
    if header.startswith(b"#?"):
        size = _RADIANCE_SIZE.search(header)
        if size is None or b"FORMAT=32-bit_rle_rgbe" not in header[: size.start()]:
            raise ValueError(f"{name}: its header is not that of a Radiance HDR picture (RGBE, -Y +X); save it again")
        return int(size[2]), int(size[1]), 3
    if not header.startswith(_MAGIC):
        raise ValueError(f"{name}: is not an OpenEXR or Radiance HDR file")
    found: dict[str, bytes] = {}
    at = 8  # past the version
    try:
        while header[at] != 0:
            end = header.index(0, at)
            key = header[at:end].decode("latin-1")
            at = header.index(0, end + 1) + 1
            (size,) = struct.unpack_from("<i", header, at)
            if size < 0:
                raise ValueError
            found[key] = header[at + 4 : at + 4 + size]
            at += 4 + size
        x0, y0, x1, y1 = struct.unpack("<4i", found["dataWindow"])
        channels, at = 0, 0
        while found["channels"][at] != 0:
            # A name, then its type, four flags and two sampling steps: 16 bytes.
            at = found["channels"].index(0, at) + 17
            channels += 1
    except (IndexError, KeyError, ValueError, struct.error) as error:
        raise ValueError(f"{name}: its header is truncated or corrupt; get the file again") from error
    return x1 - x0 + 1, y1 - y0 + 1, channels


def _check_size(name: str, width: int, height: int, channels: int) -> None:
    if width > MAX_WIDTH_PX or 4 * width * height * channels > MAX_BYTES:
        raise ValueError(
            f"{name}: {width} x {height} pixels with {channels} channels is too large; scale it down "
            f"(at most {MAX_WIDTH_PX} wide, 1 GB decoded)"
        )
    if width < 4 or height < 2 or not _ASPECT[0] <= width / height <= _ASPECT[1]:
        raise ValueError(f"{name}: {width} x {height} pixels; an equirectangular map is twice as wide as high")
