"""Maximum likelihood for circles of one plane: focal length, normal, centres and radii from their ellipses.

The parameters are log f, the plane (p, q, 1) . X = 1, for each circle the image of its centre, and log (f radius),
which is nearly the logarithm of its size in the image. A plane's distance is not determined without a radius in metres,
so the plane has depth 1 on the optical axis. The dual conic of a circle's image is K (c c^T + r^2 (n n^T - I)) K^T
(errata, section 2); its ellipse is compared with the measured one by the shape parameters (x, y, S11, S12, S22), which
are regular for circles, and the derivatives are exact by complex steps.

Two circles give ten numbers for nine unknowns, two concentric ones ten for seven. Parallel planes are not told from one
plane: a circle of another plane has the same image as a circle of another radius in this one.

The standard deviation of log f is not that of the curvature at the minimum, which says little near a plane that is
parallel to the image, and too little about long focal lengths, because the perspective that measures f is proportional
to 1 / f. It is the distance to the farther end of the 95 % interval of the profile of the likelihood, over 1.96.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.solver.fit.ellipse import FailedFit, inverse_of, shape_of_ellipse
from roundel.solver.fit.levenberg_marquardt import minimise

Array = NDArray[np.float64]

# Focal lengths in units of the distance from the principal point to the farthest ellipse: beyond a field of 170 degrees
# or below one of a degree, log f runs away with the noise.
_SHORTEST, _LONGEST = 0.08, 120.0
_STEEPEST = 30.0  # tangent of the tilt; beyond 88 degrees an ellipse has no width
_LARGEST = 10.0  # logarithm of a size in the image, in units of it: beyond any circle that fits in
_COMPLEX_STEP = 1e-30
QUANTILE = 1.96  # of the normal distribution: 95 % lie within as many standard deviations
_LARGEST_SIGMA = 1.0  # of log f: a factor of three is no measurement


@dataclass(frozen=True, eq=False)
class CoplanarFit:
    """The plane of some circles, and the focal length.

    Attributes
    ----------
    focal_px : float
    focal_sigma : float
        Standard deviation of log f; infinite if the image does not determine it, 0 if it was given.
    normal : (3,) array
        Unit normal toward the camera.
    centre : (n, 3) array
        Centres in the camera frame, in units of the plane's depth on the optical axis.
    radius : (n,) array
        Radii in the same unit.
    chi2 : float
        Sum of the squared residuals, with the given covariances.
    freedom : int
        Numbers less unknowns: the mean of `chi2` if the circles lie in one plane (and, where asked, are concentric, or
        have these ratios of radii).
    """

    focal_px: float
    focal_sigma: float
    normal: Array
    centre: Array
    radius: Array
    chi2: float
    freedom: int


class _Unknowns(NamedTuple):
    """The unknowns of some circles, in square pixels with the principal point at the origin; complex in derivatives."""

    log_focal: NDArray[Any]  # (..., 1)
    plane: NDArray[Any]  # (..., 2)
    middle: NDArray[Any]  # (..., n, 2)
    size: NDArray[Any]  # (..., n)

    def centre_and_spread(self) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        """Centre (..., n, 2) and S S^T (..., n, 2, 2) of the ellipses, and the corner of the dual conic (..., n, 1)."""
        f = np.exp(self.log_focal)[..., None]
        m = np.concatenate([self.plane, np.ones_like(self.plane[..., :1])], axis=-1)[..., None, :]
        ray = np.concatenate([self.middle / f, np.ones_like(self.middle[..., :1])], axis=-1)
        c = ray / np.sum(ray * m, axis=-1, keepdims=True)
        r2 = (np.exp(self.size)[..., None] / f) ** 2
        n = m / np.sqrt(np.sum(m * m, axis=-1, keepdims=True))
        outer = c[..., :2, None] * c[..., None, :2] + r2[..., None] * (n[..., :2, None] * n[..., None, :2] - np.eye(2))
        corner = c[..., 2:] ** 2 + r2 * (n[..., 2:] ** 2 - 1.0)
        centre = (c[..., :2] * c[..., 2:] + r2 * n[..., :2] * n[..., 2:]) * f / corner
        spread = centre[..., :, None] * centre[..., None, :] - outer * f[..., None] ** 2 / corner[..., None]
        return centre, spread, corner

    def shapes(self, pixels: Array) -> NDArray[Any]:
        """Shape parameters (..., n, 5) in the image's pixels; analytic, so that complex steps give derivatives."""
        centre, m, _ = self.centre_and_spread()
        return shapes_of_spread(centre @ pixels.T, pixels @ m @ pixels.T)


@dataclass(frozen=True, eq=False)
class _Problem:
    shapes: Array  # (n, 5) measured, the principal point at the origin, in units of the image's size
    whitening: Array  # (n, 5, 5)
    pixels: Array  # (2, 2) from square pixels to those of the image: K[:2, :2] / fx
    concentric: bool
    relative_radii: Array | None
    log_focal: float | None

    def rows(self, theta: Array) -> Array:
        """Derivatives of the whitened residuals by theta, then the residuals: (P + 1, 5 n)."""
        count = len(theta)
        steps = theta + 1j * _COMPLEX_STEP * np.eye(count + 1, count)
        made = self.unpacked(steps).shapes(self.pixels)
        whitened = (self.whitening @ (made - self.shapes)[..., None])[..., 0].reshape(count + 1, -1)
        return np.concatenate([whitened[:-1].imag / _COMPLEX_STEP, whitened[-1:].real])

    def unpacked(self, theta: NDArray[Any]) -> _Unknowns:
        """The unknowns of parameters (..., P)."""
        n = len(self.shapes)
        if self.log_focal is not None:
            theta = np.concatenate([np.full_like(theta[..., :1], self.log_focal), theta], axis=-1)
        centres = 1 if self.concentric else n
        middle = theta[..., 3 : 3 + 2 * centres].reshape(*theta.shape[:-1], centres, 2)
        size = theta[..., 3 + 2 * centres :]
        if self.relative_radii is not None:
            size = size + np.log(self.relative_radii)
        return _Unknowns(theta[..., :1], theta[..., 1:3], np.broadcast_to(middle, (*theta.shape[:-1], n, 2)), size)

    def valid(self, theta: Array) -> bool:
        """Whether the parameters are those of circles in front of a camera."""
        if not np.all(np.isfinite(theta)):
            return False
        unknowns = self.unpacked(theta)
        log_focal, plane = float(unknowns.log_focal[0]), unknowns.plane
        if not math.log(_SHORTEST) < log_focal < math.log(_LONGEST) or float(np.hypot(*plane)) > _STEEPEST:
            return False
        depth = 1.0 + unknowns.middle @ plane / math.exp(log_focal)
        if not (np.all(depth > 1e-6) and np.all(unknowns.size < _LARGEST)):
            return False
        _, spread, corner = unknowns.centre_and_spread()
        return bool(np.all(corner > 0) and np.all(spread[..., 0, 0] > 0) and np.all(np.linalg.det(spread) > 0))

    def minimum(self, theta: Array) -> tuple[Array, Array] | None:
        """Parameters and rows at the minimum; None if the start is invalid."""
        return minimise(theta, self.rows, self.valid, 1e-12) if self.valid(theta) else None


def fit_coplanar(
    ellipses: ArrayLike,
    shape_covs: ArrayLike,
    K: ArrayLike,
    normal: ArrayLike,
    *,
    concentric: bool = False,
    relative_radii: ArrayLike | None = None,
    focal_known: bool = False,
) -> CoplanarFit | FailedFit:
    """Fit one plane to the ellipses of its circles, from a start.

    Parameters
    ----------
    ellipses : (n, 5) array_like
        x_px, y_px, a_px, b_px, angle_deg in undistorted pixels.
    shape_covs : (n, 5, 5) array_like
        Covariances of their shape parameters, `EllipseFit.shape_cov`.
    K : (3, 3) array_like
        Its principal point, fy / fx and skew / fx are taken as exact; fx is the focal length to start from.
    normal : (3,) array_like
        The normal to start from, toward the camera.
    concentric : bool
        Whether the circles have one centre.
    relative_radii : (n,) array_like, optional
        Ratios of their radii, if they are known.
    focal_known : bool
        Whether the focal length of K is exact, too.

    Returns
    -------
    CoplanarFit or FailedFit
    """
    e, covs = np.asarray(ellipses, dtype=np.float64), np.asarray(shape_covs, dtype=np.float64)
    n = np.asarray(normal, dtype=np.float64)
    k = np.asarray(K, dtype=np.float64)
    e = e - np.concatenate([k[:2, 2], np.zeros(3)])
    size = float(np.max(np.hypot(e[:, 0], e[:, 1]) + e[:, 2]))
    scaled = e / np.array([size, size, size, size, 1.0])
    try:
        whitening = np.linalg.inv(np.linalg.cholesky(covs)) * size
    except np.linalg.LinAlgError:
        return FailedFit("the covariance of an ellipse is not positive definite")
    if n[2] >= 0 or k[0, 0] <= 0:
        return FailedFit("the start is not a plane that faces the camera")
    relative = None if relative_radii is None else np.asarray(relative_radii, dtype=np.float64)
    log_focal = math.log(k[0, 0] / size)
    problem = _Problem(
        shape_of_ellipse(scaled),
        whitening,
        k[:2, :2] / k[0, 0],
        concentric,
        relative,
        log_focal if focal_known else None,
    )
    theta = _start(log_focal, n[:2] / n[2], problem)
    found = problem.minimum(theta)
    if found is None:
        return FailedFit("the start is not a plane with these circles in front of the camera")
    theta, rows = found
    cov = inverse_of(rows[:-1] @ rows[:-1].T)
    chi2 = float(rows[-1] @ rows[-1])
    unknowns = problem.unpacked(theta)
    sigma = 0.0
    if not focal_known:
        first = math.inf if isinstance(cov, FailedFit) else math.sqrt(max(float(cov[0, 0]), 0.0))
        sigma = _profile_sigma(problem, theta, chi2, first)
    f = math.exp(float(unknowns.log_focal[0]))
    m = np.append(unknowns.plane, 1.0)
    rays = np.concatenate([unknowns.middle / f, np.ones((len(e), 1))], axis=1)
    return CoplanarFit(
        focal_px=f * size,
        focal_sigma=sigma,
        normal=-m / np.linalg.norm(m),
        centre=rays / (rays @ m)[:, None],
        radius=np.exp(unknowns.size) / f,
        chi2=chi2,
        freedom=5 * len(e) - len(theta),
    )


def _start(log_focal: float, plane: Array, problem: _Problem) -> Array:
    """Parameters that reproduce the centres and areas of the ellipses with this focal length and plane."""
    f = math.exp(log_focal)
    line = np.append(plane / f, 1.0)
    # The pole of the vanishing line: o ~ C* v, with C* ~ [e e^T - M, e; e^T, 1].
    square = np.linalg.inv(problem.pixels)
    e, s = problem.shapes[:, :2] @ square.T, problem.shapes[:, 2:]
    root = square @ np.stack([s[:, :2], s[:, 1:]], axis=-2)
    spread = root @ np.swapaxes(root, -1, -2)
    weight = e @ line[:2] + 1.0
    middle = e - (spread @ line[:2]) / weight[:, None]
    size = 0.25 * np.log(np.linalg.det(spread))
    # The size in the image is proportional to the radius, but for the bend by its own width. A start that is no plane
    # of ellipses gives numbers that are not finite, which `valid` refuses.
    with np.errstate(invalid="ignore", divide="ignore"):
        for _ in range(3):
            made = _Unknowns(np.array([log_focal]), plane, middle, size).shapes(np.eye(2))[:, 2:]
            size = size + 0.5 * np.log(np.linalg.det(spread) ** 0.5 / (made[:, 0] * made[:, 2] - made[:, 1] ** 2))
    if problem.concentric:
        middle = middle.mean(axis=0, keepdims=True)
    if problem.relative_radii is not None:
        size = np.mean(size - np.log(problem.relative_radii), keepdims=True)
    theta = np.concatenate([[log_focal], plane, middle.ravel(), size])
    return theta if problem.log_focal is None else theta[1:]


def shapes_of_spread(centre: NDArray[Any], spread: NDArray[Any]) -> NDArray[Any]:
    """Shape parameters (..., 5) of ellipses from their centres (..., 2) and M = S S^T (..., 2, 2).

    S = (M + sqrt(det M) I) / sqrt(tr M + 2 sqrt(det M)); analytic in all elements.
    """
    m11, m12, m22 = spread[..., 0, 0], spread[..., 0, 1], spread[..., 1, 1]
    root = np.sqrt(m11 * m22 - m12**2)
    scale = np.sqrt(m11 + m22 + 2.0 * root)
    s = np.stack([(m11 + root) / scale, m12 / scale, (m22 + root) / scale], axis=-1)
    return np.concatenate([centre, s], axis=-1)


def _profile_sigma(problem: _Problem, theta: Array, chi2: float, first: float) -> float:
    """1 / 1.96 of the larger distance in log f at which the least chi2 of the others has risen by 1.96^2."""
    if not first < _LARGEST_SIGMA:
        return math.inf
    largest = QUANTILE * first
    for side in (-1.0, 1.0):
        reach = QUANTILE * first
        for _ in range(8):
            log_focal = float(theta[0]) + side * reach
            found = replace(problem, log_focal=log_focal).minimum(theta[1:])
            rise = math.inf if found is None else float(found[1][-1] @ found[1][-1]) - chi2
            if rise > 0.9 * QUANTILE**2:  # within a twentieth of the distance
                break
            reach *= min(QUANTILE / math.sqrt(max(rise, 0.1)), 3.0)
            if reach > QUANTILE * _LARGEST_SIGMA:
                return math.inf
        largest = max(largest, reach)
    return largest / QUANTILE
