"""The pixels of a print as one pose predicts them, with derivatives by every uncertain parameter.

The print is sampled on a grid finer than the pixels, blurred there, and averaged over each pixel: aperture and blur are
exact, and the gradients of the prediction come from the same grid.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera, distort_px, distorts, undistort_px
from roundel.solver.ambiguity.viewing_cone import ViewingCone
from roundel.solver.fit.ellipse import shape_of_ellipse

Array = NDArray[np.float64]

_MIN_PIXELS = 40
_MAX_PIXELS = 1200  # with more, every n-th is used: the odds are decisive by then
_TURNS = 90
_TURN_SIGMA = math.radians(10.0)  # around the best rotation; wide, but without another maximum
_BLUR_SIGMA_PX = 0.1
_SETTLED = 1e-3  # of the residual's power


@dataclass(frozen=True, eq=False)
class Region:
    """The pixels inside a contour, away from its edge, in a box of the image.

    Attributes
    ----------
    index : (N,) array
        Indices of the pixels in the box, row by row.
    value : (N,) array
        Their grey levels.
    places : (N, 2) array
        Their centres in undistorted pixels.
    fine : (box height * scale * box width * scale, 2) array
        The finer grid over the box, undistorted pixels.
    shape : (int, int)
        Height and width of the box, pixels.
    scale : int
        Points of the finer grid per pixel and side.
    stretch : (N, 2, 2) array
        Derivative of `places` with respect to image pixels.
    size_px : float
        Semi-major axis of the contour.
    """

    index: NDArray[np.int64]
    value: Array
    places: Array
    fine: Array
    shape: tuple[int, int]
    scale: int
    stretch: Array
    size_px: float


def region_inside(image: NDArray[Any], camera: Camera, ellipse: Array, blur_px: float) -> Region | None:
    """The region inside an ellipse of undistorted pixels; None if it has too few pixels."""
    height, width = image.shape
    middle = distort_px(camera, ellipse[:2])
    theta = shape_of_ellipse(ellipse)
    margin = 1.0 + 3.0 * blur_px
    shrunk = np.array([[theta[2], theta[3]], [theta[3], theta[4]]]) - margin * np.eye(2)
    if not (np.all(np.isfinite(middle)) and shrunk[0, 0] > 0 and np.linalg.det(shrunk) > 0):
        return None
    half = float(ellipse[2]) * (1.3 if distorts(camera) else 1.0) + 2.0
    x0, y0 = (max(0, math.floor(v - half)) for v in middle)
    x1, y1 = (min(limit, math.ceil(v + half) + 1) for v, limit in zip(middle, (width, height), strict=True))
    if x1 - x0 < 4 or y1 - y0 < 4:
        return None

    def grid(scale: int) -> Array:
        x = x0 + (np.arange((x1 - x0) * scale) + 0.5) / scale - 0.5
        y = y0 + (np.arange((y1 - y0) * scale) + 0.5) / scale - 0.5
        return undistort_px(camera, np.stack(np.meshgrid(x, y), axis=-1))

    whole = grid(1)
    flat = whole.reshape(-1, 2)
    index = np.flatnonzero(np.sum(((flat - theta[:2]) @ np.linalg.inv(shrunk)) ** 2, axis=1) < 1.0)
    if len(index) < _MIN_PIXELS:
        return None
    index = index[:: -(-len(index) // _MAX_PIXELS)]
    stretch = np.stack([np.gradient(whole, axis=1), np.gradient(whole, axis=0)], axis=-1).reshape(-1, 2, 2)[index]
    # The spacing of the grid is a quarter of a pixel, or half a pixel for the largest prints, which have enough pixels.
    scale = 4 if ellipse[2] <= 40.0 else 2
    fine = grid(scale).reshape(-1, 2)
    # Corners of the box may be outside the lens's field; they are not used.
    fine = np.where(np.isfinite(fine), fine, 0.0)
    value = image[y0:y1, x0:x1].ravel()[index].astype(np.float64)
    return Region(index, value, flat[index], fine, (y1 - y0, x1 - x0), scale, stretch, float(ellipse[2]))


@dataclass(frozen=True, eq=False)
class PrintFit:
    """Residual and Jacobian of one candidate, both projected free of grey levels and light."""

    residual: Array
    jacobian: Array  # with respect to nuisances of unit variance
    left: float  # sum of squares with the best nuisances

    def log_likelihood(self, noise2: float) -> float:
        """Log-likelihood of the residual under N(0, noise2 I + J J^T), without the constant."""
        inner = np.eye(self.jacobian.shape[1]) + self.jacobian.T @ self.jacobian / noise2
        lean = self.jacobian.T @ self.residual
        explained = float(lean @ np.linalg.solve(inner, lean)) / noise2
        cost = (float(self.residual @ self.residual) - explained) / noise2
        return -0.5 * (cost + float(np.linalg.slogdet(inner)[1]))


class PredictedPrint:
    """A print of known texture under both poses of a cone.

    Parameters
    ----------
    texture : (n, n) array
        See `Pattern`.
    cone : ViewingCone
    region : Region
    blur_px : float
    """

    def __init__(self, texture: Array, cone: ViewingCone, region: Region, blur_px: float) -> None:
        self.cone, self.region, self.blur_px = cone, region, blur_px
        self.texture = _coarser(texture, region.size_px, 1.0 / region.scale)
        # The mean over a cell and linear interpolation between cells blur by a sixth of a cell's square.
        self.smooth = (2.0 * region.size_px / len(self.texture)) ** 2 / 6.0
        # Cells of 1 to 2 px: a thin line is then as wide as the steps of the coarse rotations.
        self.soft = _coarser(self.texture, region.size_px, 2.0)
        # X is perpendicular to the camera axis that is far from the normal; the rotation is searched anyway.
        across = [np.cross(np.eye(3)[int(np.argmin(np.abs(n)))], n) for n in cone.normal[0]]
        self.x_axis = [axis / np.linalg.norm(axis) for axis in across]
        self.fine = [self._plane(i, 0, region.fine) for i in range(2)]
        middle = region.places - region.places.mean(axis=0)
        self.light = np.column_stack([np.ones(len(middle)), middle / np.abs(middle).max()])

    def fit(self, i: int) -> PrintFit:
        """Best rotation of candidate i, and the residual and Jacobian there."""
        turn = self._coarse_turn(i)
        jacobian, plain = self._linearise(i, turn)
        for _ in range(4):  # the coarse rotation is off by about a degree
            turn += _TURN_SIGMA * float(np.clip(_best(jacobian, plain)[-2], -0.2, 0.2))
            moved, less = self._linearise(i, turn)
            gained = float(plain @ plain) - float(less @ less)
            if gained > 0:
                jacobian, plain = moved, less
            if gained < _SETTLED * float(plain @ plain):
                break
        left = plain - jacobian @ _best(jacobian, plain)
        return PrintFit(plain, jacobian, float(left @ left))

    def _coarse_turn(self, i: int) -> float:
        """The best rotation to about a degree: with a smoothed print first, then with the print itself."""
        flat = self._plane(i, 0, self.region.places)
        turns = np.arange(_TURNS) * (2.0 * math.pi / _TURNS)
        left = np.array([_unexplained(self.region.value, _look_up(self.soft, flat, t)) for t in turns])
        lowest = [j for j in range(_TURNS) if left[j] <= min(left[j - 1], left[(j + 1) % _TURNS])]
        lowest.sort(key=lambda j: float(left[j]))
        step = 2.0 * math.pi / (3 * _TURNS)
        near = [float(turns[j]) + d * step for j in lowest[:3] for d in (-1, 0, 1)]
        return min(
            near, key=lambda t: _unexplained(self.region.value, self._blurred(self._drawn(i, t), self.blur_px)[0])
        )

    def _linearise(self, i: int, turn: float) -> tuple[Array, Array]:
        """Jacobian for nuisances of unit variance (the last two are rotation and blur), and the residual."""
        drawn = self._drawn(i, turn)
        model, slope = self._blurred(drawn, self.blur_px)
        shaded = model[:, None] * self.light[:, 1:]
        columns = np.column_stack([self.light, shaded, model])
        levels = np.linalg.lstsq(columns, self.region.value, rcond=None)[0]
        plain = self.region.value - columns @ levels
        # A nuisance moves the print under a pixel, like a step of the pixel, so all nuisances share its gradients.
        places, nudge = self.region.places, 0.1 * np.eye(2)
        here = self._plane(i, 0, places)
        onto = np.stack([self._plane(i, 0, places + d) - self._plane(i, 0, places - d) for d in nudge], axis=-1) / 0.2
        moves = self.cone.spread(np.stack([self._plane(i, row, places) for row in range(len(self.cone.K))]))
        turned = _TURN_SIGMA * np.stack([here[:, 1], -here[:, 0]], axis=1)
        moves = np.concatenate([moves, turned[:, :, None]], axis=2)
        by_move = np.einsum("ni,nik->nk", slope, np.linalg.solve(onto @ self.region.stretch, moves))
        low, high = max(self.blur_px - _BLUR_SIGMA_PX, 0.0), self.blur_px + _BLUR_SIGMA_PX
        by_blur = self._blurred(drawn, high)[0] - self._blurred(drawn, low)[0]
        # The last level is the gain of the print, from a change of the prediction to one of the pixels.
        jacobian = float(levels[-1]) * np.column_stack([by_move, by_blur * (_BLUR_SIGMA_PX / (high - low))])
        basis = np.linalg.qr(columns)[0]
        return jacobian - basis @ (basis.T @ jacobian), plain

    def _drawn(self, i: int, turn: float) -> Array:
        """The print on the finer grid, before blurring."""
        height, width = (n * self.region.scale for n in self.region.shape)
        return _look_up(self.texture, self.fine[i], turn).reshape(height, width)

    def _blurred(self, drawn: Array, blur_px: float) -> tuple[Array, Array]:
        """Mean reflectance (N,) of each pixel, and its gradient (N, 2) with respect to the pixel's position."""
        from scipy.ndimage import gaussian_filter

        n = self.region.scale
        sigma = n * math.sqrt(max(blur_px**2 - self.smooth, 1e-4))
        soft = gaussian_filter(drawn, sigma, mode="nearest", truncate=3.5)
        # Sums over n by n points from cumulative sums: for a pixel, and for the pixel shifted by one point.
        total = np.zeros((soft.shape[0] + 1, soft.shape[1] + 1))
        total[1:, 1:] = soft.cumsum(axis=0).cumsum(axis=1)
        row, column = np.divmod(self.region.index, self.region.shape[1])

        def mean(down: int, across: int) -> Array:
            y, x = row * n + down, column * n + across
            return np.asarray((total[y + n, x + n] - total[y, x + n] - total[y + n, x] + total[y, x]) / n**2)

        slope = np.stack([mean(0, 1) - mean(0, -1), mean(1, 0) - mean(-1, 0)], axis=1) * (n / 2.0)
        return mean(0, 0), slope

    def _plane(self, i: int, row: int, places: Array) -> Array:
        """Undistorted pixels to the marker's plane in radii (N, 2); the axes follow the normal without rotation."""
        n, cone = self.cone.normal[row, i], self.cone.cone[row]
        c = -cone @ n / math.sqrt(float(n @ cone @ n))
        x_axis = self.x_axis[i] - float(n @ self.x_axis[i]) * n
        x_axis /= np.linalg.norm(x_axis)
        inverse = np.linalg.inv(self.cone.K[row])
        rays = places @ inverse[:, :2].T + inverse[:, 2]
        points = rays * (float(n @ c) / (rays @ n))[:, None] - c
        return np.stack([points @ x_axis, points @ np.cross(n, x_axis)], axis=1)


def _coarser(texture: Array, size_px: float, cell_px: float) -> Array:
    """The texture, halved as long as its cells stay within `cell_px`."""
    while len(texture) % 2 == 0 and 4.0 * size_px / len(texture) <= cell_px:
        texture = texture.reshape(len(texture) // 2, 2, -1, 2).mean(axis=(1, 3))
    return texture


def _best(jacobian: Array, plain: Array) -> Array:
    """The most likely nuisances. The noise is estimated from the residual; it scales the cost of one sigma."""
    ridge = float(plain @ plain) / len(plain)
    return np.asarray(np.linalg.solve(jacobian.T @ jacobian + ridge * np.eye(jacobian.shape[1]), jacobian.T @ plain))


def _look_up(texture: Array, flat: Array, turn: float) -> Array:
    """Bilinear reflectance at points of the plane, with the marker rotated by `turn` from X toward Y."""
    c, s = math.cos(turn), math.sin(turn)
    size = len(texture)
    x = np.clip((c * flat[:, 0] + s * flat[:, 1] + 1.0) * (size / 2.0) - 0.5, 0.0, size - 1.001)
    y = np.clip((1.0 + s * flat[:, 0] - c * flat[:, 1]) * (size / 2.0) - 0.5, 0.0, size - 1.001)
    i, j = x.astype(np.int64), y.astype(np.int64)
    x, y = x - i, y - j
    top = texture[j, i] * (1 - x) + texture[j, i + 1] * x
    return np.asarray(top * (1 - y) + (texture[j + 1, i] * (1 - x) + texture[j + 1, i + 1] * x) * y)


def _unexplained(value: Array, model: Array) -> float:
    """Residual sum of squares after two grey levels; lighter parts of the print must be lighter in the image."""
    centred, value = model - model.mean(), value - value.mean()
    power, common = float(centred @ centred), float(centred @ value)
    return float(value @ value) - (common**2 / power if power > 0 and common > 0 else 0.0)
