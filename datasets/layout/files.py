"""Names of the files of a dataset."""

from __future__ import annotations

from pathlib import Path

from roundel.scenes.errors import UsageError

MANIFEST = "manifest.json"
STUDY = "study.yaml"
TRUTH = "truth.parquet"
TRUTH_CSV = "truth.csv"
CAMERAS = "cameras.json"
POINTS = "points.parquet"
ROWS = "rows.parquet"
JOURNAL = "journal.jsonl"
TIMINGS = "timings.jsonl"
SHARD = "shard.json"
# Of imported photographs: where the poses come from, and the camera with its covariance.
REFERENCE = "reference.parquet"
CAMERA = "camera.json"
IMAGES = "images"
RADIANCE = "radiance"
MASKS = "masks"
# Folders with the files of frames; all else in a shard are tables and records.
OF_FRAMES = (IMAGES, RADIANCE, MASKS)

# That of the longest study that is read.
MOST_STUDY_BYTES = 16 << 20


def image_name(frame_id: int, suffix: str = ".png") -> str:
    """Path of a frame's image within its shard; `suffix` is .png or .jpg."""
    return f"{IMAGES}/{frame_id:06d}{suffix}"


def radiance_name(frame_id: int) -> str:
    """Path of a frame's radiance within its shard."""
    return f"{RADIANCE}/{frame_id:06d}.exr"


def masks_name(frame_id: int) -> str:
    """Path of a frame's depth and coverage within its shard, where they are kept without the radiance."""
    return f"{MASKS}/{frame_id:06d}.exr"


def is_of_a_frame(name: str) -> bool:
    """Whether a file within a shard belongs to a single frame: it is no table and no record."""
    return name.startswith(tuple(f"{folder}/" for folder in OF_FRAMES))


def check_no_dataset(out: Path) -> None:
    """Refuse a results folder that holds a dataset, because some file names would collide.

    Raises
    ------
    UsageError
        If the folder holds a dataset.
    """
    if any((out / name).is_file() for name in (MANIFEST, JOURNAL, CAMERAS)):
        raise UsageError(f"{out}: is a dataset; name another folder for the results")
