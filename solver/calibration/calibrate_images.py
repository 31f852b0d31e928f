"""Calibration from images of a circle grid: arrays, photographs, or the frames of a dataset."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.datasets.layout.images import Images
from roundel.scenes.blas_threads import one_blas_thread
from roundel.scenes.camera.model import camera_to_json
from roundel.scenes.camera.response_curve import UNKNOWN, ResponseCurve, parse_curve
from roundel.scenes.errors import NotComparableError, UsageError
from roundel.solver.calibration.grid_calibration import GridCalibration, calibrate_grids
from roundel.solver.calibration.grid_image import GridImage, find_grid
from roundel.solver.calibration.grid_layout import GridLayout, layout_of, layout_problem
from roundel.solver.photometry.frame_levels import Levels, frame_levels
from roundel.solver.photometry.image_levels import averaged_rounding, grey_levels
from roundel.solver.photometry.photometry import Photometry, level_step
from roundel.solver.photos.photo_file import as_stored, read_photo
from roundel.solver.photos.photo_inputs import PhotoInput, find_photographs

Progress = Callable[[int, int], None]

KIND = "circle_grid"
# Ink spreads by some hundredths of a millimetre; more is another board.
_ODD_DIAMETER = 0.03
# A linear image taken for sRGB displaces its edges by 0.2 to 0.4 px.
_ODD_EDGE_PX = 0.05


@dataclass(frozen=True, eq=False)
class GridViews:
    """The views of a grid by one camera.

    Attributes
    ----------
    layout : GridLayout
    size_px : (int, int)
    images : list of GridImage
    frame_ids : list of int
        Of a dataset, else positions.
    """

    layout: GridLayout
    size_px: tuple[int, int]
    images: list[GridImage]
    frame_ids: list[int]

    def first(self, count: int | None) -> GridViews:
        """The first `count` views, with or without a board; all for None.

        Raises
        ------
        UsageError
            If there are fewer.
        """
        if count is None:
            return self
        if count > len(self.images):
            raise UsageError(
                f"{count} views are requested, but {len(self.images)} show a circle grid; request at most that many"
            )
        return replace(self, images=self.images[:count], frame_ids=self.frame_ids[:count])

    def calibrate(self, coefficients: int = 4, bend: int = 0) -> GridCalibration:
        """See `calibrate_grids`."""
        return calibrate_grids(self.images, self.layout, self.size_px, coefficients, bend)


def calibrate_images(
    images: Sequence[NDArray[Any]],
    layout: GridLayout,
    curve: ResponseCurve | str | None = None,
    coefficients: int = 4,
    bend: int = 0,
) -> GridCalibration:
    """Calibrate a camera from images of a circle grid.

    Parameters
    ----------
    images : sequence of (H, W) or (H, W, C) arrays
        Of one size; see `roundel.locate`.
    layout : GridLayout
        The printed grid.
    curve : ResponseCurve or str, optional
        See `roundel.locate`.
    coefficients : int
        4 (k1, k2, p1, p2) or 5 (and k3).
    bend : int
        See `calibrate_grids`.

    Returns
    -------
    GridCalibration

    Raises
    ------
    ValueError
        If an image or the layout is invalid, or the images differ in size.
    NotComparableError
        If the views do not determine the camera.
    """
    problem = layout_problem(layout)
    if problem:
        raise ValueError(f"the circle grid {problem}")
    wanted = curve if isinstance(curve, ResponseCurve) or curve is None else parse_curve(curve)
    sizes = {np.shape(image)[:2] for image in images}
    if len(sizes) > 1:
        raise ValueError(f"the images have {len(sizes)} sizes; calibrate one camera at a time")
    loads = [partial(_array_levels, image, wanted if wanted and wanted.known else None) for image in images]
    return _views(loads, layout).calibrate(coefficients, bend)


def _array_levels(image: NDArray[Any], curve: ResponseCurve | None) -> Levels:
    grey, top_dn = grey_levels(image, curve or UNKNOWN, keep_8bit=True)
    photometry = Photometry(curve or UNKNOWN, top_dn, level_step(image, top_dn), averaged_rounding(image))
    return Levels(grey, top_dn, photometry, None if curve else lambda found: grey_levels(image, found))


@one_blas_thread()
def photographed_grids(
    paths: Sequence[str | Path], layout: GridLayout, curve: str | None = None, progress: Progress | None = None
) -> GridViews:
    """The grid in photographs of one camera.

    Parameters
    ----------
    paths : sequence of path
        As in `solve_photographs`.
    layout : GridLayout
    curve : str, optional
        See `solve_photographs`.
    progress : callable, optional
        Called with (photographs done, total photographs).

    Raises
    ------
    DataError
        If a photograph cannot be read.
    NotComparableError
        If the photographs differ in size.
    UsageError
        If the layout or the curve is invalid.
    """
    problem = layout_problem(layout)
    if problem:
        raise UsageError(f"the circle grid {problem}")
    asked = None if curve is None else parse_curve(curve) or UNKNOWN
    found = find_photographs(paths)
    return _views([partial(_photo_levels, photo, asked) for photo in found], layout, progress)


@one_blas_thread()
def photographed_grid(source: PhotoInput, layout: GridLayout, curve: ResponseCurve | None = None) -> GridImage:
    """The grid in a photograph, as the file stores it: photographs of one camera then share one K, however it was held.

    Parameters
    ----------
    source : PhotoInput
    layout : GridLayout
    curve : ResponseCurve, optional
        See `read_photo`.

    Raises
    ------
    DataError
        If the photograph cannot be read.
    """
    return find_grid(partial(_photo_levels, source, curve), layout)


def _photo_levels(source: PhotoInput, curve: ResponseCurve | None) -> Levels:
    photo = read_photo(source.path, curve, source.page)
    turn = photo.exif.orientation

    def linearise(other: ResponseCurve) -> tuple[NDArray[np.float32], float]:
        grey, top_dn = photo.grey_by(other)
        return as_stored(grey, turn), top_dn

    known = photo.photometry.curve.known
    return Levels(as_stored(photo.grey, turn), photo.saturation_dn, photo.photometry, None if known else linearise)


def _views(
    loads: Sequence[Callable[[], Levels]],
    layout: GridLayout,
    progress: Progress | None = None,
    frame_ids: list[int] | None = None,
) -> GridViews:
    sizes, found = set(), []
    for done, load in enumerate(loads):
        if progress is not None:
            progress(done, len(loads))
        view = find_grid(load, layout)
        found.append(view)
        sizes.add(view.size_px)
    if progress is not None:
        progress(len(loads), len(loads))
    if len(sizes) > 1:
        raise NotComparableError(f"the views have {len(sizes)} image sizes; calibrate one camera at a time")
    return GridViews(layout, next(iter(sizes), (0, 0)), found, frame_ids or list(range(len(found))))


@one_blas_thread()
def grids_of_dataset(images: Images, group: str | None, progress: Progress | None = None) -> GridViews:
    """The views of a dataset's group (default: of all groups) that show a circle grid.

    Raises
    ------
    NotComparableError
        If no frame shows one, or they differ in layout or size.
    """
    numbers = [
        i
        for i in range(len(images))
        if (group is None or images.groups[i] == group)
        and images.mode(i) == "images"
        and any(marker["kind"] == KIND for marker in images.markers(i))
    ]
    if not numbers:
        raise NotComparableError(f"no frame shows a {KIND}; calibrate from a group that does")
    layouts = {layout_of(m["layout"]) for i in numbers for m in images.markers(i) if m["kind"] == KIND}
    if len(layouts) > 1:
        raise NotComparableError(f"the views show {len(layouts)} different grids; calibrate from a group with one")
    loads = [partial(_frame, images, i) for i in numbers]
    return _views(loads, layouts.pop(), progress, [images.frame_ids[i] for i in numbers])


def _frame(images: Images, i: int) -> Levels:
    return frame_levels(images, i, images.image(i))


def calibration_to_json(
    calibration: GridCalibration, views: GridViews, dataset_id: str | None = None, group: str | None = None
) -> dict[str, Any]:
    """A camera file: the camera keys of `cameras.json`, their source, and their covariance."""
    used = [views.frame_ids[i] for i in calibration.views]
    return {
        **camera_to_json(calibration.camera),
        "calibration": {
            "board": KIND,
            "rms_px": calibration.rms_px,
            "views": len(used),
            "missed_views": len(views.images) - len(used),
            "frames": used,
            "group": group,
            "dataset_id": dataset_id,
            "dots": calibration.used,
            "left_out_dots": calibration.left_out,
            "diameter_m": calibration.diameter_m,
            "edge_px": calibration.edge_px,
            "bend_m": calibration.bend_m.tolist(),
            "chi_square": calibration.chi_square,
            "widened": calibration.widened,
            "parameters": list(calibration.parameters),
            "sigma": calibration.sigmas,
            "covariance": calibration.covariance.tolist(),
        },
    }


def calibration_lines(calibration: GridCalibration, views: GridViews) -> list[str]:
    """A calibration as lines for the terminal."""
    k, sigma = calibration.camera.K, calibration.sigmas
    values = {"fx": k[0, 0], "fy": k[1, 1], "cx": k[0, 2], "cy": k[1, 2]}
    lines = [
        f"calibration: {len(calibration.views)} of {len(views.images)} views, {calibration.used} circles, "
        f"RMS {calibration.rms_px:.4f} px, chi-square {calibration.chi_square:.2f} per degree of freedom",
        ", ".join(f"{name} {value:.3f} ± {sigma[name]:.3f}" for name, value in values.items())
        + " px; "
        + ", ".join(
            f"{name} {value:.5f} ± {sigma[name]:.5f}"
            for name, value in zip(calibration.parameters[4:], calibration.camera.distortion, strict=False)
        ),
    ]
    return lines + calibration_notes(calibration, views.layout)


def calibration_notes(calibration: GridCalibration, layout: GridLayout) -> list[str]:
    """What to know of a calibration beside its numbers: each as a line."""
    lines, sigma = [], calibration.sigmas
    if calibration.widened > 1:
        lines.append(
            "the circles are off by more than the noise of their pixels (a bent board, see --bend, or another "
            f"lens model, see --k3): the standard deviations above are widened by {calibration.widened:.1f}"
        )
    asked, found, own = layout.diameter_m, calibration.diameter_m, sigma["diameter_m"]
    if abs(found / asked - 1.0) > max(_ODD_DIAMETER, 5 * own / asked):
        lines.append(
            f"the dots measure {found / layout.spacing_m:.3f} of their spacing, not "
            f"{asked / layout.spacing_m:.3f} as given; the spacing counts, the diameter was fitted"
        )
    edge, own = calibration.edge_px, sigma["edge_px"]
    if abs(edge) > max(_ODD_EDGE_PX, 5 * own):
        lines.append(
            f"the edges of the dots lie {edge:+.2f} ± {own:.2f} px outward: the response curve of the images is "
            "another (--curve), or they were sharpened; the camera takes it into account"
        )
    return lines
