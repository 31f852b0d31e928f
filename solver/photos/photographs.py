"""Solve photographs: each with its own focal length, into tables, a readable record and pictures."""

from __future__ import annotations

import io
import math
import pickle
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from roundel.datasets.layout.files import check_no_dataset
from roundel.datasets.store.writing import write_file
from roundel.datasets.worker_pool import Lost, in_order
from roundel.scenes.camera.response_curve import UNKNOWN, ResponseCurve, parse_curve
from roundel.scenes.errors import DataError, RoundelError, UsageError
from roundel.solver.ambiguity.disambiguation import Knowledge, check_knowledge
from roundel.solver.estimates import ESTIMATES, NOT_FOUND, Estimate, write_estimates
from roundel.solver.intrinsics.exif import NoFocal, focal_of_exif
from roundel.solver.intrinsics.specification import Intrinsics, parse_intrinsics, uncertain_camera_for
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera
from roundel.solver.methods.plugin import Finder, View
from roundel.solver.methods.registry import absolute_names, load_methods
from roundel.solver.methods.roundel_fits import DEFAULT_METHOD
from roundel.solver.methods.solve_image import NO_CIRCLE, SolverInput, solve_image
from roundel.solver.methods.worker_start import after_warm_up, one_opencv_thread, pickled
from roundel.solver.photos.overlay import Drawn, draw_overlay
from roundel.solver.photos.photo_file import Photo, read_photo
from roundel.solver.photos.photo_inputs import PhotoInput, find_photographs
from roundel.solver.photos.photo_report import PhotoResult, caveat_lines, distance_label, readable, shown_estimates
from roundel.solver.photos.photo_table import photo_table

Progress = Callable[[int, int], None]

READABLE = "estimates.json"
TABLE = "estimates.csv"
OVERLAYS = "overlays"


def solve_photographs(
    paths: Sequence[str | Path],
    out_path: str | Path,
    diameter_m: float,
    methods: Sequence[str] = (DEFAULT_METHOD,),
    intrinsics: Sequence[str] | None = None,
    knowledge: Knowledge = None,
    curve: ResponseCurve | str | None = None,
    progress: Progress | None = None,
    jobs: int = 1,
) -> list[PhotoResult]:
    """Estimate the pose of every circle in photographs.

    A photograph that cannot be read, or lacks data for the intrinsics, gives a failed row with its reason; the others
    are still solved.

    Parameters
    ----------
    paths : sequence of path
        Image files, folders of them, or patterns such as `shots/*.jpg`; each page of a TIFF is a photograph. The
        position among all photographs is the `frame_id`; see `find_photographs`.
    out_path : path
        Folder for `estimates.parquet`, `estimates.json`, `estimates.csv` and `overlays/`.
    diameter_m : float
        Outer diameter of the printed circles.
    methods : sequence of str
        See `solve_dataset`; pictures show the first. Third-party methods get the displayed picture: upright, 8-bit RGB.
    intrinsics : sequence of str, optional
        See `parse_intrinsics`; pictures show the first. Default: `exif` if the file has it, otherwise `default`.
    knowledge : str, Evidence, a sequence of them, or None
        See `choose`.
    curve : str or ResponseCurve, optional
        `linear`, `srgb`, `gamma:2.2`, or `estimate`: from the edges of the circles, as in `locate`. Default: what the
        file says, see `read_photo`.
    progress : callable, optional
        Called with (photographs done, total photographs).
    jobs : int
        Number of processes. The results do not depend on it; the pictures are written as they come.

    Returns
    -------
    list of PhotoResult
        One for each photograph.

    Raises
    ------
    UsageError
        If an argument is wrong (such as a curve that does not exist, or a folder without photographs), the folder is a
        dataset, or the intrinsics need a camera that no photograph has.
    DataError
        If the result cannot be written, or a process died.
    """
    check_no_dataset(Path(out_path))
    loaded = load_methods(methods)
    check_knowledge(knowledge)
    if not (math.isfinite(diameter_m) and diameter_m > 0):
        raise UsageError(f"the diameter must be a positive number of metres, not {diameter_m}")
    asked = curve if isinstance(curve, ResponseCurve) or curve is None else parse_curve(curve) or UNKNOWN
    specs = None if intrinsics is None else [parse_intrinsics(text) for text in intrinsics]
    for spec in specs or []:
        if spec.kind in ("true", "scaled"):
            raise UsageError(f"--intrinsics {spec.label}: a photograph's camera is not known; use exif or default")
    out = Path(out_path)
    found = find_photographs(paths)
    names = zip(found, _overlay_names(found), strict=True)
    photographs = [(i, photo, name) for i, (photo, name) in enumerate(names)]
    run = _Run(out, diameter_m, loaded, tuple(absolute_names(methods)), specs, knowledge, asked)
    results: list[PhotoResult] = []
    with closing(_solved(run, photographs, jobs)) as solved:
        for result in solved:
            if progress:
                progress(len(results), len(found))
            results.append(result)
    if progress:
        progress(len(found), len(found))
    write_estimates([e for result in results for e in result.estimates], out / ESTIMATES)
    write_file(out / READABLE, readable(results, diameter_m).encode())
    write_file(out / TABLE, photo_table(results).encode())
    return results


def _overlay_names(photographs: Sequence[PhotoInput]) -> list[str]:
    """A file name for each photograph's picture; duplicates are numbered, also if they only differ in case."""
    taken: set[str] = set()
    names = []
    for photo in photographs:
        stem, name, number = photo.stem, photo.stem, 2
        while name.lower() in taken:
            name, number = f"{stem}-{number}", number + 1
        taken.add(name.lower())
        names.append(f"{name}.png")
    return names


@dataclass(frozen=True)
class _Run:
    """What all photographs share."""

    out: Path
    diameter_m: float
    methods: Mapping[str, Finder | None]
    asked: tuple[str, ...]  # the methods as arguments: names, or files
    specs: list[Intrinsics] | None
    knowledge: Knowledge
    curve: ResponseCurve | None


# Position, photograph, and file name of the picture.
_Photograph = tuple[int, PhotoInput, str]


def _solved(run: _Run, photographs: list[_Photograph], jobs: int) -> Generator[PhotoResult, None, None]:
    jobs = min(jobs, len(photographs))
    if jobs <= 1:
        yield from (_solve_one(run, photograph) for photograph in photographs)
        return
    shared = pickled((run.out, run.diameter_m, run.specs, run.knowledge, run.curve))
    died = "the solving processes died as they started; free some memory, or use fewer --jobs"
    for result in in_order(jobs, _work, after_warm_up(photographs), _start_worker, (shared, run.asked), died):
        if isinstance(result, Lost):
            raise DataError(f"{result.item[1].name}: {result}; run the command again without it")
        yield result


_worker: list[_Run] = []


def _start_worker(shared: bytes, methods: tuple[str, ...]) -> None:
    one_opencv_thread()
    out, diameter_m, specs, knowledge, curve = pickle.loads(shared)
    _worker.append(_Run(out, diameter_m, load_methods(methods), methods, specs, knowledge, curve))


def _work(photograph: _Photograph) -> PhotoResult:
    return _solve_one(_worker[0], photograph)


def _solve_one(run: _Run, photograph: _Photograph) -> PhotoResult:
    frame_id, source, overlay = photograph
    diameter_m, specs = run.diameter_m, run.specs
    try:
        photo = read_photo(source.path, run.curve, source.page)
    except DataError as error:
        reason = str(error).removeprefix(f"{source.path}: ")
        labels = [spec.label for spec in specs] if specs else ["default"]
        rows = [Estimate(frame_id, NOT_FOUND, m, label, "failed", reason) for m in run.methods for label in labels]
        return PhotoResult(source.name, "failed", reason, estimates=rows)
    cameras, refused, exif_problem = _cameras(photo, specs)

    def view(given: UncertainCamera) -> View:
        picture, curve = photo.picture.copy(), photo.photometry.curve
        return View(picture, given.camera, diameter_m, curve=curve, focal_sigma=given.focal_sigma)

    linearise = None if photo.photometry.curve.known else photo.grey_by
    about = photo.photometry, linearise
    given = SolverInput(diameter_m, cameras, photo.grey, photo.saturation_dn, *about, view=view, frame_id=frame_id)
    solved = solve_image(given, run.methods, run.knowledge)
    rows = [Estimate(frame_id, NOT_FOUND, m, label, "failed", r) for m in run.methods for label, r in refused.items()]
    estimates, found = [*solved.estimates, *rows], solved.detections
    reason = next(iter(refused.values()), "") or ("" if found else _why_nothing(solved.estimates))
    status = "failed" if refused else "ok" if found else "no circle"
    file = f"{OVERLAYS}/{overlay}"
    size = photo.width_px, photo.height_px
    result = PhotoResult(source.name, status, reason, *size, cameras, estimates, found, file, exif_problem)
    write_file(run.out / file, _picture(photo, result, diameter_m))
    return result


def _why_nothing(estimates: list[Estimate]) -> str:
    """The reason of the first method, or the error of a third-party method."""
    return estimates[0].reason if estimates else NO_CIRCLE


def _cameras(photo: Photo, specs: list[Intrinsics] | None) -> tuple[dict[str, UncertainCamera], dict[str, str], str]:
    """A camera for each label, the reason for each label that has none, and why EXIF was not used by default."""
    size = photo.width_px, photo.height_px
    if specs is None:
        focal = focal_of_exif(photo.exif, *size)
        label, problem = ("default", focal.reason) if isinstance(focal, NoFocal) else ("exif", "")
        return {label: uncertain_camera_for(parse_intrinsics(label), None, *size, exif=photo.exif)}, {}, problem
    cameras: dict[str, UncertainCamera] = {}
    refused: dict[str, str] = {}
    for spec in specs:
        try:
            cameras[spec.label] = uncertain_camera_for(spec, None, *size, exif=photo.exif)
        except RoundelError as error:
            refused[spec.label] = str(error)
    return cameras, refused, ""


def _picture(photo: Photo, result: PhotoResult, diameter_m: float) -> bytes:
    """The overlay of the first method and the first intrinsics, as a PNG."""
    from PIL import Image

    drawn = [Drawn(e, diameter_m, distance_label(e)) for e in shown_estimates(result)]
    camera, reason = next(iter(result.cameras.values()), None), result.reason
    problem = f"; {result.exif_problem}" if result.exif_problem else ""
    basis = f"Camera: {camera.basis}{problem}." if camera is not None else ""
    footer = f"{reason[:1].upper()}{reason[1:]}. {basis}" if reason else f"{basis} Marker: {1000 * diameter_m:g} mm."
    caveats = caveat_lines(result)
    if caveats:
        footer += f" Caveats: {'; '.join(caveats)}."
    buffer = io.BytesIO()
    # Level 1: a photograph's noise does not compress, and level 6 takes four times as long for 5 % less.
    Image.fromarray(draw_overlay(photo.picture, drawn, footer)).save(buffer, "PNG", compress_level=1)
    return buffer.getvalue()
