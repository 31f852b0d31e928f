"""Gurdjos: two or more parallel circles give the image of the circular points, by the pencils of their conics.

The images of two circles of one plane, or of parallel planes, meet in four points, of which two are the images of the
circular points. The pencil C1 - lambda C2 has three degenerate members, one for each generalised eigenvalue; each is a
pair of lines through the four points, and exactly one has the vanishing line v among its lines.

Choice of the member by its projective signature (#positive, #negative eigenvalues, as an unordered pair), and of the
line:

- two real eigenvalues and a double one, a member of rank 1, signature (1, 0): concentric circles, the line is v;
- three real eigenvalues: the member of signature (1, 1), a pair of real lines: v and the radical axis. The others,
  (2, 0), are points. A circle that is entirely in front of the camera does not meet v, and lies on the same side of it
  as all others: the radical axis of two circles beside each other lies between them;
- one real eigenvalue: the circles meet in two real points; its member is v and the common chord, which cuts both.

What remains: if one circle lies inside the other and they are not concentric, the radical axis lies outside both, like
v. Both lines are then returned; only a third circle, or a prior of the focal length, decides.

Cinf* follows from each circle and v, and is averaged (`dual_circular_points`).

Source: P. Gurdjos, P. Sturm, Y. Wu, Euclidean structure from N >= 2 parallel circles: theory and algorithms, ECCV
(2006), sections 3 to 5.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.geometry.conic import conic_of_ellipse, ellipse_of_conic
from roundel.solver.methods.plugin import Found, MethodFailure, View
from roundel.solver.pose.focal_uncertainty import MeasuredFocal, log_focal_sigma
from roundel.solver.views.dual_circular_points import (
    dual_circular_points,
    focal_from_dual,
    image_frame,
    moved_conic,
)
from roundel.solver.views.plane_of_view import (
    LARGEST_SIGMA,
    founds_in_plane,
    measurements,
    printed_circles,
)

Array = NDArray[np.float64]

# Relative difference of two eigenvalues that count as one: the root of the rounding of a conic, 1e-16 of 1, is 1e-8.
_DOUBLE = 1e-7
_NOISY = 0.3  # tolerance of `spread` for measured circles, whose noise is judged by its effect on the focal length
_MOST = 8  # circles of which all pairs are used
_UNIT_PX = 1000.0  # of the order of a focal length, so that the elements of a dual conic are of the same order


@dataclass(frozen=True, eq=False)
class CircularPoints:
    """A vanishing line with the dual conic of its circular points, in pixels.

    Attributes
    ----------
    line : (3,) array
        Unit norm, positive at the circles.
    dual : (3, 3) array
        Cinf*, mean over the circles, of unit Frobenius norm.
    spread : float
        RMS difference of the lines of all pairs of circles, in radians of homogeneous coordinates whose unit is the
        size of the image; 0 for one pair.
    """

    line: Array
    dual: Array
    spread: float

    def focal_px(self, principal_point: ArrayLike) -> float:
        """Focal length for square pixels and a known principal point.

        Raises
        ------
        ValueError
            If no focal length fits, or all do because the plane is parallel to the image.
        """
        frame = image_frame(principal_point, _UNIT_PX)
        return _UNIT_PX * focal_from_dual(frame @ self.dual @ frame.T)


def circular_points_of_circles(conics: ArrayLike, tolerance: float = 1e-6) -> list[CircularPoints]:
    """Images of the circular points of two or more parallel circles; all solutions.

    Parameters
    ----------
    conics : (n, 3, 3) array_like
        In undistorted pixels of any camera.
    tolerance : float
        Largest `spread` of more than two circles.

    Returns
    -------
    list of CircularPoints
        One; two for two circles one of which is inside the other, without being concentric.

    Raises
    ------
    ValueError
        If there is one circle only, or a conic is no ellipse, or two are the same; or if no line is a vanishing line of
        all circles, so that they are not parallel.
    """
    c = np.asarray(conics, dtype=np.float64)
    if c.ndim != 3 or len(c) < 2:
        raise ValueError("two parallel circles or more are needed; one circle alone has no pencil")
    ellipses = ellipse_of_conic(c)
    middle = ellipses[:, :2].mean(axis=0)
    size = float(np.max(np.hypot(*(ellipses[:, :2] - middle).T) + ellipses[:, 2]))
    frame = image_frame(middle, size)
    moved = moved_conic(c, frame)
    centres = np.column_stack([(ellipses[:, :2] - middle) / size, np.ones(len(c))])
    one, other = np.array(list(combinations(range(len(c)), 2))).T
    inverse = np.asarray(np.linalg.inv(moved), dtype=np.float64)
    pencils = lines_of_pencils(moved[one], moved[other])
    outside = [[line for line in lines if _clear(line, inverse, centres)] for lines in pencils]
    if not all(outside):
        raise ValueError(
            "the circles are not parallel: each line of their pencil meets one of them or separates them, so none is "
            "the vanishing line of all"
        )
    merged = [(line, 0.0) for line in outside[0]] if len(c) == 2 else _agreeing(outside, tolerance)
    out = []
    for line, spread in merged:
        line = np.copysign(1.0, centres[0] @ line) * line
        dual = dual_circular_points(moved, line).mean(axis=0)
        back = np.linalg.inv(frame)
        dual = back @ dual @ back.T
        in_px = line @ frame
        out.append(CircularPoints(in_px / np.linalg.norm(in_px), dual / np.linalg.norm(dual), spread))
    return out


def lines_of_pencils(first: Array, second: Array) -> list[list[Array]]:
    """Real lines of the degenerate members of pencils of two conics, of unit norm: two, or one that counts twice.

    Parameters
    ----------
    first, second : (m, 3, 3) arrays
        Positive inside, in coordinates of the order of one.
    """
    values = np.linalg.eigvals(np.linalg.solve(second, first))
    weights, vectors = np.linalg.eigh(first[:, None] - np.real(values)[..., None, None] * second[:, None])
    return [
        _double_line(first[i], second[i], real)
        if len(real) and close
        else _pairs_of_lines(weights[i], vectors[i], is_real)
        for i, (real, close, is_real) in enumerate(map(_sorted_out, values))
    ]


def _sorted_out(values: NDArray[np.number]) -> tuple[list[float], bool, NDArray[np.bool_]]:
    """Eigenvalues that are one within rounding (two of them), whether there are such, and which of all are real."""
    scale = float(np.max(np.abs(values)))
    real = np.abs(np.imag(values)) <= _DOUBLE * scale
    pairs = [(abs(a - b), [float(a), float(b)]) for a, b in combinations(np.real(values[real]).tolist(), 2)]
    gap, pair = min(pairs, default=(np.inf, []))
    return pair, gap <= _DOUBLE * scale, real


def _double_line(first: Array, second: Array, pair: list[float]) -> list[Array]:
    """The line of the member of rank 1."""
    weights, vectors = np.linalg.eigh(first - 0.5 * sum(pair) * second)
    return [np.asarray(vectors[:, int(np.argmax(np.abs(weights)))])]


def _pairs_of_lines(weights: Array, vectors: Array, real: NDArray[np.bool_]) -> list[Array]:
    """Both lines of each real member of signature (1, 1), from the eigenvalues (3, 3) of the members, ascending."""
    out: list[Array] = []
    for weight, vector in zip(weights[real], vectors[real], strict=True):
        # The one that is zero is in the middle.
        if weight[0] < 0 < weight[2] and abs(weight[1]) < min(-weight[0], weight[2]):
            plus, minus = np.sqrt(weight[2]) * vector[:, 2], np.sqrt(-weight[0]) * vector[:, 0]
            out += [line / np.linalg.norm(line) for line in (plus + minus, plus - minus)]
    return out


def _clear(line: Array, inverse: Array, centres: Array) -> bool:
    """Whether a line meets none of the ellipses, given by their inverse conics, and has all of them on one side."""
    side = centres @ line
    reach = (inverse @ line) @ line  # positive where it does not meet the ellipse
    return bool((np.all(side > 0) or np.all(side < 0)) and np.all(reach > 0))


def _agreeing(pairs: list[list[Array]], tolerance: float) -> list[tuple[Array, float]]:
    """The line on which all pairs agree best, oriented, and the RMS of their differences."""
    best: tuple[Array, float] | None = None
    for start in pairs[0]:
        mean = start
        for _ in range(3):
            chosen = np.array([max(lines, key=lambda line: abs(float(line @ mean))) for lines in pairs])
            mean = np.linalg.svd(chosen)[2][0]
        apart = np.linalg.norm(np.cross(chosen, mean), axis=1)
        spread = float(np.sqrt(np.mean(apart**2)))
        if best is None or spread < best[1]:
            best = mean, spread
    assert best is not None
    if best[1] > tolerance:
        raise ValueError(
            "the circles are not parallel: the vanishing lines of their pairs differ by "
            f"{best[1]:.2g} of the image's size"
        )
    return [best]


def find(view: View) -> list[Found]:
    """Focal length, and a pose of each of two or more parallel circles."""
    circles, diameters_m = printed_circles(view, 2)
    ellipses, covs = measurements(circles)
    measured = measured_focal(ellipses, covs, view.camera.K)
    if measured is not None and not measured.sigma <= LARGEST_SIGMA:
        measured = None
    return founds_in_plane(view, circles, diameters_m, measured)


def measured_focal(ellipses: Array, shape_covs: Array, K: Array) -> MeasuredFocal | None:
    """Focal length of noisy ellipses by the closed form; None if there is none. The focal length of K is not used.

    Of many circles, eight that are far apart are used: all pairs of 32 would take minutes, and tell little more.

    Raises
    ------
    MethodFailure
        If the circles are not parallel, or two solutions remain.
    """
    far = _far_apart(ellipses[:, :2], _MOST)
    ellipses, shape_covs = ellipses[far], shape_covs[far]
    square = np.eye(3)
    square[:2, :2] = K[:2, :2] / K[0, 0]
    square[:2, 2] = K[:2, 2]

    def solutions(of: Array, tolerance: float) -> list[CircularPoints]:
        return circular_points_of_circles(square.T @ conic_of_ellipse(of) @ square, tolerance)

    def focal_of(of: Array) -> float:
        return solutions(of, 1.0)[0].focal_px([0.0, 0.0])

    # The line of a pair of circles is as wrong as the noise over the pair's extent, times the distance of the line.
    try:
        found = solutions(ellipses, _NOISY)
    except ValueError as error:
        raise MethodFailure(str(error)) from error
    if len(found) > 1:
        raise MethodFailure("one circle is inside the other, and not concentric: two vanishing lines remain")
    try:
        focal = focal_of(ellipses)
    except ValueError:
        return None
    return MeasuredFocal(focal, log_focal_sigma(focal_of, ellipses, shape_covs))


def _far_apart(points: Array, count: int) -> list[int]:
    """Indices of `count` points, each in turn the farthest from those before it."""
    chosen = [int(np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1)))]
    while len(chosen) < min(count, len(points)):
        apart = np.linalg.norm(points[:, None] - points[chosen], axis=2).min(axis=1)
        chosen.append(int(np.argmax(apart)))
    return chosen
