"""`roundel browse`: a folder with a page of all frames, their true contours and, of a report, their scores.

The page runs from the disk, where a browser lets it load scripts and images but no other data: what it shows is in
scripts. The same dataset and report give the same bytes, because no file contains a time or a path.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.datasets.dataset import Dataset, open_dataset
from roundel.datasets.store.addresses import Address
from roundel.scenes.display_text import NAME_LIMIT, clean
from roundel.validate.browse.frames import described, image_suffix, shard_record
from roundel.validate.browse.page_folder import (
    ASSETS,
    DATA,
    DATA_START,
    IMAGES,
    INDEX,
    SCORES,
    THUMBS,
    check_page_folder,
    page_folder,
)
from roundel.validate.browse.scores import ReportScores
from roundel.validate.browse.thumbnails import thumbnail
from roundel.validate.metrics.rows import circle_keys
from roundel.validate.report.html import template
from roundel.validate.scores.summary import versions

# Images that are read and scaled at the same time; of a store, most of it is waiting.
_TOGETHER = 8


def browse_dataset(
    dataset_path: Address,
    out_path: str | Path,
    report_path: str | Path | None = None,
    copy_images: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> int:
    """Write the page.

    Parameters
    ----------
    dataset_path : path or str
    out_path : path
        The page's folder: a new one, or that of an earlier page, which is replaced.
    report_path : path, optional
        A report of the dataset, for its scores.
    copy_images : bool
        Also copy the images, for the larger view.
    progress : callable, optional
        Called with (frames done, total frames).

    Returns
    -------
    int
        Number of frames.

    Raises
    ------
    UsageError
        If there is no report at `report_path`, or `out_path` holds anything but an earlier page.
    DataError
        If the dataset or the report is damaged, or the page cannot be written.
    NotComparableError
        If the report is of another dataset.
    """
    out = Path(out_path)
    check_page_folder(out)
    dataset = open_dataset(dataset_path)
    report = None if report_path is None else ReportScores(report_path, dataset)
    with page_folder(out) as folder:
        circles = _write_frames(folder, dataset, report, copy_images, progress)
        if report is not None:
            (folder / SCORES).mkdir()
            for number, record in enumerate(report.records(circles)):
                script = f"ROUNDEL.scores[{number}] = {_json(record)};\n"
                (folder / SCORES / f"{number:03d}.js").write_text(script, encoding="ascii")
        _write_page(folder, dataset, report)
    return len(dataset)


def _write_frames(
    folder: Path,
    dataset: Dataset,
    report: ReportScores | None,
    copy_images: bool,
    progress: Callable[[int, int], None] | None,
) -> NDArray[np.void]:
    """Write data.js and the pictures, a shard at a time; returns the frame and marker of each row."""
    head = {
        "images": copy_images,
        **described(),
        **(report.described() if report else {"runs": [], "errors": []}),
        "scores": {},
        "shards": [],
    }
    (folder / THUMBS).mkdir()
    if copy_images:
        (folder / IMAGES).mkdir()
    circles, done = [], 0
    with (folder / DATA).open("x", encoding="ascii") as file:
        file.write(f"{DATA_START}{_json(head)};\n")
        for number in range(len(dataset.contents.parts)):
            shard = dataset.of_part(number)
            file.write(f"ROUNDEL.shards.push({_json(shard_record(shard))});\n")
            circles.append(circle_keys(shard.truth))
            for _ in _pictures(folder, shard, copy_images):
                done += 1
                if progress:
                    progress(done, len(dataset))
    return np.concatenate(circles)


def _pictures(folder: Path, shard: Dataset, copy_images: bool) -> Iterator[None]:
    """Write the thumbnail of each frame that has an image, and a copy of the image if asked for."""
    images, ids = shard.images, shard.images.frame_ids

    def write(i: int) -> None:
        suffix = image_suffix(shard, i)
        if suffix is None:
            return
        name = f"{ids[i]:06d}"
        (folder / THUMBS / f"{name}.jpg").write_bytes(thumbnail(images.image(i), images.top_dn(i)))
        if copy_images:
            (folder / IMAGES / f"{name}{suffix}").write_bytes(images.image_bytes(i))

    pool = ThreadPoolExecutor(_TOGETHER)
    try:
        yield from pool.map(write, range(len(ids)))
    finally:
        # An interrupted command does not wait for the rest of the shard.
        pool.shutdown(cancel_futures=True)


def _write_page(folder: Path, dataset: Dataset, report: ReportScores | None) -> None:
    manifest, here = dataset.manifest, resources.files("roundel.validate.browse")
    html = template("roundel.validate.browse", "index.html.j2").render(
        name=clean(str(manifest.get("name") or "dataset"), NAME_LIMIT),
        dataset_id=str(manifest["dataset_id"])[:12],
        frames=len(dataset),
        complete=dataset.images.complete,
        scripts=[name for name in ASSETS if name.endswith(".js")],
        scores=None if report is None else f"{SCORES}/{report.main:03d}.js",
        version=versions()["roundel"],
    )
    (folder / INDEX).write_text(html.strip() + "\n", encoding="utf-8")
    for name in ASSETS:
        (folder / name).write_bytes((here / name).read_bytes())


def _json(value: dict[str, Any]) -> str:
    """JSON in ASCII on one line, which is a JavaScript expression."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False)
