"""The pixels of a print as one pose predicts them, with derivatives by every uncertain parameter.

The print is sampled on a grid finer than the pixels, blurred there, and averaged over each pixel, and the gradients of
the prediction come from the same grid. What the grid misses of an edge has to stay below the noise of a pixel: errors
of the prediction that do not average out decide for the wrong pose with certainty, because the two poses differ by
hundredths of a pixel. Far markers, whose prints have few pixels, get the finest grid.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import distort_px, distorts, undistort_px
from roundel.solver.ambiguity.observation import Observation
from roundel.solver.ambiguity.viewing_cone import ViewingCone
from roundel.solver.fit.ellipse import shape_of_ellipse
from roundel.solver.kernels.texture_lookup import reflectance_at

Array = NDArray[np.float64]

_MIN_PIXELS = 40
_MAX_PIXELS = 1200  # with more, every n-th is used: the odds are decisive by then
_ROUGH, _FINEST = 2, 8  # points of the finer grids per pixel and side
_ACROSS = 160  # points of the finest grid along a semi-axis
_RIM = 0.8  # of the region's radius: beyond it most pixels are of the ink along the contour
_LIKE_INK = 5.0  # median deviations from the ink's median: beyond are pixels of the print
_TURNS = 90
_TURN_SIGMA = math.radians(10.0)  # around the best rotation; wide, but without another maximum
_BLUR_SIGMA_PX = 0.1
_SETTLED = 1e-3  # of the residual's power
_ROUNDS = 6
_COARSE = 2.0 * math.pi / (3 * _TURNS)  # the step of the coarse rotations


@dataclass(frozen=True, eq=False)
class Region:
    """The pixels inside a contour, away from its edge, in a box of the image.

    Attributes
    ----------
    index : (N,) array
        Indices of the pixels in the box, row by row.
    value : (N,) array
        Their grey levels.
    weight : (N,) array
        One over the standard deviation of each pixel, relative to that of a pixel of ink where the noise is known.
    places : (N, 2) array
        Their centres in undistorted pixels.
    shape : (int, int)
        Height and width of the box, pixels.
    grids : dict
        Undistorted positions (height * n * width * n, 2) of finer grids over the box, by their points n per pixel and
        side: `_ROUGH` and `scale`.
    scale : int
    stretch : (N, 2, 2) array
        Derivative of `places` with respect to image pixels.
    size_px : float
        Semi-major axis of the contour.
    """

    index: NDArray[np.int64]
    value: Array
    weight: Array
    places: Array
    shape: tuple[int, int]
    grids: dict[int, Array]
    scale: int
    stretch: Array
    size_px: float


def region_inside(observation: Observation) -> Region | None:
    """The region inside the contour of an observation with image, ellipse and camera; None if it has too few pixels."""
    image, ellipse, blur_px = observation.image, observation.ellipse, observation.blur_px
    if image is None or ellipse is None or observation.uncertain_camera is None:
        return None
    camera = observation.uncertain_camera.camera
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
    radius2 = np.sum(((flat - theta[:2]) @ np.linalg.inv(shrunk)) ** 2, axis=1)
    index = np.flatnonzero(radius2 < 1.0)
    if len(index) < _MIN_PIXELS:
        return None
    index = index[:: -(-len(index) // _MAX_PIXELS)]
    stretch = np.stack([np.gradient(whole, axis=1), np.gradient(whole, axis=0)], axis=-1).reshape(-1, 2, 2)[index]
    scale = max(_ROUGH, min(_FINEST, round(_ACROSS / float(ellipse[2]))))
    grids = {n: grid(n).reshape(-1, 2) for n in {_ROUGH, scale}}
    # Corners of the box may be outside the lens's field; they are not used.
    grids = {n: np.where(np.isfinite(points), points, 0.0) for n, points in grids.items()}
    value = image[y0:y1, x0:x1].ravel()[index].astype(np.float64)
    weight = _weights(value, value[radius2[index] > _RIM**2], observation)
    return Region(index, value, weight, flat[index], (y1 - y0, x1 - x0), grids, scale, stretch, float(ellipse[2]))


def _weights(value: Array, rim: Array, observation: Observation) -> Array:
    """Weights of pixels whose variance grows linearly from that of the ink to that of the paper (shot noise).

    They are taken from the pixels, not from a prediction, so that both candidates have the same. The noise of the ink
    is that of the pixels `rim` along the contour without those of the print: the fit of the contour takes the print's
    edges for noise.
    """
    if observation.noise_dn is None or not observation.contrast_dn:
        return np.ones(len(value))
    ink = float(np.median(rim))
    near = rim[np.abs(rim - ink) < _LIKE_INK * max(float(np.median(np.abs(rim - ink))), 0.5)]
    inside, outside = (
        min(observation.noise_dn[0] ** 2, max(float(np.var(near)), 1.0 / 12.0)),
        observation.noise_dn[1] ** 2,
    )
    share = np.clip((value - ink) / observation.contrast_dn, 0.0, 1.0)
    return np.asarray(np.sqrt(inside / (inside + (outside - inside) * share)))


@dataclass(frozen=True, eq=False)
class PrintFit:
    """Weighted residual and Jacobian of one candidate, both projected free of grey levels and light."""

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
        self.homography = [self._homography(i, 0) for i in range(2)]
        middle = region.places - region.places.mean(axis=0)
        self.light = np.column_stack([np.ones(len(middle)), middle / np.abs(middle).max()])

    def fit(self, i: int) -> PrintFit:
        """Best rotation of candidate i, and the residual and Jacobian there."""
        turn = self._coarse_turn(i)
        jacobian, plain = self._linearise(i, turn)
        for _ in range(_ROUNDS):
            step = _TURN_SIGMA * float(_best(jacobian, plain)[-2])
            step = max(-_COARSE, min(_COARSE, step))
            gained = 0.0
            # An edge of the print that leaves its pixels is not linear in the rotation: shorter steps are tried, too.
            for part in (1.0, 0.3):
                moved, less = self._linearise(i, turn + part * step)
                gained = float(plain @ plain) - float(less @ less)
                if gained > 0:
                    jacobian, plain, turn = moved, less, turn + part * step
                    break
            if gained < _SETTLED * float(plain @ plain):
                break
        left = plain - jacobian @ _best(jacobian, plain)
        return PrintFit(plain, jacobian, float(left @ left))

    def _coarse_turn(self, i: int) -> float:
        """The best rotation to about a degree: with a smoothed print first, then with the print itself."""
        places, onto = self.region.places, self.homography[i]
        turns = np.arange(_TURNS) * (2.0 * math.pi / _TURNS)
        left = np.array([_unexplained(self.region.value, reflectance_at(self.soft, onto, places, t)) for t in turns])
        lowest = [j for j in range(_TURNS) if left[j] <= min(left[j - 1], left[(j + 1) % _TURNS])]
        lowest.sort(key=lambda j: float(left[j]))
        near = [float(turns[j]) + d * _COARSE for j in lowest[:3] for d in (-1, 0, 1)]

        def left_at(t: float) -> float:
            return _unexplained(self.region.value, self._blurred(self._drawn(i, t, _ROUGH), self.blur_px, _ROUGH)[0])

        return min(near, key=left_at)

    def _linearise(self, i: int, turn: float) -> tuple[Array, Array]:
        """Jacobian for nuisances of unit variance (the last two are rotation and blur), and the residual."""
        scale = self.region.scale
        drawn = self._drawn(i, turn, scale)
        model, slope = self._blurred(drawn, self.blur_px, scale)
        shaded = model[:, None] * self.light[:, 1:]
        columns = np.column_stack([self.light, shaded, model])
        weight = self.region.weight
        columns *= weight[:, None]
        levels = np.linalg.lstsq(columns, weight * self.region.value, rcond=None)[0]
        plain = weight * self.region.value - columns @ levels
        # A nuisance moves the print under a pixel, like a step of the pixel, so all nuisances share its gradients.
        places, nudge = self.region.places, 0.1 * np.eye(2)
        here = self._plane(i, 0, places)
        onto = np.stack([self._plane(i, 0, places + d) - self._plane(i, 0, places - d) for d in nudge], axis=-1) / 0.2
        moves = self.cone.spread(np.stack([self._plane(i, row, places) for row in range(len(self.cone.K))]))
        turned = _TURN_SIGMA * np.stack([here[:, 1], -here[:, 0]], axis=1)
        moves = np.concatenate([moves, turned[:, :, None]], axis=2)
        by_move = np.einsum("ni,nik->nk", slope, np.linalg.solve(onto @ self.region.stretch, moves))
        by_blur = self._blurred(drawn, self.blur_px + _BLUR_SIGMA_PX, scale)[0] - model
        # The last level is the gain of the print, from a change of the prediction to one of the pixels.
        jacobian = float(levels[-1]) * weight[:, None] * np.column_stack([by_move, by_blur])
        basis = np.linalg.qr(columns)[0]
        return jacobian - basis @ (basis.T @ jacobian), plain

    def _drawn(self, i: int, turn: float, n: int) -> Array:
        """The print on a finer grid of n points per pixel and side, before blurring."""
        height, width = self.region.shape
        return reflectance_at(self.texture, self.homography[i], self.region.grids[n], turn).reshape(
            height * n, width * n
        )

    def _blurred(self, drawn: Array, blur_px: float, n: int) -> tuple[Array, Array]:
        """Mean reflectance (N,) of each pixel, and its gradient (N, 2) with respect to the pixel's position."""
        from scipy.ndimage import gaussian_filter

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

    def _homography(self, i: int, row: int) -> Array:
        """Undistorted pixels to the marker's plane in radii (3, 3); the axes follow the normal without rotation."""
        n, cone = self.cone.normal[row, i], self.cone.cone[row]
        c = -cone @ n / math.sqrt(float(n @ cone @ n))
        x_axis = self.x_axis[i] - float(n @ self.x_axis[i]) * n
        x_axis /= np.linalg.norm(x_axis)
        # A ray p meets the plane in p (n.c) / (n.p), of which c is the origin.
        rows = [float(n @ c) * axis - float(axis @ c) * n for axis in (x_axis, np.cross(n, x_axis))]
        return np.asarray(np.stack([*rows, n]) @ np.linalg.inv(self.cone.K[row]))

    def _plane(self, i: int, row: int, places: Array) -> Array:
        """Points of the marker's plane in radii (N, 2) at undistorted pixels."""
        h = self._homography(i, row)
        points = places @ h[:, :2].T + h[:, 2]
        return np.asarray(points[:, :2] / points[:, 2:])


def _coarser(texture: Array, size_px: float, cell_px: float) -> Array:
    """The texture, halved as long as its cells stay within `cell_px`."""
    while len(texture) % 2 == 0 and 4.0 * size_px / len(texture) <= cell_px:
        texture = texture.reshape(len(texture) // 2, 2, -1, 2).mean(axis=(1, 3))
    return texture


def _best(jacobian: Array, plain: Array) -> Array:
    """The most likely nuisances. The noise is estimated from the residual; it scales the cost of one sigma."""
    ridge = float(plain @ plain) / len(plain)
    return np.asarray(np.linalg.solve(jacobian.T @ jacobian + ridge * np.eye(jacobian.shape[1]), jacobian.T @ plain))


def _unexplained(value: Array, model: Array) -> float:
    """Residual sum of squares after two grey levels; lighter parts of the print must be lighter in the image."""
    centred, value = model - model.mean(), value - value.mean()
    power, common = float(centred @ centred), float(centred @ value)
    return float(value @ value) - (common**2 / power if power > 0 and common > 0 else 0.0)
