"""The frames of a video file, by OpenCV's decoder, and what went wrong, in one line.

OpenCV scales every frame to the size of the first one, and cuts deeper pixels to 8 bits. Both are noticed here.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from roundel.scenes.errors import DataError

_HEAD = 1 << 16
_JPEG_CODECS = ("mjpg", "MJPG", "jpeg")
# Frames that a file may announce and not have: the announced number is often computed from a rounded duration.
_FORGIVEN = 2


@dataclass(eq=False)
class Video:
    """An open video.

    Attributes
    ----------
    path : Path
    width_px, height_px : int
    rate_hz : float
    announced : int or None
        Number of frames that the file claims to have.
    problem : str
        After the last frame: why there are not more of them; empty if nothing is wrong.
    """

    path: Path
    width_px: int
    height_px: int
    rate_hz: float
    announced: int | None
    problem: str = ""
    _capture: cv2.VideoCapture = field(repr=False, default_factory=cv2.VideoCapture)

    def __iter__(self) -> Iterator[tuple[float, NDArray[np.uint8]]]:
        """Time in seconds and BGR pixels (H, W, 3) of each frame that can be decoded.

        Raises
        ------
        DataError
            If there is none.
        """
        sizes, count, last_s = _jpeg_sizes(self.path, self._capture), 0, -1.0
        while True:
            good, frame = self._capture.read()
            if not good:
                break
            size = next(sizes, None) or (frame.shape[1], frame.shape[0])
            if size != (self.width_px, self.height_px):
                self.problem = (
                    f"frame {count} has {size[0]}x{size[1]} px, but the video began with {self.width_px}x"
                    f"{self.height_px}; only the {count} frames before it were used"
                )
                break
            # Without usable times, those of the announced rate.
            time_s = float(self._capture.get(cv2.CAP_PROP_POS_MSEC)) / 1000.0
            last_s = time_s if time_s > last_s else last_s + 1.0 / self.rate_hz
            yield last_s, np.asarray(frame, dtype=np.uint8)
            count += 1
        self._capture.release()
        if count == 0:
            raise DataError(f"{self.path}: no frame of this video can be decoded; it has none, or is damaged")
        if not self.problem and self.announced is not None and count < self.announced - _FORGIVEN:
            self.problem = f"cut short: only {count} of {self.announced} frames can be decoded, and were used"


def open_video(path: str | Path) -> Video:
    """Open a video.

    Raises
    ------
    DataError
        If it cannot be read, has no frames, more than 8 bits, or a codec that this OpenCV lacks; one line with its
        name.
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD)
    except OSError as error:
        raise DataError(f"{path}: cannot read: {error.strerror or type(error).__name__}") from error
    if not head:
        raise DataError(f"{path}: this file is empty")
    capture = _opened(path)
    if not capture.isOpened():
        raise DataError(f"{path}: {_why_closed(path, head)}")
    pixels = _characters(capture.get(cv2.CAP_PROP_CODEC_PIXEL_FORMAT))
    deep = _is_deep(pixels)
    if deep:
        raise DataError(
            f"{path}: this video has {deep}, which OpenCV's decoder cuts to 8 bits; convert it to 8 bits, or its "
            "frames to 16-bit PNG files"
        )
    rate = float(capture.get(cv2.CAP_PROP_FPS))
    count = float(capture.get(cv2.CAP_PROP_FRAME_COUNT))
    width, height = (int(capture.get(key)) for key in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
    announced = int(count) if 0 < count < 1e9 else None
    return Video(path, width, height, rate if 0.1 < rate < 1e5 else 30.0, announced, "", capture)


def _opened(path: Path, *parameters: int) -> cv2.VideoCapture:
    # FFmpeg writes to stderr by itself; it reads this variable when it is first used.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    logging = cv2.utils.logging
    level = logging.setLogLevel(logging.LOG_LEVEL_SILENT)
    try:
        if parameters:
            return cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, list(parameters))
        return cv2.VideoCapture(str(path))
    finally:
        logging.setLogLevel(level)


def _characters(code: float) -> str:
    """A four-character code; empty if there is none."""
    raw = (int(code) & 0xFFFFFFFF).to_bytes(4, "little")
    return "" if raw == b"\xff\xff\xff\xff" else raw.decode("latin-1")


def _is_deep(pixels: str) -> str:
    """What to call a pixel format of more than 8 bits; empty for others.

    FFmpeg's codes of these end with the number of bits (Y, 1, 0, 16), or begin with it for big-endian pixels; all other
    characters are letters and digits.
    """
    bits = next((ord(c) for c in pixels[-1:] + pixels[:1] if 9 <= ord(c) <= 16), None)
    return "" if bits is None else f"{bits}-bit pixels"


def _why_closed(path: Path, head: bytes) -> str:
    if head[4:8] == b"ftyp":
        index = _index_of_mp4(path)
        if index is None:
            return "cut short: the index at the end of this video (moov) is missing, and no frame can be decoded"
        at = index.find(b"stsd")
        return _lacks(index[at + 16 : at + 20]) if at >= 0 else "this video has no frames"
    if head[:4] == b"RIFF" and head[8:12] == b"AVI ":
        at = head.find(b"vids")
        return _lacks(head[at + 4 : at + 8]) if at >= 0 else "this file has no video stream"
    if head[:4] == b"\x1a\x45\xdf\xa3":
        return "OpenCV cannot open this video: it is damaged, or of a codec that this OpenCV lacks; convert it to H.264"
    return "this is not a video, or of a kind that OpenCV cannot open"


def _index_of_mp4(path: Path) -> bytes | None:
    """The box `moov` of an MP4 file; None if it is not there as a whole."""
    length = path.stat().st_size
    with path.open("rb") as file:
        at = 0
        while at + 16 <= length:
            file.seek(at)
            header = file.read(16)
            size = int.from_bytes(header[:4])
            if size == 1:  # the size has 64 bits
                size = int.from_bytes(header[8:16])
            if size < 8 or at + size > length:
                return None
            if header[4:8] == b"moov":
                file.seek(at)
                return file.read(size)
            at += size
    return None


def _lacks(code: bytes) -> str:
    name = "".join(chr(c) if 32 < c < 127 else "?" for c in code)
    return f"OpenCV cannot open this video: it lacks the codec {name}, or the file is damaged; convert it to H.264"


def _jpeg_sizes(path: Path, capture: cv2.VideoCapture) -> Iterator[tuple[int, int] | None]:
    """The size of each frame of a Motion JPEG, from its own header; nothing for other codecs."""
    if _characters(capture.get(cv2.CAP_PROP_FOURCC)) not in _JPEG_CODECS:
        return
    packets = _opened(path, cv2.CAP_PROP_FORMAT, -1)
    while True:
        good, packet = packets.read() if packets.isOpened() else (False, None)
        if not good or packet is None:
            return
        yield _jpeg_size(packet.tobytes())


def _jpeg_size(data: bytes) -> tuple[int, int] | None:
    """Width and height from a JPEG's frame header."""
    at = 2
    while at + 9 <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            return int.from_bytes(data[at + 7 : at + 9]), int.from_bytes(data[at + 5 : at + 7])
        at += 2 + int.from_bytes(data[at + 2 : at + 4])
    return None
