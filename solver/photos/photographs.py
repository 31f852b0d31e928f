"""Photographs to poses: every file with the focal length that is known of it, as tables, as text, and as pictures."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Sequence
from pathlib import Path

from roundel.datasets.layout.files import check_no_dataset, write_file
from roundel.scenes.errors import DataError, RoundelError, UsageError
from roundel.solver.ambiguity.disambiguation import Knowledge, check_knowledge
from roundel.solver.estimates import ESTIMATES, NOT_FOUND, Estimate, write_estimates
from roundel.solver.intrinsics.specification import Intrinsics, assumed_camera_for, parse_intrinsics
from roundel.solver.intrinsics.uncertain_camera import AssumedCamera
from roundel.solver.methods.pose_estimate import estimate_of
from roundel.solver.methods.registry import check_methods
from roundel.solver.methods.roundel_fits import DEFAULT_METHOD, METHODS, fit_detection, look_at
from roundel.solver.photos.overlay import Drawn, draw_overlay
from roundel.solver.photos.photo_file import Photo, read_photo
from roundel.solver.photos.photo_report import PhotoResult, distance_label, readable

Progress = Callable[[int, int], None]

READABLE = "estimates.json"
OVERLAYS = "overlays"
_NO_CIRCLE = "no circle found"


def solve_photographs(
    paths: Sequence[str | Path],
    out_path: str | Path,
    diameter_m: float,
    methods: Sequence[str] = (DEFAULT_METHOD,),
    intrinsics: Sequence[str] | None = None,
    knowledge: Knowledge = None,
    linear: bool = False,
    progress: Progress | None = None,
) -> list[PhotoResult]:
    """Estimate the pose of every circle in photographs.

    A photograph that cannot be read, or has not what the intrinsics need, is a failed row with its reason; the others
    go on.

    Parameters
    ----------
    paths : sequence of path
        Image files; the position in this list is the `frame_id`.
    out_path : path
        Folder for `estimates.parquet`, `estimates.json` and `overlays/`.
    diameter_m : float
        Outer diameter of the printed circles.
    methods : sequence of str
        See `solve_dataset`; pictures show the first.
    intrinsics : sequence of str, optional
        See `parse_intrinsics`; pictures show the first. Left out: `exif` where the file has it, otherwise `default`.
    knowledge : str, Evidence, a sequence of them, or None
        See `choose`.
    linear : bool
        Whether pixel values are proportional to light, instead of behind the sRGB curve.
    progress : callable, optional
        Called with (photographs done, photographs in all).

    Returns
    -------
    list of PhotoResult
        One for each path.

    Raises
    ------
    UsageError
        If an argument is wrong, the folder is a dataset, or the intrinsics need a camera that no photograph has.
    DataError
        If the result cannot be written.
    """
    check_no_dataset(Path(out_path))
    methods = list(dict.fromkeys(methods))
    check_methods(methods)
    for name in methods:
        if name not in METHODS:
            raise UsageError(f"--method {name}: it works on datasets; photographs take {', '.join(METHODS)}")
    check_knowledge(knowledge)
    if not (math.isfinite(diameter_m) and diameter_m > 0):
        raise UsageError(f"the diameter must be a positive number of metres, not {diameter_m}")
    specs = None if intrinsics is None else [parse_intrinsics(text) for text in intrinsics]
    for spec in specs or []:
        if spec.kind in ("true", "scaled"):
            raise UsageError(f"--intrinsics {spec.label}: a photograph's camera is not known; use exif or default")
    out, names = Path(out_path), _overlay_names(paths)
    results: list[PhotoResult] = []
    for frame_id, path in enumerate(paths):
        if progress:
            progress(frame_id, len(paths))
        results.append(
            _solve_one(frame_id, Path(path), names[frame_id], out, diameter_m, methods, specs, knowledge, linear)
        )
    if progress:
        progress(len(paths), len(paths))
    write_estimates([e for result in results for e in result.estimates], out / ESTIMATES)
    write_file(out / READABLE, readable(results, diameter_m).encode())
    return results


def _overlay_names(paths: Sequence[str | Path]) -> list[str]:
    """A file name for each photograph's picture; equal ones are numbered, also where case makes no difference."""
    taken: set[str] = set()
    names = []
    for path in paths:
        stem, name, number = Path(path).stem, Path(path).stem, 2
        while name.lower() in taken:
            name, number = f"{stem}-{number}", number + 1
        taken.add(name.lower())
        names.append(f"{name}.png")
    return names


def _solve_one(
    frame_id: int,
    path: Path,
    overlay: str,
    out: Path,
    diameter_m: float,
    methods: list[str],
    specs: list[Intrinsics] | None,
    knowledge: Knowledge,
    linear: bool,
) -> PhotoResult:
    try:
        photo = read_photo(path, linear)
    except DataError as error:
        reason = str(error).removeprefix(f"{path}: ")
        labels = [spec.label for spec in specs] if specs else ["default"]
        rows = [Estimate(frame_id, NOT_FOUND, m, label, "failed", reason) for m in methods for label in labels]
        return PhotoResult(path.as_posix(), "failed", reason, estimates=rows)
    assumed, refused = _cameras(photo, specs)
    estimates, found = _estimates(frame_id, photo, assumed, diameter_m, methods, knowledge)
    estimates += [Estimate(frame_id, NOT_FOUND, m, label, "failed", r) for m in methods for label, r in refused.items()]
    reason = next(iter(refused.values()), "") or (_NO_CIRCLE if not found else "")
    status = "failed" if refused else "ok" if found else "no circle"
    file = f"{OVERLAYS}/{overlay}"
    write_file(out / file, _picture(photo, assumed, estimates, diameter_m, reason))
    return PhotoResult(
        path.as_posix(), status, reason, photo.width_px, photo.height_px, assumed, estimates, found, file
    )


def _cameras(photo: Photo, specs: list[Intrinsics] | None) -> tuple[dict[str, AssumedCamera], dict[str, str]]:
    """A camera for each label, and the reason for each label that has none."""
    assumed: dict[str, AssumedCamera] = {}
    refused: dict[str, str] = {}
    size = photo.width_px, photo.height_px
    for spec in specs or [parse_intrinsics("exif")]:
        try:
            assumed[spec.label] = assumed_camera_for(spec, None, *size, exif=photo.exif)
        except RoundelError as error:
            refused[spec.label] = str(error)
    if specs is None and not assumed:
        return {"default": assumed_camera_for(parse_intrinsics("default"), None, *size)}, {}
    return assumed, refused


def _estimates(
    frame_id: int,
    photo: Photo,
    assumed: dict[str, AssumedCamera],
    diameter_m: float,
    methods: list[str],
    knowledge: Knowledge,
) -> tuple[list[Estimate], int]:
    """The whole chain on one image, and the number of detections."""
    seen = look_at(photo.grey, photo.saturation_dn)
    detections = seen.detections if assumed else []
    out = []
    for method in methods:
        for label, one in assumed.items():
            for i, detection in enumerate(detections):
                fit = fit_detection(seen, detection, one.camera, method)
                key = (frame_id, i, method, label)
                out.append(estimate_of(fit, one, diameter_m, knowledge, key, detection, photo.grey))
            if not detections:
                out.append(Estimate(frame_id, NOT_FOUND, method, label, "failed", _NO_CIRCLE, camera=one.camera))
    return out, len(detections)


def _picture(
    photo: Photo, assumed: dict[str, AssumedCamera], estimates: list[Estimate], diameter_m: float, reason: str
) -> bytes:
    """The overlay of the first method and the first intrinsics, as a PNG."""
    from PIL import Image

    label = next(iter(assumed), None)
    shown = [
        e for e in estimates if e.detection_id != NOT_FOUND and (e.method, e.intrinsics) == (estimates[0].method, label)
    ]
    drawn = [Drawn(e, diameter_m, distance_label(e)) for e in shown]
    basis = f"Camera: {assumed[label].basis}." if label is not None else ""
    footer = f"{reason[:1].upper()}{reason[1:]}. {basis}" if reason else f"{basis} Marker: {1000 * diameter_m:g} mm."
    buffer = io.BytesIO()
    # Level 1: a photograph's noise does not compress, and 6 takes four times as long for 5 % less.
    Image.fromarray(draw_overlay(photo.picture, drawn, footer)).save(buffer, "PNG", compress_level=1)
    return buffer.getvalue()
