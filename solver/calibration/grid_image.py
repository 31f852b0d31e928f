"""The dots of a circle grid in one image: detected, ordered, and fitted to the pixels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera
from roundel.scenes.camera.response_curve import ResponseCurve
from roundel.solver.calibration.grid_layout import GridLayout
from roundel.solver.calibration.lattice import grid_places, lattice_of
from roundel.solver.detect.detect import Detection
from roundel.solver.fit.ellipse import FailedFit, shape_of_ellipse
from roundel.solver.methods.roundel_fits import Detections, detect_circles, fit_detection, with_estimated_curve
from roundel.solver.photometry.frame_levels import Levels

Array = NDArray[np.float64]

# Four dots determine a homography; with more a wrong one among them is seen.
MIN_DOTS = 6


@dataclass(frozen=True, eq=False)
class GridImage:
    """A view of a grid.

    Attributes
    ----------
    size_px : (int, int)
        Width and height of the image.
    load : callable
        Returns its `Levels`; called again for each fit, so that the images of all views need not stay in memory.
    detections : list of Detection
        The dots found, whole in the image.
    index : (n,) array
        Their indices in `GridLayout.centres_m`.
    """

    size_px: tuple[int, int]
    load: Callable[[], Levels]
    detections: list[Detection]
    index: NDArray[np.int64]


def find_grid(load: Callable[[], Levels], layout: GridLayout) -> GridImage:
    """Detect the dots of a grid in an image and order them; without any if fewer than `MIN_DOTS` form a grid."""
    levels = load()
    size = levels.grey.shape[1], levels.grey.shape[0]
    seen = detect_circles(levels.grey, levels.full_scale_dn, levels.photometry, own_ellipses=False)
    if levels.linearise is not None:
        seen = with_estimated_curve(seen, levels.linearise)
        load = partial(_linearised, load, seen.photometry.curve)
    # The border of the image cuts a contour where nothing is known of the rest of it.
    whole = [d for d in seen.detections if not d.cut]
    none = GridImage(size, load, [], np.empty(0, dtype=np.int64))
    if len(whole) < MIN_DOTS:
        return none
    shapes = shape_of_ellipse(np.array([d.edges.ellipse for d in whole]))
    members, place = lattice_of(shapes, layout.pitch_m / (layout.diameter_m / 2))
    if len(members) < MIN_DOTS:
        return none
    which, index = grid_places(place, shapes[members, :2], layout)
    # A row of dots alone determines no pose.
    if len(which) < MIN_DOTS or np.linalg.matrix_rank(place[which] - place[which].mean(axis=0)) < 2:
        return none
    return GridImage(size, load, [whole[members[i]] for i in which], index)


def _linearised(load: Callable[[], Levels], curve: ResponseCurve) -> Levels:
    levels = load()
    assert levels.linearise is not None, "a curve was estimated"
    grey, full_scale_dn = levels.linearise(curve)
    return Levels(grey, full_scale_dn, levels.photometry.with_curve(curve))


def fit_dots(view: GridImage, camera: Camera) -> tuple[NDArray[np.int64], Array, Array]:
    """Ellipses of a view's dots, fitted to the pixels.

    Parameters
    ----------
    view : GridImage
    camera : Camera
        Its lens is removed from the pixels' positions; without distortion the ellipses are those of the image.

    Returns
    -------
    index : (k,) array
        The dots whose fit succeeded.
    shape, cov : (k, 5), (k, 5, 5) arrays
    """
    levels = view.load()
    seen = Detections(levels.grey, levels.full_scale_dn, view.detections, levels.photometry)
    index, shapes, covs = [], [], []
    for number, detection in zip(view.index.tolist(), view.detections, strict=True):
        fit = fit_detection(seen, detection, camera, "pixels")
        if isinstance(fit, FailedFit) or not np.all(np.linalg.eigvalsh(fit.shape_cov) > 0):
            continue
        index.append(number)
        shapes.append(shape_of_ellipse(fit.ellipse))
        covs.append(fit.shape_cov)
    return np.array(index, dtype=np.int64), np.reshape(shapes, (-1, 5)), np.reshape(covs, (-1, 5, 5))
