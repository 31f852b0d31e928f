"""WebDataset: shards of tar, each frame an image and a JSON object with the same key.

Source: https://github.com/webdataset/webdataset. The shards are USTAR with neither times nor owners: the same frames
give the same bytes.
"""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from roundel.datasets.export.output import Output, json_bytes
from roundel.datasets.export.reading import ReadFrame
from roundel.datasets.export.sample import read_sample, sample_of
from roundel.datasets.stream.frames import Frame
from roundel.scenes.errors import DataError, first_line

_SHARD_FRAMES = 1000


class TarShards:
    """Tar files of a fixed number of frames, written one after another; the last ends with the block."""

    def __init__(self, out: Output, prefix: str) -> None:
        self._out, self._prefix, self._stack = out, prefix, ExitStack()
        self._frames = 0
        self.names: list[str] = []
        self._tar: tarfile.TarFile | None = None

    def __enter__(self) -> TarShards:
        return self

    def __exit__(self, *error: Any) -> None:
        self._stack.__exit__(*error)

    def next_frame(self) -> None:
        """Begin a frame; a full shard ends before it."""
        if self._frames % _SHARD_FRAMES == 0:
            self._stack.close()
            name = f"{self._prefix}-{len(self.names):06d}.tar"
            self.names.append(name)
            file = self._stack.enter_context(self._out.open(name))
            self._tar = self._stack.enter_context(
                tarfile.open(fileobj=file, mode="w|", format=tarfile.USTAR_FORMAT)  # noqa: SIM115
            )
        self._frames += 1

    def add(self, name: str, data: bytes) -> None:
        """Add a file of the frame."""
        assert self._tar is not None, "next_frame comes first"
        info = tarfile.TarInfo(name)
        info.size, info.mode = len(data), 0o444
        self._tar.addfile(info, io.BytesIO(data))


def write_webdataset(frames: Iterator[Frame], out: Output, splits: tuple[str, ...]) -> None:
    """Write frames as `SPLIT-NNNNNN.tar`."""
    with ExitStack() as stack:
        shards = {split: stack.enter_context(TarShards(out, split)) for split in splits}
        for frame in frames:
            shard, key = shards[frame.split], f"{frame.frame_id:06d}"
            shard.next_frame()
            shard.add(f"{key}{frame.suffix}", frame.image_bytes)
            shard.add(f"{key}.json", json_bytes(sample_of(frame)))


def read_webdataset(folder: Path) -> Iterator[ReadFrame]:
    """The frames of an export's shards.

    Raises
    ------
    DataError
        If a shard is damaged, or a frame lacks its image or its object.
    """
    for path in sorted(folder.glob("*.tar")):
        split, found = path.name.partition("-")[0], dict[str, dict[str, bytes]]()
        try:
            with tarfile.open(path) as tar:
                for member in tar:
                    key, _, suffix = member.name.partition(".")
                    file = tar.extractfile(member)
                    if file is None or suffix in found.get(key, {}):
                        raise DataError(f"{path}: {member.name}: is no file, or is there twice")
                    found.setdefault(key, {})[suffix] = file.read()
        except (tarfile.TarError, OSError) as error:
            raise DataError(f"{path}: cannot be read: {first_line(error)}") from error
        for key, files in found.items():
            image = next((data for suffix, data in files.items() if suffix in ("png", "jpg")), None)
            if image is None or "json" not in files:
                raise DataError(f"{path}: {key}: lacks its image or its json")
            try:
                yield read_sample(json.loads(files["json"]), split, image)
            except (KeyError, ValueError, TypeError) as error:
                what = f"{type(error).__name__} at {first_line(error)}"
                raise DataError(f"{path}: {key}.json: is damaged: {what}") from error
