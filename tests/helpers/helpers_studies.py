"""Small studies for tests that render."""

import hashlib
from pathlib import Path
from typing import Any

from roundel.datasets.layout import files
from roundel.datasets.layout.shards import Shard
from roundel.datasets.progress import ShardProgress
from roundel.datasets.store.folder import Folder
from roundel.scenes.study.study import Study, load_study

SMALL = """\
schema: 1
name: small
seed: 3
camera: {width_px: 160, height_px: 120, focal_px: 320}
marker: {kind: disc, diameter_m: 0.08}
pose:
  distance_D: {uniform: [7, 9]}
  tilt_deg: {uniform: [10, 50]}
  azimuth_deg: {uniform: [-180, 180]}
  offset_x_px: {uniform: [-20, 20]}
light: {environment: 0.7, lamps: [{position_m: [-0.3, -0.5, 0.0], size_m: 0.2, radiance: 6}]}
render: {band_samples: 256}
frames: 4
"""


def small_study(folder: Path, *edits: tuple[str, str], name: str = "study.yaml") -> Study:
    """SMALL with some of its text replaced."""
    text = SMALL
    for old, new in edits:
        assert old in text, old
        text = text.replace(old, new, 1)
    path = folder / name
    path.write_text(text)
    return load_study(path)


def finished_frames(dataset: Path, study: Study) -> dict[int, dict[str, Any]]:
    """Journal lines of the frames of a small dataset that are done, finished or not."""
    return ShardProgress(Folder(dataset), Shard("", range(1000)), study.digest()).entries


def digests(dataset: Path) -> dict[str, str]:
    """sha256 of every file but timings.jsonl."""
    return {
        str(p.relative_to(dataset)): hashlib.sha256(p.read_bytes()).hexdigest()
        for p in sorted(dataset.rglob("*"))
        if p.is_file() and p.name != files.TIMINGS
    }
