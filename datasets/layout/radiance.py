"""Linear radiance on disk: OpenEXR, float32, with its Monte-Carlo variance, depth and coverage.

Channels: `Y` radiance, `Y.variance`, `Z` depth along the optical axis in metres, of the surface at the pixel's centre
(0: nothing was hit), `coverage.<marker_id>`, `noise_dn` standard deviation of the developed pixel. Where the radiance
is not kept, `Z` and the coverage may be: masks/ (`roundel.datasets.layout.masks`).
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.errors import DataError

# Number of independent estimates of a pixel; their scatter is the recorded variance.
REPLICATES = 8

Planes = dict[str, NDArray[np.float32]]

# Binary digits kept of planes that do not need float32's 24: a variance from 8 replicates has a relative uncertainty of
# one half, noise that of its model, depth 1e-5. The cleared digits compress to nothing.
_DIGITS = {"Y.variance": 8, "noise_dn": 12, "Z": 17}


def rounded(channel: str, plane: NDArray[np.float32]) -> NDArray[np.float32]:
    """A plane as stored: float32, rounded to the number of digits that its channel keeps."""
    exact = np.ascontiguousarray(plane, dtype=np.float32)
    if channel not in _DIGITS:
        return exact
    dropped = 24 - _DIGITS[channel]
    # Round to nearest by adding half an ulp of the kept precision; overflow carries into the exponent.
    bits = exact.view(np.uint32) + np.uint32(1 << (dropped - 1))
    return np.asarray(bits & np.uint32(0xFFFFFFFF << dropped & 0xFFFFFFFF)).view(np.float32)


def coverage_channel(marker_id: int) -> str:
    """Name of the plane that holds a marker's coverage."""
    return f"coverage.{marker_id}"


def encode_planes(planes: Planes) -> bytes:
    """The bytes of an EXR file with these planes, each (H, W) float32, `rounded`."""
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    channels = {name: rounded(name, plane) for name, plane in planes.items()}
    # The library writes only to named files; the dataset's write protocol needs bytes.
    try:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "planes.exr"
            OpenEXR.File(header, channels).write(str(path))
            return path.read_bytes()
    except (OSError, RuntimeError) as error:
        # The library's own error does not say that the temporary folder is full.
        raise DataError(
            f"{tempfile.gettempdir()}: cannot write an EXR file there (is it full?); free some space, or set TMPDIR"
        ) from error


@contextmanager
def _silence() -> Iterator[None]:
    """Keep the library from printing its own messages on standard error: this module says what is wrong."""
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


def decode_radiance(data: bytes, place: str) -> Planes:
    """Planes of an EXR file, by channel, from its bytes; `place` is its address, for messages.

    Raises
    ------
    DataError
        If it is truncated, or not a Roundel radiance file.
    """
    return decode_planes(data, place, "Y", "radiance")


def decode_planes(data: bytes, place: str, channel: str, what: str) -> Planes:
    """Planes of an EXR file, by channel, of which one must be there and finite; `what` it is, for messages.

    Raises
    ------
    DataError
        If the file is truncated, or has no such channel.
    """
    import OpenEXR

    try:
        # The library reads only named files.
        with tempfile.NamedTemporaryFile(suffix=".exr") as file, _silence():
            file.write(data)
            file.flush()
            with OpenEXR.File(file.name, separate_channels=True) as opened:
                planes = {n: np.array(c.pixels, dtype=np.float32) for n, c in opened.channels().items()}
    except Exception as error:  # the binding raises bare RuntimeError, OSError and its own types alike
        raise DataError(f"{place}: truncated or not an EXR file; render the dataset again") from error
    if channel not in planes or not np.all(np.isfinite(planes[channel])):
        raise DataError(f"{place}: has no finite {what} channel {channel}; render the dataset again")
    return planes


def read_radiance(path: str | Path) -> Planes:
    """Planes of an EXR file, by channel.

    Raises
    ------
    DataError
        If the file is missing, truncated, or not a Roundel radiance file.
    """
    path = Path(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DataError(
            f"{path}: this radiance is missing; render the dataset again (render.radiance: true)"
        ) from error
    return decode_radiance(data, str(path))
