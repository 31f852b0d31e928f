"""Ellipse, blur and grey levels fitted to the pixels together, by weighted least squares.

Each pixel of the band around the contour is predicted as `edges` predicts it,

    I = inside + (outside - inside) T(z),

with the response T of a square pixel to a blurred edge and z the distance corrected for the edge's curvature
(`scenes.step_response`). Edge points ignore that all pixels share levels and blur; here the five shape parameters, the
blur and the levels are fitted jointly by Gauss-Newton, weighted by the noise of dark and light pixels. This is the
maximum-likelihood fit for Gaussian noise, close to the Cramer-Rao bound. A circle's pose has as many degrees of freedom
as its ellipse, so this is also the maximum-likelihood pose for any intrinsics.

The blur has a variance, a share of a circle of confusion, a change across a tilted marker, and, if the pixels show it,
a different variance along another direction (motion) or a soft edge of the ink. Only the change across the marker costs
precision, 10 % of the centre's: the flanks of the edge determine the other parameters, the middle determines the
ellipse.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera, distorts
from roundel.solver.fit.contour_sectors import deviating_sectors
from roundel.solver.fit.edges import EdgePoints
from roundel.solver.fit.ellipse import FailedFit
from roundel.solver.fit.local_light import local_light, near_gaps, parameters_at, record_of
from roundel.solver.fit.pixel_covariance import FitState, PixelFit, finished, sectors_of
from roundel.solver.fit.pixel_scene import SIZES, PixelScene, lit_scene, scene_of
from roundel.solver.fit.row_motion import RowMotion
from roundel.solver.fit.settled_fit import FitData, chi_square, first_state, fit_data, fitted, settled, with_shape
from roundel.solver.kernels.pixel_equations import INK, VARIANCE

Array = NDArray[np.float64]

_ROUNDS = 3  # of leaving out sectors
_MOSTLY = 0.3  # of a contour
# Chi-square of the edge that the planes of a sector have to explain: chance explains about half (6 in eleven sectors).
_WORTH = 1.5


def fit_pixels(
    image: NDArray[Any],
    edges: EdgePoints,
    camera: Camera | None = None,
    full_scale_dn: float = 255.0,
    noise_floor: Callable[[float], float] | None = None,
    motion: RowMotion | None = None,
) -> PixelFit | FailedFit:
    """Fit an ellipse, blur and grey levels to the pixels along a contour.

    Parameters
    ----------
    image : (H, W) array
        Grey levels; float32 ones are used as they are, others are converted at each call.
    edges : EdgePoints
        The contour: the starting value, and which of its sectors to trust.
    camera : Camera, optional
        With lens distortion, the ellipse is in undistorted pixel coordinates.
    full_scale_dn : float
        The level at which pixels saturate.
    noise_floor : callable, optional
        Least variance of a pixel at a grey level, dn^2: what rounding alone causes.
    motion : RowMotion, optional
        Of a rolling shutter.

    Returns
    -------
    PixelFit or FailedFit
    """
    lens = camera if camera is not None and distorts(camera) else None
    pixels = np.ascontiguousarray(image, dtype=np.float32)
    whole = scene_of(pixels, edges, lens, full_scale_dn, near_gaps(edges.trusted))
    if isinstance(whole, FailedFit):
        return whole
    trusted = edges.trusted
    for rounds in range(1, _ROUNDS + 1):
        fit = fit_data(lit_scene(whole, trusted), edges, noise_floor, motion)
        found = settled(fit)
        state = first_state(fit) if isinstance(found, FailedFit) else found
        if isinstance(found, FailedFit):
            # Smooth levels may be so wrong that nothing settles; the light beside the contour as found may not be.
            state, fit, trusted = _with_light(state, fit, whole, trusted, False)
        if not len(state.inverse):
            plain = fitted(fit, state)
            if isinstance(plain, FailedFit):
                return plain
            state = with_shape(fit, plain)
        state, fit, trusted = _with_light(state, fit, whole, trusted, rounds == 1)
        sectors = sectors_of(state, fit.scene)
        width = math.ceil(math.sqrt(state.parameters[VARIANCE] + max(float(state.parameters[INK]), 0.0)))
        bad = deviating_sectors(sectors.offset, sectors.sigma, sectors.square, sectors.pixels, sectors.used, width)
        if rounds == _ROUNDS or not np.any(bad):
            break
        trusted = trusted & ~bad
    rejected = 1.0 - np.count_nonzero(trusted) / max(int(np.count_nonzero(edges.trusted)), 1)
    return finished(state, fit.scene, sectors, max(rejected, 0.0), motion)


def _with_light(
    state: FitState, fit: FitData, whole: PixelScene, trusted: NDArray[np.bool_], grow: bool
) -> tuple[FitState, FitData, NDArray[np.bool_]]:
    """The fit with local light where its pixels show some, then with sectors regained at the ends of gaps."""
    if any(whole.clipped):
        return state, fit, trusted
    for growing in (False, True) if grow and not trusted.all() else (False,):
        known = whole is fit.scene and len(state.record)
        record = state.record if known else record_of(state, whole, fit.rows, fit.discs)
        light, ground = local_light(state, whole, record, trusted, growing), state
        if light is not None and state.levels.shape[1] > SIZES[0] and light.part > _MOSTLY:
            # Squares that follow a shadow bend too much for planes on top of them.
            ground = replace(state, levels=state.levels[:, : SIZES[0]].copy())
            light = local_light(ground, whole, record_of(ground, whole, fit.rows, fit.discs), trusted, growing)
        if light is None:
            continue
        lit = replace(fit, scene=lit_scene(whole, light.trusted, light.planes, light.share))
        start = replace(
            ground,
            ellipse=whole.ellipse,
            table=lit.scene.table,
            jacobian=lit.scene.jacobian,
            parameters=parameters_at(ground, whole),
            rows=fit.rows,
        )
        again = fitted(lit, start)
        if isinstance(again, FailedFit):
            continue
        if len(state.inverse) and np.array_equal(light.trusted, trusted):
            # Light beside the edge that does not reach it only costs precision.
            gain = chi_square(record, state.noise) - chi_square(again.record, state.noise)
            if gain < _WORTH * light.part * np.count_nonzero(trusted):
                continue
        state, fit, trusted = again, lit, light.trusted
    return state, fit, trusted
