"""The verb itself: sheet, boards, camera, reference poses, dataset."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from roundel.cli.ingest.board_photographs import Album, look_through, photographs_in
from roundel.cli.progress import progress
from roundel.cli.verbs.studies import find_study
from roundel.scenes.errors import NotComparableError, UsageError
from roundel.scenes.study.marker_section import KINDS

if TYPE_CHECKING:
    from roundel.datasets.ingest.photographs import Photograph
    from roundel.scenes.camera.model import Camera
    from roundel.scenes.markers.marker import Part, Sheet
    from roundel.validate.ingest.reference import Measured


def import_photographs(arguments: argparse.Namespace) -> int:
    """Make a dataset from photographs of a printed sheet."""
    from roundel.datasets.ingest.sheet import parts_of, scaled_marker, study_of_photographs
    from roundel.datasets.ingest.write import Import, check_free, write_import
    from roundel.scenes.blas_threads import one_blas_thread
    from roundel.scenes.world.sheets import sheet_of
    from roundel.validate.ingest.camera_file import camera_to_file

    out = Path(arguments.out)
    check_free(out)
    paths = photographs_in(arguments.photographs)
    marker = scaled_marker(_marker(arguments), arguments.ruler_mm / 100.0)
    sheet = sheet_of(marker)
    try:
        board, circles = parts_of(sheet)
    except ValueError as error:
        raise UsageError(f"--sheet {arguments.sheet}: {error}") from error
    given = _given_camera(arguments)
    with one_blas_thread():
        with progress("boards") as show:
            album = look_through(paths, sheet, board, circles, show)
        for name, reason in album.left_out.items():
            _warn(f"{name}: {reason}; left out")
        if not album.shown:
            raise NotComparableError(f"{arguments.photographs}: no photograph shows the {board.kind} of the sheet")
        measured = _measured(album, arguments, given)
        photos, left_out = _photographs(album, measured, sheet, board, circles)
    for name, reason in left_out.items():
        _warn(f"{name}: {reason}; left out")
    if not photos:
        raise NotComparableError(f"{arguments.photographs}: no photograph shows the whole circle")
    camera, calibrated = measured.fit.camera, given is None
    name = arguments.name or Path(arguments.photographs).resolve().name
    used = [album.shown[i].path.name for i in measured.kept] if calibrated else []
    manifest = write_import(
        out,
        Import(
            study_of_photographs(marker, camera, photos, sheet, name, arguments.licence),
            sheet,
            camera,
            camera_to_file(measured.fit, camera, board.kind, used),
            board.kind,
            calibrated,
            photos,
            {**album.left_out, **left_out},
        ),
    )
    _report(out, manifest, measured, calibrated, sum(photo.located for photo in album.shown))
    return 0


def _marker(arguments: argparse.Namespace) -> Any:
    """The section of the printed marker: of a study, or of a kind as `roundel marker` prints it."""
    from roundel.datasets.ingest.sheet import marker_of_study
    from roundel.scenes.study.study import load_study

    if arguments.sheet in KINDS:
        from roundel.render.printing.marker_layouts import marker_to_print, parse_set

        if arguments.group:
            raise UsageError("--group: a kind of marker has no groups; leave it out")
        return marker_to_print(arguments.sheet, arguments.diameter_m, parse_set(arguments.set or []))
    for option, value in (("--diameter-m", arguments.diameter_m), ("--set", arguments.set)):
        if value:
            raise UsageError(f"{option}: the study says what was printed; leave it out")
    return marker_of_study(load_study(find_study(arguments.sheet)), arguments.group)


def _given_camera(arguments: argparse.Namespace) -> tuple[Camera, Any] | None:
    """The camera of --camera, and its covariance."""
    import numpy as np

    from roundel.validate.ingest.camera_file import read_camera_covariance

    if arguments.camera is None:
        return None
    if arguments.k3:
        raise UsageError("--k3: the camera is given; leave it out")
    camera, covariance = read_camera_covariance(arguments.camera)
    if covariance is None:
        _warn(f"{arguments.camera}: has no covariance: the camera is taken as exact")
        covariance = np.zeros((4 + len(camera.distortion),) * 2)
    return camera, covariance


def _measured(album: Album, arguments: argparse.Namespace, given: tuple[Camera, Any] | None) -> Measured:
    from roundel.validate.ingest.reference import calibrated, posed

    size, boards = album.size_px(), [photo.board for photo in album.shown]
    if given is None:
        return calibrated(boards, size, 5 if arguments.k3 else 4)
    camera, covariance = given
    if size != (camera.width_px, camera.height_px):
        raise UsageError(
            f"{arguments.camera}: is for {camera.width_px}x{camera.height_px} px, the photographs have "
            f"{size[0]}x{size[1]}; calibrate with this camera"
        )
    return posed(boards, camera, covariance)


def _photographs(
    album: Album, measured: Measured, sheet: Sheet, board: Part, circles: list[Part]
) -> tuple[list[Photograph], dict[str, str]]:
    """Photographs with the poses of all parts, and why others have none, by name."""
    import numpy as np

    from roundel.datasets.ingest.photographs import Photograph
    from roundel.validate.ingest.reference import beside, whole_in_image

    fit, found = measured.fit, []
    left_out = {album.shown[i].path.name: reason for i, reason in measured.left_out.items()}
    each = [beside(fit.poses, fit.pose_covariance, board, part) for part in sheet.parts]
    poses, covariance = (np.stack([pair[k] for pair in each], axis=1) for k in (0, 1))
    for row, i in enumerate(measured.kept):
        photo, pose = album.shown[i], dict(zip([p.marker_id for p in sheet.parts], poses[row], strict=True))
        if not all(whole_in_image(pose[c.marker_id], float(c.radius_m or 0), fit.camera) for c in circles):
            left_out[photo.path.name] = "the circle is not whole in the picture"
            continue
        found.append(
            Photograph(
                photo.path.name,
                photo.load,
                photo.suffix,
                photo.bits,
                photo.curve,
                photo.exif.focal_35mm_mm,
                photo.exif.orientation,
                poses[row],
                covariance[row],
                len(photo.board.pixels),
                float(fit.sigma_px[row]),
                float(fit.rms_px[row]),
            )
        )
    return found, left_out


def _report(out: Path, manifest: dict[str, Any], measured: Measured, calibrated: bool, located: int) -> None:
    fit, reference = measured.fit, manifest["reference"]
    k, sigma = fit.camera.K, fit.covariance.diagonal() ** 0.5
    values = (k[0, 0], k[1, 1], k[0, 2], k[1, 2], *fit.camera.distortion)
    source = f"from {len(measured.kept)} boards" if calibrated else "as given"
    print(
        f"camera ({source}): "
        + ", ".join(
            f"{name} {value:.{5 if place > 3 else 2}f} ± {error:.{5 if place > 3 else 2}f}"
            for place, (name, value, error) in enumerate(zip(fit.parameters, values, sigma.tolist(), strict=True))
        )
    )
    if fit.widened > 1:
        print(
            "the photographs contradict each other by more than the noise of their corners (a bent sheet, a moving "
            f"camera or focus?): all standard deviations are widened {fit.widened:.1f} times"
        )
    own = reference["sigma"]
    print(
        f"{out}: {manifest['counts']['frames']} photographs, {len(reference['left_out'])} left out; the reference "
        f"poses are known to {own['normal_deg']:.3f} degrees and {1e3 * own['position_m']:.2f} mm "
        f"({own['position_pct']:.2f} % of the distance)"
    )
    if located:
        _warn(f"{located} photographs tell where they were taken (GPS): remove the position before you publish them")
    print(f"next: roundel solve {out} ESTIMATES, then roundel validate {out} ESTIMATES --out REPORT")


def _warn(line: str) -> None:
    print(f"roundel: warning: {line}", file=sys.stderr)
