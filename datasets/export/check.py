"""An export held against its checksums, and against the dataset that it was made from: each frame is read back.

The clients of most formats validate next to nothing. What differs is told by its likely cause: half a pixel, another
unit, another order of axes.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.datasets.dataset import Dataset
from roundel.datasets.export.causes import (
    POSE_TOLERANCE,
    PX_TOLERANCE,
    why_axes,
    why_k,
    why_mask,
    why_order,
    why_px,
    why_unit,
)
from roundel.datasets.export.export import FORMATS, Format
from roundel.datasets.export.output import CHECKSUMS, MANIFEST
from roundel.datasets.export.reading import ReadFrame, ReadMarker
from roundel.datasets.store.records import record_of_document
from roundel.datasets.stream.frames import Frame, Marker, frame_source
from roundel.datasets.stream.splits import BY, Splits, split_by
from roundel.datasets.verify import Finding
from roundel.scenes.assets.files import inside
from roundel.scenes.camera.model import distorts
from roundel.scenes.errors import DataError, NotComparableError, first_line

Array = NDArray[np.float64]

# Half a level of 16-bit depth, at its coarser scale, and rounding.
_DEPTH_M = 0.0005 + 1e-6


def read_export(folder: Path) -> dict[str, Any]:
    """The manifest of an export.

    Raises
    ------
    DataError
        If there is none, it is damaged, or its format is not known.
    """
    try:
        record = record_of_document((folder / MANIFEST).read_bytes())
    except OSError as error:
        raise DataError(f"{folder}: not an export: it has no {MANIFEST}") from error
    except ValueError as error:
        raise DataError(f"{folder / MANIFEST}: is damaged: {error}; export the dataset again") from error
    if str(record.get("format")) not in FORMATS:
        raise DataError(f"{folder / MANIFEST}: format {record.get('format')!r:.80} is not known to this Roundel")
    if not isinstance(record.get("dataset"), dict):
        raise DataError(f"{folder / MANIFEST}: does not name its dataset; export the dataset again")
    return record


def check_files(folder: Path, record: dict[str, Any]) -> list[Finding]:
    """Files that are missing, were altered, or are not listed."""
    found: list[Finding] = []
    try:
        listed = (folder / CHECKSUMS).read_bytes()
    except OSError:
        return [Finding(CHECKSUMS, "is missing")]
    if hashlib.sha256(listed).hexdigest() != record.get("checksums_sha256"):
        found.append(Finding(CHECKSUMS, f"is not the list that {MANIFEST} was written with"))
    names = {MANIFEST, CHECKSUMS}
    for line in listed.decode(errors="replace").splitlines():
        digest, _, name = line.partition("  ")
        names.add(name)
        try:
            with inside(folder, name).open("rb") as file:
                same = hashlib.file_digest(file, "sha256").hexdigest() == digest
        except ValueError:
            found.append(Finding(CHECKSUMS, f"names a file that is not in the export: {name!r:.80}"))
            continue
        except OSError:
            found.append(Finding(name, "is missing"))
            continue
        if not same:
            found.append(Finding(name, "was altered: its checksum differs"))
    others = (p.relative_to(folder).as_posix() for p in sorted(folder.rglob("*")) if p.is_file())
    return [*found, *(Finding(name, "is not listed") for name in others if name not in names)]


# Numbers of an altered file may be anything.
@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def check_against(folder: Path, record: dict[str, Any], dataset: Dataset) -> list[Finding]:
    """Differences between an export and its dataset: cameras, poses, masks, boxes, keypoints, depth, images, splits.

    Raises
    ------
    NotComparableError
        If the export is of another dataset.
    DataError
        If a file is not as its format has it.
    """
    about = record["dataset"]
    if about.get("dataset_id") != dataset.images.dataset_id:
        raise NotComparableError(f"{folder}: is of dataset {about.get('dataset_id')!r:.14}, not of {dataset.address}")
    form = FORMATS[record["format"]]
    found: list[Finding] = []
    seen: set[int] = set()
    for read, frame in _pairs(folder, form, dataset, split_by(dataset, _splits_of(folder, record))):
        if frame is None:
            found.append(Finding(f"frame {read.frame_id}", "is not in the dataset"))
            continue
        for where, what in _differences(read, frame, record["format"]):
            found.append(Finding(f"frame {frame.frame_id}{where}", what))
        seen.add(frame.frame_id)
    if form.images and len(seen) != record.get("frames"):
        found.append(Finding(MANIFEST, f"says {record.get('frames')} frames, but {len(seen)} are there"))
    return found


def _splits_of(folder: Path, record: dict[str, Any]) -> Splits:
    splits = record.get("splits")
    match splits:
        case {"fractions": [_, _, _] as shares, "by": str(by), "seed": int(seed)}:
            train, val, test = shares
            if (
                by in BY
                and all(type(s) in (int, float) and 0 <= s <= 1 for s in shares)
                and abs(sum(shares) - 1) < 1e-9
            ):
                return Splits((train, val, test), by, seed)
    raise DataError(f"{folder / MANIFEST}: has no splits that can be made: {splits!r:.80}; export the dataset again")


def _pairs(
    folder: Path, form: Format, dataset: Dataset, split_of: Callable[[int], str]
) -> Iterator[tuple[ReadFrame, Frame | None]]:
    places = {frame_id: index for index, frame_id in enumerate(dataset.images.frame_ids)}
    source = frame_source(dataset, split_of, masks=form.masks)
    for read in _read(folder, form):
        # A camera file has the camera of all frames.
        index = 0 if read.frame_id is None else places.get(read.frame_id)
        yield read, None if index is None else source(index)


def _read(folder: Path, form: Format) -> Iterator[ReadFrame]:
    """What a format's reader gives; what it does not expect is an error of the file."""
    try:
        yield from form.read(folder)
    except (ValueError, KeyError, TypeError, IndexError, OSError) as error:
        raise DataError(f"{folder}: is not as {form.title.partition(':')[0]} has it: {first_line(error)}") from error


def _differences(read: ReadFrame, frame: Frame, name: str) -> Iterator[tuple[str, str]]:
    camera = frame.camera
    if read.split and read.split != frame.split:
        yield "", f"is in {read.split}, not in {frame.split}"
    if read.k is not None and not np.allclose(read.k, camera.K, rtol=0, atol=PX_TOLERANCE):
        yield "", f"the camera differs: {why_px(read.k[:2, 2] - camera.K[:2, 2]) or why_k(read.k, camera.K)}"
    mine = np.array(camera.distortion if distorts(camera) else ())
    if read.distortion is not None:
        length = max(len(mine), len(read.distortion))
        theirs, ours = (np.pad(np.array(v), (0, length - len(v))) for v in (read.distortion, mine))
        if not np.allclose(theirs, ours, rtol=0, atol=1e-12):
            yield "", "the distortion differs"
    if read.size_px is not None and read.size_px != (camera.width_px, camera.height_px):
        yield "", f"is {read.size_px[0]}x{read.size_px[1]} px, not {camera.width_px}x{camera.height_px}"
    if read.image is not None and read.image != frame.image_bytes:
        yield "", "the image is another one"
    if read.depth_m is not None and frame.depth_m is not None:
        depth_m = frame.depth_m.astype(np.float64)
        if read.depth_m.shape != depth_m.shape or np.abs(read.depth_m - depth_m).max() > _DEPTH_M:
            yield "", f"the depth differs{why_unit(read.depth_m.ravel(), depth_m.ravel())}"
    pairs = _matched(read, frame, name)
    if pairs is None:
        yield "", f"has {len(read.markers)} markers, not {len(frame.markers)}"
        return
    for got, marker in pairs:
        for what in _marker_differences(got, marker):
            yield f", marker {marker.marker_id}", what


def _matched(read: ReadFrame, frame: Frame, name: str) -> list[tuple[ReadMarker, Marker]] | None:
    """Markers of both, by their ids where the format has them, else by their order; None if they are not the same."""
    if name == "colmap":
        return list(zip(read.markers, frame.markers[:1], strict=True)) if frame.markers else []
    if name in ("tum", "kitti"):
        known = {m.marker_id: m for m in frame.markers}
        pairs = [(m, known[m.marker_id]) for m in read.markers if m.marker_id in known]
        return pairs if len(pairs) == len(read.markers) else None
    if name in ("kalibr", "ros"):
        return []
    ours = frame.markers if name not in ("coco", "yolo") else [m for m in frame.markers if m.box_px is not None]
    if len(ours) != len(read.markers):
        return None
    if all(m.marker_id is None for m in read.markers):
        return list(zip(read.markers, ours, strict=True))
    known = {m.marker_id: m for m in ours}
    if {m.marker_id for m in read.markers} != set(known):
        return None
    return [(m, known[m.marker_id]) for m in read.markers if m.marker_id is not None]


def _marker_differences(got: ReadMarker, marker: Marker) -> Iterator[str]:
    pose = marker.camera_from_marker
    if got.pose is not None:
        distance = float(np.linalg.norm(pose[:3, 3]))
        if not np.allclose(got.pose[:3, :3], pose[:3, :3], rtol=0, atol=POSE_TOLERANCE):
            yield f"the rotation differs{why_axes(got.pose[:3, :3], pose[:3, :3])}"
        if not np.allclose(got.pose[:3, 3], pose[:3, 3], rtol=0, atol=POSE_TOLERANCE * distance):
            unit = why_unit(got.pose[:3, 3], pose[:3, 3])
            yield f"the position differs{unit or why_order(got.pose[:3, 3], pose[:3, 3])}"
    if got.diameter_m is not None and abs(got.diameter_m - marker.diameter_m) > 1e-9:
        yield f"the diameter differs{why_unit(np.array([got.diameter_m]), np.array([marker.diameter_m]))}"
    if got.category is not None and got.category != marker.category:
        yield f"is called {got.category!r:.80}, not {marker.category!r}"
    for what, mine, theirs in (
        ("full mask", got.full_mask, marker.full_mask),
        ("visible mask", got.visible_mask, None if got.visible_mask is None else marker.visible_mask),
    ):
        if mine is not None and theirs is not None:
            if mine.shape != theirs.shape:
                yield f"the {what} has another size"
            elif not np.array_equal(mine, theirs):
                yield f"the {what} differs in {int(np.sum(mine != theirs))} pixels{why_mask(mine, theirs)}"
    if got.box_px is not None and marker.box_px is not None:
        yield from _different_px("box", np.reshape(got.box_px, (2, 2)), np.reshape(marker.box_px, (2, 2)))
    if got.keypoints_px is not None:
        ours = np.where(marker.keypoints_in_image[:, None], marker.keypoints_px, np.nan)
        yield from _different_px("keypoints", got.keypoints_px, ours)
    if got.outline_px is not None:
        yield from _different_outline(got.outline_px, marker)


def _different_px(what: str, got: Array, ours: Array) -> Iterator[str]:
    both = np.isfinite(got).all(axis=1) & np.isfinite(ours).all(axis=1)
    if not np.array_equal(np.isfinite(got), np.isfinite(ours)):
        yield f"other {what} are in the image"
    off = got[both] - ours[both]
    if both.any() and np.abs(off).max() > PX_TOLERANCE:
        yield f"the {what} differ by up to {np.abs(off).max():.3g} px{_colon(why_px(np.median(off, axis=0)))}"


def _different_outline(got: Array, marker: Marker) -> Iterator[str]:
    """The outline's corners lie on the outline, but for those cut by the image's border."""
    size = np.array([marker.camera.width_px, marker.camera.height_px])
    inside = np.all((got > -0.5 + 1e-9) & (got < size - 0.5 - 1e-9), axis=1)
    if not inside.any():
        return
    step = max(1, len(marker.outline_px) // len(got))
    ours = marker.outline_px[::step]
    if len(ours) != len(got):
        yield "the outline has another number of corners"
    elif np.abs(off := (got - ours)[inside]).max() > PX_TOLERANCE:
        yield f"the outline differs by up to {np.abs(off).max():.3g} px{_colon(why_px(np.median(off, axis=0)))}"


def _colon(text: str) -> str:
    return f": {text}" if text else ""
