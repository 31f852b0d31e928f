"""`roundel export`: a dataset in a format of others, with what of the truth the format cannot hold."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from roundel.datasets.card.card import PAGE, RECORD, card_json, card_of, card_page
from roundel.datasets.dataset import Dataset
from roundel.datasets.export import (
    bop,
    camera_files,
    coco,
    croissant,
    huggingface,
    sample,
    trajectories,
    webdataset,
    yolo,
)
from roundel.datasets.export.output import Output
from roundel.datasets.export.reading import ReadFrame
from roundel.datasets.stream.about import about_dataset
from roundel.datasets.stream.frames import CORNER_PX, THRESHOLD, Frame, frame_source
from roundel.datasets.stream.splits import Splits, split_by
from roundel.scenes.errors import UsageError

SCHEMA = 1

Write = Callable[[Iterator[Frame], Output, "Plan"], None]
Read = Callable[[Path], Iterator[ReadFrame]]


@dataclass(frozen=True)
class Plan:
    """What a writer is told: the number of frames of each split, and facts of the dataset."""

    counts: dict[str, int]
    about: dict[str, Any]

    @property
    def splits(self) -> tuple[str, ...]:
        """Names of the splits."""
        return tuple(self.counts)


@dataclass(frozen=True)
class Format:
    """A format.

    Attributes
    ----------
    title : str
        What it is, on a line.
    write : callable
    read : callable
        Gives its frames in Roundel's units and coordinates.
    left_out : tuple of str
        What of the truth it cannot hold.
    pixel_origin : {"centre", "corner", ""}
        Of the first pixel: where its coordinates count from; empty if it has none.
    length_unit : str
        Empty if it has no lengths.
    images : bool
        Whether it needs images.
    masks : bool
        Whether it says what is seen of a marker.
    """

    title: str
    write: Write
    read: Read
    left_out: tuple[str, ...]
    pixel_origin: str = ""
    length_unit: str = "m"
    images: bool = True
    masks: bool = False


def _camera_format(title: str, write: Callable[[Iterator[Frame], Output], None]) -> Format:
    return Format(
        title,
        lambda frames, out, plan: write(frames, out),
        lambda folder: iter([camera_files.read_camera(folder)]),
        camera_files.CAMERA_LEFT_OUT,
        "centre",
        "",
        images=False,
    )


FORMATS: dict[str, Format] = {
    "bop": Format(
        "BOP: scenes with poses, masks, depth and models",
        lambda frames, out, plan: bop.write_bop(frames, out, plan.splits),
        bop.read_bop,
        bop.LEFT_OUT,
        "centre",
        "mm",
        masks=True,
    ),
    "coco": Format(
        "COCO: boxes, run-length masks and keypoints",
        lambda frames, out, plan: coco.write_coco(frames, out, plan.splits, plan.about),
        coco.read_coco,
        coco.LEFT_OUT,
        "corner",
        masks=True,
    ),
    "yolo": Format(
        "YOLO: labels of keypoints and of outlines, data.yaml",
        lambda frames, out, plan: yolo.write_yolo(frames, out, plan.splits),
        yolo.read_yolo,
        yolo.LEFT_OUT,
        "corner",
        "",
        masks=True,
    ),
    "webdataset": Format(
        "WebDataset: shards of tar",
        lambda frames, out, plan: webdataset.write_webdataset(frames, out, plan.splits),
        webdataset.read_webdataset,
        sample.LEFT_OUT,
        "centre",
        masks=True,
    ),
    "huggingface": Format(
        "Hugging Face: Parquet with images, and a card",
        lambda frames, out, plan: huggingface.write_huggingface(frames, out, plan.counts, plan.about),
        huggingface.read_huggingface,
        sample.LEFT_OUT,
        "centre",
        masks=True,
    ),
    "croissant": Format(
        "Croissant 1.1: shards of images and tables, described with checksums",
        lambda frames, out, plan: croissant.write_croissant(frames, out, plan.splits, plan.about),
        croissant.read_croissant,
        croissant.LEFT_OUT,
        "centre",
    ),
    "colmap": Format(
        "COLMAP: a text model with cameras and poses",
        lambda frames, out, plan: camera_files.write_colmap(frames, out),
        camera_files.read_colmap,
        camera_files.COLMAP_LEFT_OUT,
        "corner",
    ),
    "kalibr": _camera_format("Kalibr: camchain.yaml", camera_files.write_kalibr),
    "ros": _camera_format("ROS: camera_info.yaml", camera_files.write_ros),
    "tum": Format(
        "TUM: trajectories of the camera in the frame of a marker",
        lambda frames, out, plan: trajectories.write_trajectories(frames, out, "tum"),
        trajectories.read_trajectories,
        trajectories.LEFT_OUT,
        images=False,
    ),
    "kitti": Format(
        "KITTI: the same as matrices",
        lambda frames, out, plan: trajectories.write_trajectories(frames, out, "kitti"),
        trajectories.read_trajectories,
        trajectories.LEFT_OUT,
        images=False,
    ),
}


def export_dataset(
    dataset: Dataset,
    out_path: str | Path,
    name: str,
    splits: Splits,
    groups: Sequence[str] | None = None,
    depth: bool = True,
    url: str = "",
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, int]:
    """Write a dataset in another format.

    Parameters
    ----------
    dataset : Dataset
    out_path : path
        A new folder.
    name : str
        Of `FORMATS`.
    splits : Splits
    groups : sequence of str, optional
        Only frames of these groups.
    depth : bool
        Whether depth is written, where the format has it.
    url : str
        Where the dataset is published, for formats that say so.
    progress : callable, optional
        Called with (frames done, total frames).

    Returns
    -------
    dict
        Number of frames of each split.

    Raises
    ------
    UsageError
        If the format is not known or cannot hold the dataset, or the folder is not new.
    DataError
        If the dataset is damaged, or a file cannot be written.
    NotComparableError
        If a mask is wanted that the dataset does not tell, or it cannot be split so.
    """
    if name not in FORMATS:
        raise UsageError(f"format {name!r}: give one of {', '.join(FORMATS)}")
    form = FORMATS[name]
    out = Output(Path(out_path))
    places = _places(dataset, form, groups)
    split_of = split_by(dataset, splits)
    counts = dict.fromkeys(splits.names, 0)
    for index in places:
        counts[split_of(index)] += 1
    source = frame_source(dataset, split_of, masks=form.masks, depth=depth)

    def frames() -> Iterator[Frame]:
        for done, index in enumerate(places, start=1):
            yield source(index)
            if progress:
                progress(done, len(places))

    with out:
        record = _record(dataset, name, form, splits, counts)
        about = {**about_dataset(dataset, counts, url), "identity": {**record, "groups": list(groups or ())}}
        form.write(frames(), out, Plan(counts, about))
        card = card_of(dataset, counts)
        out.write(RECORD, card_json(card))
        out.write(PAGE, card_page(card, dataset))
        out.finish(record)
    return counts


def _places(dataset: Dataset, form: Format, groups: Sequence[str] | None) -> Sequence[int]:
    """Positions of the frames that are written."""
    for group in groups or ():
        if group not in dataset.images.group_names:
            raise UsageError(f"group {group!r}: the dataset has {', '.join(dataset.images.group_names)}")
    of_frame = dataset.images.groups
    places = [i for i in range(len(of_frame)) if not groups or of_frame[i] in groups]
    modes = {dataset.images.mode(i) for i in places} if form.images else set()
    if "points" in modes:
        raise UsageError(
            f"{dataset.address}: has frames of points, without images; only kalibr, ros, tum and kitti take them"
        )
    return places


def _record(dataset: Dataset, name: str, form: Format, splits: Splits, counts: dict[str, int]) -> dict[str, Any]:
    """export.json, but for its files."""
    images = dataset.images
    record: dict[str, Any] = {
        "schema": SCHEMA,
        "tool": "roundel",
        "format": name,
        "dataset": {
            "name": dataset.manifest["name"],
            "dataset_id": images.dataset_id,
            "images_sha256": images.images_sha256,
            "licence": dataset.manifest["licence"],
            "complete": images.complete,
            "poses": "reference" if dataset.reference else "truth",
        },
        "frames": sum(counts.values()),
        "splits": {"by": splits.by, "seed": splits.seed, "fractions": list(splits.fractions), "frames": counts},
        "left_out": list(form.left_out),
    }
    if form.pixel_origin:
        offset = CORNER_PX if form.pixel_origin == "corner" else 0.0
        record["pixel_origin"] = {"of_the_first_pixel": form.pixel_origin, "added_to_roundel_px": offset}
    if form.length_unit:
        record["length_unit"] = form.length_unit
    if form.masks:
        record["mask_threshold"] = THRESHOLD
    return record
