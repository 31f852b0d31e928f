"""Light that smooth functions do not follow: departures of the grey levels, sector by sector of a contour.

A contact shadow beside an occluder, the edge of a shadow or a highlight changes the levels within a few px. In each
sector both levels depart from their functions by a plane, in the distance from the contour and along it, fitted to the
pixels of the neighbouring sectors. The offset of the edge in each sector is eliminated before, so that the levels do
not follow the edge. Planes are used only where the pixels show them.

Sectors at the ends of a gap are judged with their own light: beside an occluder the levels of `edge_points`, which come
from 10 px on either side, are partly those of the occluder, and these sectors were not trusted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.solver.fit.contour_sectors import FEWEST, LEAST, chance
from roundel.solver.fit.ellipse import shape_of_ellipse
from roundel.solver.fit.pixel_covariance import FitState
from roundel.solver.fit.pixel_scene import PixelScene
from roundel.solver.fit.sector_planes import (
    KNOWN,
    NUMBER,
    PLANES,
    PULL,
    chi_square_left,
    gather_sectors,
    ground_changes,
    plane_of,
    steepness_of,
)
from roundel.solver.kernels.compiled import compiled
from roundel.solver.kernels.contour_pixels import DISTANCE
from roundel.solver.kernels.order_statistics import median
from roundel.solver.kernels.pixel_equations import RECORD, pixel_equations

Array = NDArray[np.float64]

_WINDOW, _NARROW = 5, 2  # neighbours on either side
# Chi-square that planes have to explain, elsewhere and beside gaps and other planes; chance explains 6.
_GAIN, _LESS = 20.0, 6.0
_OUTLIER = 5.0  # sigmas
_QUICK = 12.0  # chi-square of a mean of a plateau that calls for a closer look; chance has it in 1 of 2000
_FAINT = 0.02  # fraction of the contrast: fainter shades displace an edge by a fiftieth of its blur
_NEAR_PX = 3.0  # of a plateau
_BEND = 2.0  # variance of the planes, in those of the noise: light is no plane
_GROWTH = 6  # sectors at the end of a gap that may be regained
_OFF, _LOUD = 3.0, 3.0  # sigmas of its offset, and of its chi-square
_STEEP = 0.02  # contrasts per px: beyond, planes do not follow the light
_FILLED = 0.6  # fraction of the pixels of other sectors


@dataclass(frozen=True, eq=False)
class LocalLight:
    """Departures of the levels along a contour.

    Attributes
    ----------
    planes : (S, 6) array
        Of each sector, zero where the pixels show none.
    share : (S,) array
        Share of the information of a sector's pixels that is left if its levels are uncertain.
    trusted : (S,) array of bool
        Sectors that belong to the contour, with those that were regained.
    """

    planes: Array
    share: Array
    trusted: NDArray[np.bool_]

    @property
    def part(self) -> float:
        """Part of the trusted sectors that has planes."""
        return float(np.mean(np.any(self.planes[self.trusted] != 0.0, axis=1)))


@compiled
def _set(out: Array, times: float, values: Array) -> None:
    for i in range(len(out)):
        out[i] = times * values[i]


@compiled
def _local_planes(
    sector: NDArray[np.int64], table: Array, basis: Array, basis_slope: Array, record: Array, noise: Array,
    levels: Array,
    inner_sector: NDArray[np.int64], inner: Array, inner_basis: Array, inner_value: Array,
    outer_sector: NDArray[np.int64], outer: Array, outer_basis: Array, outer_value: Array,
    trusted: NDArray[np.bool_], suspect: NDArray[np.bool_], grow: int, planes: Array, shares: Array,
) -> bool:  # fmt: skip
    """Write planes, shares and newly trusted sectors; False if there are neither planes nor new sectors."""
    count = len(trusted)
    gram, moment = np.empty((count, PLANES, PLANES)), np.empty((count, PLANES))
    flat_gram, flat_moment = np.empty((count, PLANES, PLANES)), np.empty((count, PLANES))
    lean, sums = np.empty((count, PLANES)), np.empty((count, 4))
    normal, inverse = np.empty((PLANES, PLANES)), np.empty((PLANES, PLANES))
    gradient, plane = np.empty(PLANES), np.empty(PLANES)
    contrast_dn = abs(levels[1, 0] - levels[0, 0])
    for s in range(count):
        shares[s] = 1.0
    steep, ground = np.zeros(count, np.bool_), ground_changes(sector, basis, basis_slope, levels, count)
    near_px = 0.0
    for i in range(len(table)):
        near_px = max(near_px, abs(table[i, DISTANCE]))
    near_px += _NEAR_PX
    for turn in range(2):
        cut = math.inf if turn == 0 else _OUTLIER**2
        gather_sectors(
            sector, table, record, noise, levels, inner_sector, inner, inner_basis, inner_value, outer_sector, outer,
            outer_basis, outer_value, planes, cut, gram, moment, lean, sums, flat_gram, flat_moment,
            near_px,
        )  # fmt: skip
        for s in range(count):
            if trusted[s] and suspect[s]:
                plane_of(s, _WINDOW, trusted, contrast_dn, gram, moment, normal, gradient, inverse, planes[s])
    # The noise of the fit includes what its levels do not follow.
    noisy, n, filled = np.empty(count), 0, np.empty(count)
    for s in range(count):
        if trusted[s]:
            noisy[n] = chi_square_left(s, planes[s], gram, moment, sums) / max(sums[s, NUMBER] - 1.0, 1.0)
            filled[n] = sums[s, NUMBER]
            n += 1
    scale, most = min(max(median(noisy[:n]), 1e-12), 1.0), median(filled[:n])
    found = False
    if grow > 0:
        ends = trusted.copy()
        for start in range(count):
            for side in (-1, 1):
                if not ends[start] or ends[(start + side) % count]:
                    continue
                for step in range(1, grow + 1):
                    s = (start + side * step) % count
                    if trusted[s] or sums[s, NUMBER] < _FILLED * most or sums[s, KNOWN] <= 0.0:
                        break
                    trusted[s] = True
                    plane_of(s, _NARROW, trusted, contrast_dn, gram, moment, normal, gradient, inverse, planes[s])
                    pixels = sums[s, NUMBER] - 1.0
                    offset = sums[s, PULL] / sums[s, KNOWN]
                    for a in range(PLANES):
                        if a % 3 < 2:
                            offset -= lean[s, a] * planes[s, a]
                    if (
                        chi_square_left(s, planes[s], gram, moment, sums) > scale * pixels * chance(pixels, _LOUD)
                        or abs(offset) * math.sqrt(sums[s, KNOWN] / scale) > _OFF
                        or steepness_of(planes[s], ground[s], inverse, scale) > _STEEP * contrast_dn
                    ):
                        trusted[s] = False
                        _set(planes[s], 0.0, plane)
                        break
                    found = True
    gains = np.zeros(count)
    for _ in range(2):  # the second time without the sectors in which the light changes too fast
        near = np.zeros(count, np.bool_)
        for s in range(count):
            if trusted[s] and suspect[s]:
                gains[s], used = plane_of(
                    s, _WINDOW, trusted, contrast_dn, flat_gram, flat_moment, normal, gradient, inverse, plane
                )
            if not trusted[s] or gains[s] > _GAIN * scale:  # shades rarely end at once
                for k in range(-_WINDOW, _WINDOW + 1):
                    near[(s + k) % count] = True
        for s in range(count):
            steep[s] = False
            if not (trusted[s] and suspect[s]):
                continue
            if gains[s] < (_LESS if near[s] else _GAIN) * scale:
                _set(planes[s], 0.0, plane)
                continue
            found = True
            plane_of(s, _WINDOW, trusted, contrast_dn, gram, moment, normal, gradient, inverse, planes[s])
            _, used = plane_of(s, _NARROW, trusted, contrast_dn, gram, moment, normal, gradient, inverse, plane)
            change = 0.0
            for a in range(PLANES):
                for b in range(PLANES):
                    change += (plane[a] - planes[s, a]) * normal[a, b] * (plane[b] - planes[s, b])
            if change > _GAIN * scale:
                _set(planes[s], 1.0, plane)
            else:
                _, used = plane_of(s, _WINDOW, trusted, contrast_dn, gram, moment, normal, gradient, inverse, plane)
            steep[s] = steepness_of(planes[s], ground[s], inverse, scale) > _STEEP * contrast_dn
            # Neighbours share the error of the levels: against the offset of all the sectors used.
            error = 0.0
            for a in range(PLANES):
                for b in range(PLANES):
                    if a % 3 < 2 and b % 3 < 2:
                        error += lean[s, a] * inverse[a, b] * lean[s, b]
            shares[s] = 1.0 / (1.0 + _BEND * used * sums[s, KNOWN] * error)
        left, number = 0, 0
        for s in range(count):
            number, left = number + trusted[s], left + (trusted[s] and not steep[s])
        if left == number or left < max(FEWEST, LEAST * number):
            break
        for s in range(count):
            if steep[s]:
                trusted[s] = False
                _set(planes[s], 0.0, plane)
    return found


@compiled
def _uneven_sectors(
    levels: Array, noise: Array, trusted: NDArray[np.bool_],
    inner_sector: NDArray[np.int64], inner_basis: Array, inner_value: Array,
    outer_sector: NDArray[np.int64], outer_basis: Array, outer_value: Array,
) -> NDArray[np.bool_]:  # fmt: skip
    """Sectors near which the mean residual of a plateau is more than chance, and more than a part of the contrast."""
    count = len(trusted)
    contrast_dn = levels[1, 0] - levels[0, 0]
    out = np.zeros(count, np.bool_)
    for side in range(2):
        at = inner_sector if side == 0 else outer_sector
        basis, value = (inner_basis, inner_value) if side == 0 else (outer_basis, outer_value)
        total, number = np.zeros(count), np.zeros(count)
        for i in range(len(value)):
            residual = value[i]
            for j in range(levels.shape[1]):
                residual -= basis[i, j] * levels[side, j]
            if trusted[at[i]] and residual * residual < max(_QUICK * noise[side], contrast_dn * contrast_dn):
                total[at[i]] += residual
                number[at[i]] += 1.0
        for s in range(count):
            residual, pixels = 0.0, 0.0
            for k in range(-_NARROW, _NARROW + 1):
                residual, pixels = residual + total[(s + k) % count], pixels + number[(s + k) % count]
            if residual * residual > pixels * (_QUICK * noise[side] + pixels * (_FAINT * contrast_dn) ** 2):
                for k in range(-_WINDOW, _WINDOW + 1):
                    out[(s + k) % count] = True
    return out


def local_light(
    state: FitState, scene: PixelScene, record: Array, trusted: NDArray[np.bool_], grow: bool
) -> LocalLight | None:
    """Departures of the levels from those of a fit; None if its pixels show none, and no sector is regained.

    Parameters
    ----------
    state : FitState
    scene : PixelScene
        Without local light; its sectors may be more than the trusted ones.
    record : (N, 5) array
        Of the scene's pixels at the state.
    trusted : (S,) array of bool
    grow : bool
        Whether sectors at the ends of gaps may be regained.
    """
    count = len(trusted)
    inner, outer = scene.plateaus
    suspect = _uneven_sectors(
        state.levels, state.noise, trusted, inner.sector, inner.basis, inner.value, outer.sector, outer.basis,
        outer.value,
    )  # fmt: skip
    if grow:
        suspect |= near_gaps(~trusted)
    if not suspect.any():
        return None
    planes, shares, after = np.zeros((count, PLANES)), np.empty(count), trusted.copy()
    found = _local_planes(
        scene.sectors, scene.table, scene.basis, scene.basis_slope, record, state.noise, state.levels,
        inner.sector, inner.distance, inner.basis, inner.value,
        outer.sector, outer.distance, outer.basis, outer.value,
        after, suspect, _GROWTH if grow else 0, planes, shares,
    )  # fmt: skip
    return LocalLight(planes, shares, after) if found else None


def near_gaps(trusted: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The trusted sectors, and those near the ends of gaps."""
    if trusted.all():
        return trusted
    out = trusted.copy()
    for k in range(1, _GROWTH + 1):
        out |= np.roll(trusted, k) | np.roll(trusted, -k)
    return out


def parameters_at(state: FitState, whole: PixelScene) -> Array:
    """The parameters of a state for a scene, whose ellipse is another one."""
    parameters = state.parameters.copy()
    parameters[:5] += shape_of_ellipse(state.ellipse) - shape_of_ellipse(whole.ellipse)
    return parameters


def record_of(state: FitState, scene: PixelScene, rows: Array, discs: Array) -> Array:
    """The record of a scene's pixels at a state, without local light; `rows` are those of its distances."""
    size = len(state.used) + 2 * state.levels.shape[1]
    record = np.empty((len(scene.table), RECORD))
    pixel_equations(
        scene.table, scene.jacobian, scene.place, scene.basis, scene.basis_slope, np.empty((0, 5)), scene.clip_dn,
        rows, state.used, parameters_at(state, scene), state.levels, state.noise, 0.0,
        discs, np.empty((size, size)), np.empty(size), record,
    )  # fmt: skip
    return record
