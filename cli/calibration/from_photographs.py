"""Photographs of a board become a camera file and a page."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from roundel.cli.calibration.board_detection import BoardDetection, detect_boards, exclude_inconsistent
from roundel.cli.calibration.boards import Photographed, photographed_board
from roundel.cli.calibration.wrong_board import other_board
from roundel.cli.progress import progress
from roundel.scenes.errors import NotComparableError, UsageError

if TYPE_CHECKING:
    from roundel.validate.photo_calibration.record import BoardPhoto, PhotoCalibration


def calibrate_from_photographs(arguments: argparse.Namespace, camera: Path) -> list[str]:
    """Calibrate, and write the camera file and its page; returns lines for the terminal.

    The page is written, too, if no camera follows: it says what to photograph.

    Raises
    ------
    UsageError
        If the board is not described, or an argument does not go with photographs.
    NotComparableError
        If no camera follows.
    """
    from roundel.datasets.store.writing import write_file
    from roundel.scenes.camera.camera_file import camera_file_text
    from roundel.scenes.camera.response_curve import UNKNOWN, parse_curve
    from roundel.solver.photos.photo_inputs import find_photographs
    from roundel.validate.photo_calibration.page import calibration_page
    from roundel.validate.photo_calibration.summary import summary_lines

    if arguments.group:
        raise UsageError("--group: photographs have no groups; leave it out")
    board = photographed_board(arguments)
    if arguments.bend and board.layout is None:
        raise UsageError("--bend: is fitted to circle grids; a chessboard is taken as flat; leave it out")
    page = camera.with_suffix(".html") if arguments.page is None else Path(arguments.page)
    if page.is_dir():
        raise UsageError(f"{page}: is a folder; --page is the file to write")
    curve = None if arguments.curve is None else parse_curve(arguments.curve) or UNKNOWN
    sources = find_photographs(arguments.inputs)
    if arguments.views is not None:
        if arguments.views > len(sources):
            raise UsageError(f"{arguments.views} views are requested of {len(sources)} photographs; request fewer")
        sources = sources[: arguments.views]
    with progress("calibrate") as show:
        detections, size = exclude_inconsistent(detect_boards(sources, board, curve, show))
    found = _calibrated(board, detections, size, 5 if arguments.k3 else 4, arguments.bend)
    found = _upright(found, detections)
    if not found.shown and (hint := other_board(sources, board)):
        found = replace(found, problem=f"{found.problem} {hint}")
    for photo in found.photos:
        if photo.reason:
            print(f"roundel: {photo.name}: {photo.reason}", file=sys.stderr)
    if found.fitted is not None:
        write_file(camera, camera_file_text(found.camera_file(), camera).encode())
    write_file(page, calibration_page(found, camera.name))
    if found.fitted is None:
        raise NotComparableError(f"{found.problem}; {page} shows each photograph and what to take next")
    return [*summary_lines(found), f"page: {page}"]


def _calibrated(
    board: Photographed, detections: list[BoardDetection], size: tuple[int, int], coefficients: int, bend: int
) -> PhotoCalibration:
    from roundel.validate.photo_calibration.from_corners import calibrated_from_corners
    from roundel.validate.photo_calibration.record import BoardPhoto

    photos = [BoardPhoto(k.name, k.size_px, k.reason, k.pixels, k.points_m, picture=k.picture) for k in detections]
    if board.layout is None:
        return calibrated_from_corners(board.board, size, photos, coefficients)
    return _from_grids(board, detections, photos, size, coefficients, bend)


def _from_grids(
    board: Photographed,
    detections: list[BoardDetection],
    photos: list[BoardPhoto],
    size: tuple[int, int],
    coefficients: int,
    bend: int,
) -> PhotoCalibration:
    from roundel.scenes.camera.model import project
    from roundel.solver.calibration.calibrate_images import calibration_notes
    from roundel.solver.calibration.grid_calibration import MIN_VIEWS, calibrate_grids
    from roundel.validate.photo_calibration.from_corners import too_few
    from roundel.validate.photo_calibration.record import Fitted, PhotoCalibration

    assert board.layout is not None
    which = [i for i, one in enumerate(detections) if one.grid is not None and not one.reason]
    grids = [grid for i in which if (grid := detections[i].grid) is not None]
    if len(grids) < MIN_VIEWS:
        return PhotoCalibration(board.board, size, photos, None, too_few(board.board, len(grids), len(photos)))
    try:
        result = calibrate_grids(grids, board.layout, size, coefficients, bend)
    except NotComparableError as error:
        return PhotoCalibration(board.board, size, photos, None, str(error))
    kept = [which[view] for view in result.views]
    for i in set(which) - set(kept):
        photos[i] = replace(photos[i], reason="too few of its dots fit one flat grid: is the sheet bent, or blurred?")
    for number, (i, pose) in enumerate(zip(kept, result.poses, strict=True)):
        mine = result.dots.view == number
        points = np.column_stack([result.dots.centre_m[mine], np.zeros(np.count_nonzero(mine))])
        residual = result.residual_px[mine]
        pixels = project(result.camera, points @ pose[:3, :3].T + pose[:3, 3]) + residual
        photos[i] = replace(
            photos[i], pixels=pixels, points_m=points, residual_px=residual, camera_from_board=pose
        )  # fmt: skip
    count = 4 + len(result.camera.distortion)
    noise = float(np.sqrt(np.median(np.einsum("Nii->N", result.dots.shape_cov[:, :2, :2]) / 2)))
    about = {
        "dots": result.used,
        "left_out_dots": result.left_out,
        "diameter_m": result.diameter_m,
        "edge_px": result.edge_px,
        "bend_m": result.bend_m.tolist(),
        "chi_square": result.chi_square,
    }
    fitted = Fitted(
        result.camera,
        result.covariance[:count, :count],
        result.widened,
        noise * result.widened,
        about,
        tuple(calibration_notes(result, board.layout)),
    )
    return PhotoCalibration(board.board, size, photos, fitted)


def _upright(found: PhotoCalibration, detections: list[BoardDetection]) -> PhotoCalibration:
    """As most of the photographs are shown: those of a phone held upright make a camera that is higher than wide."""
    from roundel.scenes.camera.quarter_turns import TURNS

    counted = [one for one, photo in zip(detections, found.photos, strict=True) if photo.used]
    counted = counted or [one for one in detections if one.size_px == found.size_px and one.orientation in TURNS]
    if not counted:
        return found
    orientation = Counter(one.orientation for one in counted).most_common(1)[0][0]
    return found.turned(TURNS[orientation], orientation)
