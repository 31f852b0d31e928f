"""The normal equations of a fit to the pixels of a contour, in one pass over them.

Each pixel is predicted as I = inside + (outside - inside) T(z), see `roundel.solver.fit.pixel_fit`. A clipped pixel is
a lower bound: its likelihood is that of a censored Gaussian.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.geometry.edge_spread_function import PIXEL_VARIANCE
from roundel.solver.kernels.compiled import compiled
from roundel.solver.kernels.contour_pixels import (
    CURVATURE,
    CURVATURE_SS,
    DISTANCE,
    HALF_DIFFERENCE,
    HALF_SUM,
    NORMAL_X,
    NORMAL_Y,
    VALUE,
    X,
    Y,
)
from roundel.solver.kernels.disc_blur import STEPS, disc_minus_gauss, disc_scale, disc_table
from roundel.solver.kernels.edge_response import curved_distance, normal_cdf_and_density, step_response
from roundel.solver.kernels.sector_offsets import MIN_VARIANCE
from roundel.solver.kernels.small_matrices import add_products

Array = NDArray[np.float64]

# Parameters: change of the shape (x, y, S11, S12, S22); variance of the blur, its share of a disc, its gradient across
# the marker, its smear (coefficients of cos and sin of twice the normal's direction); variance of the ink's own soft
# edge at the semi-major axis; rates of the shape, px/s. The shape is that of the contour in the image, sheared by the
# rates of x and y: what remains of these two is their effect on the width of the edge.
VARIANCE, DISC, GRADIENT, SMEAR, INK, RATES, PARAMETERS = 5, 6, 7, 9, 11, 12, 17

# Columns of the record: residual, slope of the prediction by the distance, share of the outer level, weight, and 1 if
# the pixel is clipped (its residual and weight are then those of its likelihood's tangent).
RESIDUAL, SLOPE, SHARE, WEIGHT, CLIPPED, RECORD = 0, 1, 2, 3, 4, 5

DISC_VARIANCE = 0.1  # the shape of a blur so much smaller than the pixel is not visible
_SAME_DISC = 0.01  # relative change of the variance within which a table is scaled
_BLOCK = 64  # pixels
_OUTLIER = 6.0  # sigmas at which Tukey's weight reaches zero: 98 % efficient
_TURN = 3e-3  # rad: difference quotient by the direction of the edge's normal


@compiled
def pixel_equations(
    table: Array,
    jacobian: Array,
    place: Array,
    basis: Array,
    basis_slope: Array,
    light: Array,
    clip_dn: float,
    rows: Array,
    used: NDArray[np.int64],
    parameters: Array,
    levels: Array,
    noise: Array,
    robust_scale: float,
    discs: Array,
    normal: Array,
    gradient: Array,
    record: Array,
) -> None:
    """Normal matrix and gradient of the weighted least squares.

    Parameters
    ----------
    table : (N, 12) array
        The edge's pixels: see `contour_pixels`.
    jacobian : (N, 5) array
        Derivative of each distance by the shape.
    place : (N, 2) array
        Foot points relative to the centre, in semi-major axes.
    basis, basis_slope : (N, K) arrays
        Level functions at the pixels, and their change along the normal, 1/px.
    light : (N, 5) array
        Departures of both levels from these functions, dn, their changes along the normal, dn/px, and the share of
        the pixel's information that their error leaves; empty if there are none.
    clip_dn : float
        The level at which pixels clip.
    rows : (3,) array
        Time per row, s; the row of time zero; 1 if rows are columns, else 0.
    used : (m,) array
        The parameters that are fitted, of 0 to 16; those of shape and blur come first.
    parameters : (17,) array
    levels : (2, k) array
        Coefficients of the first k functions, inside and outside.
    noise : (2,) array
        Variance of a pixel inside and outside.
    robust_scale : float
        Tukey's weights are in units of so many sigmas; 0 for none.
    discs : (STEPS + 1, 5) array
        Working memory: the table of a disc's blur, and in its last row the variance and the ends of the table.
    normal, gradient : (m + 2 k, m + 2 k) and (m + 2 k,) arrays
        Written.
    record : (N, 5) array
        Written; see the constants of this module.
    """
    m, k = len(used), levels.shape[1]
    size = m + 2 * k
    # The derivatives of a block of pixels by each parameter, and their residuals, stay in the fastest cache.
    design, weights = np.empty((size + 1, _BLOCK)), np.empty(_BLOCK)
    sums, full = np.zeros((size + 1, size + 1)), np.zeros(PARAMETERS)
    variance, disc, ink = parameters[VARIANCE], parameters[DISC], parameters[INK]
    smear_x, smear_y = parameters[SMEAR], parameters[SMEAR + 1]
    smeared = smear_x != 0.0 or smear_y != 0.0
    total = variance + PIXEL_VARIANCE
    # The shape of the blur is that of lens and ink together; only the lens blurs along the edge, too.
    wide = max(variance + ink, MIN_VARIANCE)
    round_blur, of_lens = wide > DISC_VARIANCE, min(variance / wide, 1.0)
    if round_blur and abs(wide - discs[STEPS, 0]) > _SAME_DISC * wide:
        discs[STEPS, 0], discs[STEPS, 1] = wide, disc_table(wide, discs)
    moving, lit = False, len(light) > 0
    for j in range(m):
        moving = moving or used[j] >= RATES
    last, narrower, part, end = -1.0, 1.0, 1.0, discs[STEPS, 1]
    outlying = 1.0 / max(_OUTLIER * robust_scale, 1e-300) ** 2
    for i in range(len(table)):
        at = i % _BLOCK
        pixel = table[i]
        seconds = (pixel[X if rows[2] > 0.0 else Y] - rows[1]) * rows[0]
        distance = pixel[DISTANCE]
        for j in range(5):
            distance += jacobian[i, j] * parameters[j]
            if moving and j >= 2:
                distance += jacobian[i, j] * parameters[RATES + j] * seconds
        bent = pixel[CURVATURE]
        z, drift = curved_distance(distance, bent, pixel[CURVATURE_SS], total)
        nx, ny = pixel[NORMAL_X], pixel[NORMAL_Y]
        turned_x, turned_y = (nx - ny) * (nx + ny), 2.0 * nx * ny
        own = variance
        if smeared:
            # The blur is n^T B n across the edge and t^T B t along it; their covariance rotates the edge's image.
            across = smear_x * turned_x + smear_y * turned_y
            covariance = smear_y * turned_x - smear_x * turned_y
            own = max(variance + across, MIN_VARIANCE)
            whole = own + PIXEL_VARIANCE
            # Beyond two sigmas the edge has no influence.
            along = (
                max(variance - across, 0.0)
                + PIXEL_VARIANCE
                - covariance * covariance / whole * (1.0 - min(z * z / whole, 4.0))
            )
            z += bent / 2.0 * (along - total)
        # A soft edge of the ink widens the step as the circle's radius does, and does not shift it.
        support = nx * place[i, 0] + ny * place[i, 1]
        own = max(own + ink * support * support, MIN_VARIANCE)
        t, slope, bend = step_response(z, pixel[HALF_SUM], pixel[HALF_DIFFERENCE], own)
        by_turn = 0.0
        if moving:
            x_by_turn, y_by_turn = -math.copysign(ny, nx * ny), math.copysign(nx, nx * ny)
            turned = step_response(
                z,
                pixel[HALF_SUM] + _TURN * (x_by_turn + y_by_turn) / 2.0,
                pixel[HALF_DIFFERENCE] + _TURN * (x_by_turn - y_by_turn) / 2.0,
                own,
            )
            by_turn = (turned[0] - t) / _TURN
        widening, change, moment = bend / 2.0, 0.0, (own + PIXEL_VARIANCE) * slope
        if round_blur:
            if own != last:  # of most contours all pixels have the same
                last = own
                narrower, part = disc_scale(discs[STEPS, 0], own)
            change, by_distance, by_variance, by_slope = disc_minus_gauss(
                z, of_lens * bent, own, narrower, part, discs, end
            )
            t += disc * change
            slope += disc * by_distance
            widening += disc * by_variance
            moment += disc * by_slope
        # A blur that also widens along the edge shifts it; a smear removes along the edge what it adds across.
        smearing = widening - slope * bent / 2.0
        inking = widening
        widening += slope * drift
        slope *= 1.0 - bent * bent * total / 4.0
        low, high = 0.0, 0.0
        for j in range(k):
            low, high = low + basis[i, j] * levels[0, j], high + basis[i, j] * levels[1, j]
        if lit:
            low, high = low + light[i, 0], high + light[i, 1]
        height = high - low
        slope_dn = height * slope
        if moving:
            # A row sees the edge as it is at that time, not sheared: if the edge is passed on by q px a row, distances
            # from the sheared contour are too large by q n_r, and its normal has to turn by q t_r (r across the rows).
            across_rows, along_rows = (nx, -ny) if rows[2] > 0.0 else (ny, nx)
            edge = rows[0] * (height * by_turn * along_rows - slope_dn * distance * across_rows)
            full[RATES], full[RATES + 1] = nx * edge, ny * edge
        for j in range(5):
            full[j] = jacobian[i, j] * slope_dn
            if moving and j >= 2:
                full[RATES + j] = full[j] * seconds
        full[VARIANCE], full[DISC], full[INK] = (
            height * widening,
            height * change,
            height * inking * support * support,
        )
        full[GRADIENT], full[GRADIENT + 1] = place[i, 0] * full[VARIANCE], place[i, 1] * full[VARIANCE]
        full[SMEAR], full[SMEAR + 1] = height * smearing * turned_x, height * smearing * turned_y
        for j in range(m):
            design[j, at] = full[used[j]]
        predicted = full[GRADIENT] * parameters[GRADIENT] + full[GRADIENT + 1] * parameters[GRADIENT + 1]
        predicted += full[RATES] * parameters[RATES] + full[RATES + 1] * parameters[RATES + 1]
        for j in range(k):
            outer = basis[i, j] * t + basis_slope[i, j] * moment
            design[m + j, at], design[m + k + j, at] = basis[i, j] - outer, outer
            predicted += (basis[i, j] - outer) * levels[0, j] + outer * levels[1, j]
        if lit:
            predicted += light[i, 0] + (light[i, 1] - light[i, 0]) * t + (light[i, 3] - light[i, 2]) * moment
        share = min(max(t, 0.0), 1.0)
        residual = pixel[VALUE] - predicted
        weight = 1.0 / (noise[0] + (noise[1] - noise[0]) * share)
        if lit:
            weight *= light[i, 4]
        record[i, CLIPPED] = 0.0
        if pixel[VALUE] >= clip_dn:
            record[i, CLIPPED] = 1.0
            # -log Phi((predicted - clip) / sigma): its gradient and curvature as a residual and a weight.
            root = math.sqrt(weight)
            over = min(max((predicted - clip_dn) * root, -8.0), 8.0)
            cdf, density = normal_cdf_and_density(over)
            pull = density / max(cdf, 1e-15)
            bending = pull * (pull + over)
            residual = pull / root / max(bending, 1e-9)
            weight *= bending
            if bending < 1e-6:
                residual, weight = 0.0, 0.0
        elif robust_scale > 0.0:
            ratio = residual * residual * weight * outlying
            weight *= (1.0 - ratio) ** 2 if ratio < 1.0 else 0.0
        record[i, RESIDUAL], record[i, SLOPE], record[i, SHARE], record[i, WEIGHT] = residual, slope_dn, share, weight
        weights[at], design[size, at] = weight, residual
        if at == _BLOCK - 1 or i == len(table) - 1:
            add_products(design, weights, at + 1, sums)
    for a in range(size):
        gradient[a] = sums[size, a]
        for b in range(a + 1):
            normal[a, b] = normal[b, a] = sums[a, b]
