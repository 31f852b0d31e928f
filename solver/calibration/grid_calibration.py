"""Calibration of a camera from views of a circle grid, without the bias of circle centres.

`findCirclesGrid` and `calibrateCamera` take the centres of blobs for the images of the circles' centres; perspective
and lens distortion displace them by a part of a pixel that depends on the pose (OpenCV, issue 7312). Here the whole
contour of each circle is imaged by the model of camera and board, and compared with the ellipse that was fitted to its
pixels. The calibration is done twice: the second time the lens of the first is removed from the pixels' positions
before the fit, so that the fitted curves are ellipses.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera, distorts
from roundel.scenes.errors import NotComparableError
from roundel.solver.calibration.bundle import Adjusted, adjust
from roundel.solver.calibration.contour_model import MAX_BEND, POSE, Dots, Model, bend_powers
from roundel.solver.calibration.first_camera import first_camera
from roundel.solver.calibration.grid_image import MIN_DOTS, GridImage, fit_dots
from roundel.solver.calibration.grid_layout import GridLayout
from roundel.solver.pose.direct_homography import homography, pose_of_homography

Array = NDArray[np.float64]

MIN_VIEWS = 3
_COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3")
_OUTLIER = 36.0  # chi-square of a dot, of five degrees of freedom: chance exceeds it once in a million
_MEDIAN = 4.351  # of chi-square of five degrees of freedom
_CHANCE = 3.0  # standard deviations of a chi-square beyond which it is none
_ROUNDS, _WORST = 8, 4.0  # of leaving out dots, each time those within this factor of the worst
# A focal length known worse than this was not determined by the views: the prior of any camera is better.
_UNDETERMINED = 0.1
# RMS of the residual, of the image's width: paper on a wall leaves a sixth of it.
_FARTHEST = 0.0005
_MOSTLY = 0.7  # of the circles
_ONE_CAMERA = "all views need one board, flat, and one camera with the same zoom"
# Standard deviation added to the ellipses at first, px: far from the minimum their covariances are too narrow a valley.
_SOFT_PX = 1.0


@dataclass(frozen=True, eq=False)
class GridCalibration:
    """A calibrated camera.

    Attributes
    ----------
    camera : Camera
        With OpenCV's k1, k2, p1, p2 (and k3 with five coefficients).
    parameters : tuple of str
        Names of the parameters: fx, fy, cx, cy, k1, k2, p1, p2 (k3), diameter_m, edge_px.
    covariance : (c, c) array
        Of the parameters, widened.
    chi_square : float
        Per degree of freedom: 1 if nothing but the noise of the pixels moves the circles.
    widened : float
        Factor by which the standard deviations were widened, because the dots scatter more than their noise, or the
        views contradict each other more (see `Adjusted.shared_error`); 1 if neither exceeds chance.
    diameter_m : float
        Of a dot, as fitted: ink spreads.
    edge_px : float
        Displacement of the edges in the images, outward, as fitted: see `Model.edge_px`.
    rms_px : float
        Root of the mean squared distance between measured and predicted centres of the ellipses.
    used, left_out : int
        Numbers of dots.
    views : list of int
        Positions of the used views among all.
    poses : (V, 4, 4) array
        `camera_from_board` of each.
    bend_m : (m,) array
        See `Model.bend_m`.
    dots : Dots
        The dots that were used; `view` counts the used views.
    residual_px : (N, 2) array
        Of each, measured minus predicted centre of its ellipse.
    """

    camera: Camera
    parameters: tuple[str, ...]
    covariance: Array
    chi_square: float
    widened: float
    diameter_m: float
    edge_px: float
    rms_px: float
    used: int
    left_out: int
    views: list[int]
    poses: Array
    bend_m: Array
    dots: Dots
    residual_px: Array

    @property
    def sigmas(self) -> dict[str, float]:
        """Standard deviation of each parameter."""
        return dict(zip(self.parameters, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))


def calibrate_grids(
    views: Sequence[GridImage],
    layout: GridLayout,
    size_px: tuple[int, int],
    coefficients: int = 4,
    bend: int = 0,
) -> GridCalibration:
    """Calibrate a camera from views of a grid.

    Parameters
    ----------
    views : sequence of GridImage
        From `find_grid`; those without dots are counted as missed.
    layout : GridLayout
    size_px : (int, int)
        Width and height of the images.
    coefficients : int
        4 (k1, k2, p1, p2) or 5 (and k3).
    bend : int
        Order of the polynomial that is fitted to the height of the board above its plane, the same in all views: 2 to
        `MAX_BEND`, or 0 for a flat board.

    Raises
    ------
    NotComparableError
        If there are too few views, or they do not determine the camera.
    """
    shown = [view for view in views if len(view.index)]
    _check_count(len(shown), len(views))
    numbers = [i for i, view in enumerate(views) if len(view.index)]
    dots = measured_dots(shown, layout, Camera(*size_px, np.eye(3)))
    first = calibrate_dots(dots, layout.diameter_m, size_px, coefficients, bend)
    # Again with the lens of this calibration: what it leaves of the curves' deviation from ellipses is second order.
    dots = measured_dots(shown, layout, first.camera)
    found = calibrate_dots(dots, first.diameter_m, size_px, coefficients, bend)
    return replace(found, views=[numbers[i] for i in found.views])


def measured_dots(views: Sequence[GridImage], layout: GridLayout, lens: Camera) -> Dots:
    """The dots of all views, fitted with a lens removed from the pixels' positions (see `fit_dots`)."""
    fitted = [fit_dots(view, lens) for view in views]
    number = np.repeat(np.arange(len(views)), [len(index) for index, _, _ in fitted])
    index, shape, cov = (np.concatenate(parts) for parts in zip(*fitted, strict=True))
    return Dots(number, layout.centres_m()[index], shape, cov, lens if distorts(lens) else None)


def calibrate_dots(
    dots: Dots,
    diameter_m: float,
    size_px: tuple[int, int],
    coefficients: int = 4,
    bend: int = 0,
) -> GridCalibration:
    """Calibrate a camera from the ellipses of boards' dots.

    Parameters
    ----------
    dots : Dots
        At least `MIN_VIEWS` views of `MIN_DOTS` dots.
    diameter_m : float
        Of a dot, to start from.
    size_px : (int, int)
    coefficients : int
    bend : int
        As `calibrate_grids`.

    Raises
    ------
    NotComparableError
        As `calibrate_grids`.
    """
    if coefficients not in (4, 5):
        raise ValueError(f"coefficients must be 4 or 5, not {coefficients}")
    if bend not in (0, *range(2, MAX_BEND + 1)):
        raise ValueError(f"bend must be 0 or an order from 2 to {MAX_BEND}, not {bend}")
    total = len(dots)
    dots, views = _kept(dots, np.ones(total, dtype=np.bool_), np.unique(dots.view))
    model = _start(dots, diameter_m, size_px, coefficients)
    model = replace(model, bend_m=np.zeros(len(bend_powers(bend))))
    for last in (False,) * _ROUNDS + (True,):
        found = adjust(model, dots)
        _check_determined(found)
        # Without a model of the error (wavy paper), its scale decides what is an outlier.
        scale = max(1.0, float(np.median(found.chi_square)) / _MEDIAN)
        # The worst ones first: they pull the model away from the others.
        good = found.chi_square < max(_OUTLIER * scale, float(found.chi_square.max()) / _WORST)
        if good.all() or last:
            break
        dots, kept = _kept(dots, good, np.arange(len(views)))
        views, model = views[kept], replace(found.model, poses=found.model.poses[kept])
    return _finished(found, dots, total, views.tolist())


def _check_count(found: int, looked: int) -> None:
    if found < MIN_VIEWS:
        raise NotComparableError(
            f"the circle grid was found in {found} of {looked} views; a calibration needs {MIN_VIEWS}: show more of "
            "the board, larger or less tilted, and check its columns, rows, spacing and diameter"
        )


def _kept(dots: Dots, good: NDArray[np.bool_], views: NDArray[np.int64]) -> tuple[Dots, NDArray[np.int64]]:
    """The good dots of the views that have enough of them, renumbered from zero, and those views."""
    counts = np.bincount(dots.view[good], minlength=int(views.max(initial=-1)) + 1)
    kept = views[counts[views] >= MIN_DOTS]
    _check_count(len(kept), len(views))
    chosen = dots.chosen(good & np.isin(dots.view, kept))
    return replace(chosen, view=np.searchsorted(kept, chosen.view)), kept


def _start(dots: Dots, diameter_m: float, size_px: tuple[int, int], coefficients: int) -> Model:
    """Camera and poses by homographies of the centres, then by ellipses with softened covariances."""
    views = range(int(dots.view.max()) + 1)
    # Centres in undistorted coordinates of an earlier lens are good enough to start from.
    try:
        maps = [homography(dots.centre_m[dots.view == v], dots.shape[dots.view == v, :2]) for v in views]
    except ValueError as error:
        raise NotComparableError(f"a view shows too little of the circle grid: {error}") from error
    camera = first_camera(maps, *size_px, coefficients)
    model = Model(camera, diameter_m, np.stack([pose_of_homography(h, camera.K) for h in maps]))
    return adjust(model, replace(dots, shape_cov=dots.shape_cov + _SOFT_PX**2 * np.eye(5))).model


def _check_determined(found: Adjusted) -> None:
    """Refuse views from which no camera follows."""
    covariance = found.covariance()
    sigma = np.inf if covariance is None else float(np.sqrt(covariance[:2, :2].max())) / found.model.camera.K[0, 0]
    if not sigma < _UNDETERMINED:
        tilt = np.degrees(np.arccos(np.clip(np.abs(found.model.poses[:, 2, 2]), 0.0, 1.0)))
        known = "not at all" if not np.isfinite(sigma) or sigma > 1 else f"to {100 * sigma:.0f} %"
        raise NotComparableError(
            f"the views determine the focal length {known}: the board is tilted by {tilt.max():.0f} degrees at most; "
            "tilt it by 20 to 45 degrees in several directions"
        )
    if not found.converged:
        raise NotComparableError(f"no camera fits the circles; {_ONE_CAMERA}")


def _finished(found: Adjusted, dots: Dots, total: int, views: list[int]) -> GridCalibration:
    covariance = found.covariance()
    assert covariance is not None, "_check_determined"
    camera = found.model.camera
    rms_px = math.sqrt(float(np.mean(np.sum(found.residual[:, :2] ** 2, axis=1))))
    if rms_px > _FARTHEST * camera.width_px:
        raise NotComparableError(
            f"the circles lie {rms_px:.2f} px (RMS) from where any camera would image a flat grid; {_ONE_CAMERA}"
        )
    if len(dots) < _MOSTLY * total:
        raise NotComparableError(f"only {len(dots)} of {total} circles fit one camera and one grid; {_ONE_CAMERA}")
    freedom = 5 * len(dots) - len(covariance) - POSE * len(views)
    chi_square = float(found.chi_square.sum()) / freedom
    raised = 1.0
    for excess, degrees in ((chi_square, freedom), found.shared_error(covariance)):
        if excess > 1.0 + _CHANCE * math.sqrt(2.0 / degrees):
            raised = max(raised, excess)
    parameters = ("fx", "fy", "cx", "cy", *_COEFFICIENTS[: len(camera.distortion)], "diameter_m", "edge_px")
    parameters += tuple(f"bend_x{i}y{j}_m" for i, j in bend_powers(MAX_BEND)[: len(found.model.bend_m)])
    # The model has the logarithm of the diameter.
    units = np.where(np.array(parameters) == "diameter_m", found.model.diameter_m, 1.0)
    covariance = covariance * np.outer(units, units)
    return GridCalibration(
        camera,
        parameters,
        covariance * raised,
        chi_square,
        math.sqrt(raised),
        found.model.diameter_m,
        found.model.edge_px,
        rms_px,
        len(dots),
        total - len(dots),
        views,
        found.model.poses,
        found.model.bend_m,
        dots,
        found.residual[:, :2],
    )
