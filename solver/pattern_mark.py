"""A known print inside the circle as evidence: seen through both poses, over all turns in the plane.

Source of the idea: A. Pagani et al., Circular markers for camera pose estimation, WIAMIS (2011): rectify with both
poses and keep the one nearer to the expected pattern. Here the print is predicted where the pixels are, not the pixels
resampled, and the likelihood is that of the pixels with what is uncertain integrated out: ellipse, focal length,
principal point, turn, blur, grey levels and a slope of the light. Both poses differ inside the circle by a fraction of
a pixel: without those, a residual of the wrong cause would decide.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from roundel.scenes.camera import Camera, distort_px, distorts, undistort_px
from roundel.scenes.marker import Bar, Disc
from roundel.solver.ellipse import shape_of_ellipse
from roundel.solver.sighting import MISTAKES, Sighting, Verdict
from roundel.solver.viewing_cone import ViewingCone, viewing_cone

Array = NDArray[np.float64]

_MIN_PIXELS = 40
_MAX_PIXELS = 1200  # beyond, every n-th: the odds are clear by then
_TURNS = 90
_SETTLED = 1e-3  # of the residual's power
_NUDGE_PX = 0.1
_TURN_SIGMA = math.radians(10.0)  # about the best turn; wide, but no other maximum
_BLUR_SIGMA_PX = 0.1
_SURE = math.log(1e4)  # a model of a print is no better than that
_CELL_PX = 0.5  # cells of the texture at most; finer ones than half of this would be missed between the points below
# Aperture and blur of a pixel as points of a Fibonacci lattice (its size and the number before): along every edge, also
# one along the rows, they stand at as many distances as there are points.
_LATTICE, _FIBONACCI = 34, 21


@dataclass(frozen=True, eq=False)
class Pattern:
    """What is printed inside the outer circle.

    Attributes
    ----------
    texture : (n, n) array
        Reflectance over the square that encloses the outer circle: rows from the top (Y = +1 radius) down, columns from
        X = -1 radius to the right; the marker frame has X right, Y up.
    name : str
    """

    texture: Array
    name: str = "known pattern"

    def problem(self) -> str:
        """What is wrong with it; empty if nothing is."""
        t = np.asarray(self.texture)
        if t.ndim != 2 or t.shape[0] != t.shape[1] or t.shape[0] < 8 or not np.all(np.isfinite(t)):
            return "a pattern is a square array of at least 8 by 8 finite reflectances"
        return "" if np.ptp(t) > 0 else "a pattern of one shade tells nothing"

    def verdict(self, sighting: Sighting) -> Verdict:
        """Likelihood of the pixels inside the outer contour under both poses."""
        cone = viewing_cone(sighting)
        if cone is None or sighting.image is None or sighting.assumed is None or sighting.ellipse is None:
            return Verdict(0.0, f"{self.name}: not looked for, there is no image, ellipse or camera")
        margin = 1.0 + 2.5 * sighting.blur_px
        places, value = _inside(sighting.image, sighting.assumed.camera, sighting.ellipse, margin)
        if len(value) < _MIN_PIXELS:
            return Verdict(0.0, f"{self.name}: too few pixels inside the circle")
        print_ = _Print(
            np.asarray(self.texture, dtype=np.float64),
            cone,
            places,
            value,
            sighting.blur_px,
            float(sighting.ellipse[2]),
        )
        plain = value - print_.light @ np.linalg.lstsq(print_.light, value, rcond=None)[0]
        fits = [print_.fit(i) for i in range(2)]
        noise2 = max(min(fit.left for fit in fits) / max(len(value) - 12, 1), 1.0 / 12.0)
        total = float(plain @ plain)
        seen = 1.0 - min(fit.left for fit in fits) / max(total, 1e-12)
        if seen < 0.5:
            return Verdict(
                0.0, f"{self.name}: not seen, it explains {100 * max(seen, 0.0):.0f} % of the pixels' variance"
            )
        # One time in a hundred something else is printed there: then the pixels are as likely as without the pattern.
        other = math.log(MISTAKES) - 0.5 * total / noise2
        log = [float(np.logaddexp(math.log1p(-MISTAKES) + fit.log_likelihood(noise2), other)) for fit in fits]
        odds = max(-_SURE, min(_SURE, log[0] - log[1]))
        rms = [math.sqrt(fit.left / len(value)) for fit in fits]
        return Verdict(odds, f"{self.name}: it leaves {rms[0]:.3g} and {rms[1]:.3g} DN of the pixels under both poses")


@dataclass(frozen=True, eq=False)
class _Fit:
    """Residual and Jacobian of one candidate, both free of what levels and light explain."""

    residual: Array
    jacobian: Array  # by nuisances of unit variance
    left: float  # sum of squares after the best nuisances

    def log_likelihood(self, noise2: float) -> float:
        """Of the residual under N(0, noise2 I + J J^T), without the constant."""
        inner = np.eye(self.jacobian.shape[1]) + self.jacobian.T @ self.jacobian / noise2
        lean = self.jacobian.T @ self.residual
        explained = float(lean @ np.linalg.solve(inner, lean)) / noise2
        return -0.5 * (float(self.residual @ self.residual) - explained) / noise2 - 0.5 * float(
            np.linalg.slogdet(inner)[1]
        )


class _Print:
    """The print as both poses predict it in the pixels."""

    def __init__(
        self, texture: Array, cone: ViewingCone, places: Array, value: Array, blur_px: float, size_px: float
    ) -> None:
        self.cone, self.places, self.value, self.blur_px = cone, places, value, blur_px
        while len(texture) % 2 == 0 and 4.0 * size_px / len(texture) <= _CELL_PX:
            texture = texture.reshape(len(texture) // 2, 2, -1, 2).mean(axis=(1, 3))
        # Mean over a cell and a line from cell to cell blur by a sixth of a cell's square.
        self.texture, self.smooth = texture, (2.0 * size_px / len(texture)) ** 2 / 6.0
        # Cells of 1 to 2 px: a thin line then is as wide as the steps of the coarse turns.
        while len(texture) % 2 == 0 and 2.0 * size_px / len(texture) <= 1.0:
            texture = texture.reshape(len(texture) // 2, 2, -1, 2).mean(axis=(1, 3))
        self.soft = texture
        # X across one axis of the camera's, whichever is far from the normal; the turn is searched anyway.
        across = [np.cross(np.eye(3)[int(np.argmin(np.abs(n)))], n) for n in cone.normal[0]]
        self.x_axis = [axis / np.linalg.norm(axis) for axis in across]
        middle = places - places.mean(axis=0)
        self.light = np.column_stack([np.ones(len(value)), middle / np.abs(middle).max()])

    def fit(self, i: int) -> _Fit:
        """Best turn of candidate i, and the residual and Jacobian there."""
        turn = self._coarse_turn(i)
        jacobian, plain = self._linearise(i, turn)
        for _ in range(3):  # the coarse turn is a degree off
            turn += _TURN_SIGMA * float(np.clip(self._best(jacobian, plain)[-2], -0.2, 0.2))
            moved, less = self._linearise(i, turn)
            if float(less @ less) > (1.0 - _SETTLED) * float(plain @ plain):
                break
            jacobian, plain = moved, less
        left = plain - jacobian @ self._best(jacobian, plain)
        return _Fit(plain, jacobian, float(left @ left))

    def _coarse_turn(self, i: int) -> float:
        """The best turn to within a degree or so: over a softened print, then over the print itself."""
        flat = self._plane(i, 0, self.places)
        turns = np.arange(_TURNS) * (2.0 * math.pi / _TURNS)
        left = np.array([_unexplained(self.value, _look_up(self.soft, flat, t)) for t in turns])
        lowest = [j for j in range(_TURNS) if left[j] <= min(left[j - 1], left[(j + 1) % _TURNS])]
        lowest.sort(key=lambda j: float(left[j]))
        step = 2.0 * math.pi / (3 * _TURNS)
        near = [float(turns[j]) + d * step for j in lowest[:3] for d in (-1, 0, 1)]
        return min(near, key=lambda t: _unexplained(self.value, self._predict(i, self.places, t, self.blur_px)))

    def _best(self, jacobian: Array, plain: Array) -> Array:
        # A ridge of the noise itself, as the plain residual has it: what a nuisance of one sigma costs.
        ridge = float(plain @ plain) / len(plain)
        return np.asarray(
            np.linalg.solve(jacobian.T @ jacobian + ridge * np.eye(jacobian.shape[1]), jacobian.T @ plain)
        )

    def _linearise(self, i: int, turn: float) -> tuple[Array, Array]:
        """Jacobian by nuisances of unit variance (the last two are turn and blur), and the residual."""
        model = self._predict(i, self.places, turn, self.blur_px)
        columns, plain = self._levels(model)
        # The gain of the pattern in grey levels: what a change of the prediction changes in the pixels.
        gain = float(np.linalg.lstsq(columns, self.value, rcond=None)[0][-1])
        # A nuisance moves the print under a pixel; so would a step of the pixel, and all nuisances share its slopes.
        steps = _NUDGE_PX * np.eye(2)
        slopes = [self._predict(i, self.places + s, turn, self.blur_px) for s in (*steps, *-steps)]
        slope = np.stack([slopes[0] - slopes[2], slopes[1] - slopes[3]], axis=1) / (2.0 * _NUDGE_PX)
        flat = [self._plane(i, 0, self.places + s) for s in (*steps, *-steps)]
        stretch = np.stack([flat[0] - flat[2], flat[1] - flat[3]], axis=2) / (2.0 * _NUDGE_PX)
        moves = self.cone.spread(np.stack([self._plane(i, row, self.places) for row in range(len(self.cone.K))]))
        here = self._plane(i, 0, self.places)
        turned = _TURN_SIGMA * np.stack([here[:, 1], -here[:, 0]], axis=1)
        moves = np.concatenate([moves, turned[:, :, None]], axis=2)
        by_move = np.einsum("ni,nik->nk", slope, np.linalg.solve(stretch, moves))
        low = max(self.blur_px - _BLUR_SIGMA_PX, 0.0)
        high = self.blur_px + _BLUR_SIGMA_PX
        by_blur = self._predict(i, self.places, turn, high) - self._predict(i, self.places, turn, low)
        jacobian = gain * np.column_stack([by_move, by_blur * (_BLUR_SIGMA_PX / (high - low))])
        basis = np.linalg.qr(columns)[0]
        return jacobian - basis @ (basis.T @ jacobian), plain

    def _levels(self, model: Array) -> tuple[Array, Array]:
        """Columns that levels and light span, and what they leave of the pixels."""
        shaded = model[:, None] * self.light[:, 1:]
        columns = np.column_stack([self.light, shaded, model])
        return columns, self.value - columns @ np.linalg.lstsq(columns, self.value, rcond=None)[0]

    def _predict(self, i: int, places: Array, turn: float, blur_px: float) -> Array:
        """Mean reflectance in pixels at these places."""
        variance = max(blur_px**2 + 1.0 / 12.0 - self.smooth, 0.01)
        fine = places[:, None] + math.sqrt(variance) * _aperture()
        seen = _look_up(self.texture, self._plane(i, 0, fine.reshape(-1, 2)), turn)
        return np.asarray(seen.reshape(len(places), -1).mean(axis=1))

    def _plane(self, i: int, row: int, places: Array) -> Array:
        """Pixels to the marker's plane in radii (N, 2); axes that follow the normal without a turn of their own."""
        n, cone = self.cone.normal[row, i], self.cone.cone[row]
        c = -cone @ n / math.sqrt(float(n @ cone @ n))
        x_axis = self.x_axis[i] - float(n @ self.x_axis[i]) * n
        x_axis /= np.linalg.norm(x_axis)
        inverse = np.linalg.inv(self.cone.K[row])
        rays = places @ inverse[:, :2].T + inverse[:, 2]
        points = rays * (float(n @ c) / (rays @ n))[:, None] - c
        return np.stack([points @ x_axis, points @ np.cross(n, x_axis)], axis=1)


def _look_up(texture: Array, flat: Array, turn: float) -> Array:
    """Bilinear reflectance at points of the plane, the marker turned by `turn` from X toward Y."""
    c, s = math.cos(turn), math.sin(turn)
    size = len(texture)
    x = np.clip((c * flat[:, 0] + s * flat[:, 1] + 1.0) * (size / 2.0) - 0.5, 0.0, size - 1.001)
    y = np.clip((1.0 + s * flat[:, 0] - c * flat[:, 1]) * (size / 2.0) - 0.5, 0.0, size - 1.001)
    i, j = x.astype(np.int64), y.astype(np.int64)
    x, y = x - i, y - j
    top = texture[j, i] * (1 - x) + texture[j, i + 1] * x
    return np.asarray(top * (1 - y) + (texture[j + 1, i] * (1 - x) + texture[j + 1, i + 1] * x) * y)


def _aperture() -> Array:
    """Points (n, 2) of a normal distribution of variance 1."""
    i = np.arange(_LATTICE)
    points = ndtri(np.stack([(i + 0.5) / _LATTICE, (i * _FIBONACCI % _LATTICE + 0.5) / _LATTICE], axis=1))
    return np.asarray(points / points.std())


def _unexplained(value: Array, model: Array) -> float:
    """What two grey levels leave, sum of squares: the print's lighter parts must be the lighter ones."""
    centred, value = model - model.mean(), value - value.mean()
    power, common = float(centred @ centred), float(centred @ value)
    return float(value @ value) - (common**2 / power if power > 0 and common > 0 else 0.0)


def _inside(image: NDArray[Any], camera: Camera, ellipse: Array, margin_px: float) -> tuple[Array, Array]:
    """Undistorted places (N, 2) and grey levels (N,) of the pixels inside an ellipse, away from its edge."""
    height, width = image.shape
    middle = distort_px(camera, ellipse[:2])
    if not np.all(np.isfinite(middle)):
        return np.zeros((0, 2)), np.zeros(0)
    half = float(ellipse[2]) * (1.3 if distorts(camera) else 1.0) + 1.0
    x0, y0 = (max(0, math.floor(v - half)) for v in middle)
    x1, y1 = (min(limit, math.ceil(v + half) + 1) for v, limit in zip(middle, (width, height), strict=True))
    rows, columns = np.mgrid[y0 : max(y1, y0), x0 : max(x1, x0)]
    places = undistort_px(camera, np.stack([columns.ravel(), rows.ravel()], axis=1).astype(np.float64))
    theta = shape_of_ellipse(ellipse)
    shrunk = np.array([[theta[2], theta[3]], [theta[3], theta[4]]]) - margin_px * np.eye(2)
    if not shrunk[0, 0] * shrunk[1, 1] > shrunk[0, 1] ** 2 or shrunk[0, 0] <= 0:
        return np.zeros((0, 2)), np.zeros(0)
    within = np.sum(((places - theta[:2]) @ np.linalg.inv(shrunk)) ** 2, axis=1) < 1.0
    places, value = places[within], image[y0:y1, x0:x1].ravel()[within].astype(np.float64)
    every = -(-len(value) // _MAX_PIXELS)
    return places[::every], value[::every]


def pattern_of(
    reflectance: Callable[[Array, Array], ArrayLike], name: str = "known pattern", size: int = 256
) -> Pattern:
    """A pattern from a function of marker coordinates.

    Parameters
    ----------
    reflectance : callable
        Takes X and Y (arrays, in outer radii; X right, Y up), returns reflectances of the same shape.
    name : str
    size : int
        Cells a side; each is the mean of 16 points.
    """
    at = ((np.arange(4 * size) + 0.5) / (2 * size)) - 1.0
    x, y = np.meshgrid(at, -at)
    fine = np.broadcast_to(np.asarray(reflectance(x, y), dtype=np.float64), x.shape)
    return Pattern(fine.reshape(size, 4, size, 4).mean(axis=(1, 3)), name)


def pattern_of_shapes(
    shapes: Sequence[Disc | Bar], radius_m: float, paper: float, name: str = "known pattern"
) -> Pattern:
    """A pattern from the discs and bars that a marker is made of, painted in order (see `scenes.marker`)."""

    def reflectance(x: Array, y: Array) -> Array:
        out = np.full_like(x, paper)
        for shape in shapes:
            dx, dy = x * radius_m - shape.x_m, y * radius_m - shape.y_m
            if isinstance(shape, Disc):
                inside = np.hypot(dx, dy) < shape.radius_m
            else:
                c, s = math.cos(math.radians(shape.turn_deg)), math.sin(math.radians(shape.turn_deg))
                inside = (np.abs(c * dx + s * dy) < shape.length_m / 2) & (np.abs(c * dy - s * dx) < shape.width_m / 2)
            out[inside] = shape.reflectance
        return out

    return pattern_of(reflectance, name)


def orientation_tick(from_radii: float = 0.5, to_radii: float = 0.9, width_radii: float = 0.12) -> Pattern:
    """A bar of paper along +X in a disc of ink, as `roundel` prints it on the marker `disc_with_tick`."""
    return pattern_of(
        lambda x, y: ((x > from_radii) & (x < to_radii) & (np.abs(y) < width_radii / 2)) * 1.0, "orientation tick"
    )
