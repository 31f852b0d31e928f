"""The verb `calibrate`, and a study's own calibrations: chessboards by OpenCV, circle grids by Roundel."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from roundel.cli.progress import progress
from roundel.cli.verbs.photos import are_photographs, is_dataset
from roundel.scenes.errors import UsageError

if TYPE_CHECKING:
    from roundel.datasets.dataset import Dataset
    from roundel.solver.calibration.calibrate_images import GridViews

CHESSBOARD, CIRCLE_GRID = "chessboard", "circle_grid"


def calibrate(arguments: argparse.Namespace) -> int:
    """Calibrate from a group of boards in a dataset, or from photographs of a board."""
    camera = Path(arguments.camera)
    if camera.is_dir():
        raise UsageError(f"{camera}: is a folder; the last argument is the camera file to write")
    given = [name for name in _PRINTED if getattr(arguments, name)]
    # A folder that is no dataset was meant as one of photographs, even if it has none.
    if are_photographs(arguments.inputs) or (given and not is_dataset(arguments.inputs[0])):
        from roundel.cli.calibration.from_photographs import calibrate_from_photographs

        lines = calibrate_from_photographs(arguments, camera)
    else:
        if given:
            raise UsageError(
                f"--{given[0].replace('_', '-')}: goes with photographs; a dataset records its board; leave it out"
            )
        lines = _from_dataset(arguments.inputs[0], camera, arguments)
    print("\n".join(lines))
    print(f"camera: {camera}")
    return 0


_PRINTED = ("board", "set", "grid", "spacing_m", "diameter_m", "asymmetric", "curve", "page")


@dataclass(frozen=True)
class _Fit:
    """What is fitted: the number of distortion coefficients, and the order of the board's bend."""

    coefficients: int = 4
    bend: int = 0

    @staticmethod
    def of(arguments: argparse.Namespace) -> _Fit:
        return _Fit(5 if arguments.k3 else 4, arguments.bend)


def _write_grid(
    views: GridViews, camera: Path, fit: _Fit, dataset: Dataset | None = None, group: str | None = None
) -> list[str]:
    """Calibrate from a grid's views and write the camera file; returns lines for the terminal."""
    from roundel.datasets.store.writing import write_file
    from roundel.scenes.camera.camera_file import camera_file_text
    from roundel.solver.calibration.calibrate_images import calibration_lines, calibration_to_json
    from roundel.validate.calibration.camera_errors import error_lines, errors_of_frames

    calibration = views.calibrate(fit.coefficients, fit.bend)
    dataset_id = None if dataset is None else str(dataset.manifest["dataset_id"])
    record = calibration_to_json(calibration, views, dataset_id, group)
    write_file(camera, camera_file_text(record, camera).encode())
    lines = calibration_lines(calibration, views)
    if dataset is None:
        return lines
    frames = {views.frame_ids[i] for i in calibration.views}
    return [*lines, *error_lines(errors_of_frames(dataset, calibration.camera, frames))]


def _from_dataset(path: str, camera: Path, arguments: argparse.Namespace) -> list[str]:
    from roundel.datasets.dataset import open_dataset
    from roundel.solver.calibration.calibrate_images import grids_of_dataset
    from roundel.validate.calibration.camera_errors import calibrate_dataset, calibration_lines

    dataset, fit = open_dataset(path), _Fit.of(arguments)
    kind, group = _board_group(dataset, arguments.group)
    if kind == CHESSBOARD:
        if fit.bend:
            raise UsageError("--bend: OpenCV calibrates from chessboards, and takes them as flat; leave it out")
        return calibration_lines(calibrate_dataset(path, camera, group, arguments.views, fit.coefficients))
    with progress("calibrate") as show:
        views = grids_of_dataset(dataset.images, group, show).first(arguments.views)
    return _write_grid(views, camera, fit, dataset, group)


def _board_group(dataset: Dataset, asked: str | None) -> tuple[str, str | None]:
    """The kind of board to calibrate from, and its group: the given one, else the first that shows only boards."""
    from roundel.validate.calibration.opencv import calibration_group

    images = dataset.images
    groups = images.groups
    if asked is not None:
        group = calibration_group(images, asked)
        kinds = {m["kind"] for i, name in enumerate(groups) if name == group for m in images.markers(i)}
        return (CIRCLE_GRID if CIRCLE_GRID in kinds and CHESSBOARD not in kinds else CHESSBOARD), group
    found = {kind: calibration_group(images, None, kind) for kind in (CHESSBOARD, CIRCLE_GRID)}
    first = [(groups.index(group), kind) for kind, group in found.items() if group is not None]
    kind = min(first)[1] if first else CHESSBOARD
    return kind, found[kind]


def calibrate_of_study(study: Any, out: Path) -> tuple[list[str], Path, dict[str, Path]]:
    """The camera files that a study's intrinsics need, from its rendered dataset in `out`.

    Returns
    -------
    lines : list of str
        For the terminal.
    camera : Path
        From all views.
    files : dict
        Camera file of each of the study's labels.
    """
    from roundel.datasets.dataset import open_dataset
    from roundel.scenes.camera.intrinsics_label import IntrinsicsLabel
    from roundel.solver.calibration.calibrate_images import grids_of_dataset
    from roundel.validate.calibration.camera_errors import calibration_lines
    from roundel.validate.calibration.study_calibrations import calibrate_study

    dataset = open_dataset(out / "dataset")
    kind, group = _board_group(dataset, study.solve.calibrate_from)
    camera, folder = out / f"{kind}.json", out / "cameras"
    if kind == CHESSBOARD:
        records, files = calibrate_study(out / "dataset", study.solve, camera, folder)
        return [line for record in records for line in calibration_lines(record)], camera, files
    with progress("calibrate") as show:
        views = grids_of_dataset(dataset.images, group, show)
    lines, files = _write_grid(views, camera, _Fit(), dataset, group), {"calibrated": camera}
    for label in study.solve.intrinsics:
        count = IntrinsicsLabel.of(label).views
        if count is not None:
            files[label] = folder / f"{count}.json"
            lines += _write_grid(views.first(count), files[label], _Fit(), dataset, group)
    return lines, camera, files
