"""Homography from a plane to the image, by maximum likelihood from the ellipses of circles at known places in it.

The dual conic of a circle with centre c and radius r in the plane, Q* = [c c^T - r^2 I, c; c^T, 1], has the image
H Q* H^T: nothing is assumed about the camera, and the centre of an ellipse is not taken for the image of a centre.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.solver.fit.ellipse import FailedFit, inverse_of, shape_of_ellipse
from roundel.solver.fit.levenberg_marquardt import minimise
from roundel.solver.pose.coplanar_circles import shapes_of_spread
from roundel.solver.pose.direct_homography import homography

Array = NDArray[np.float64]

_COMPLEX_STEP = 1e-30


@dataclass(frozen=True, eq=False)
class PlaneHomography:
    """A homography and its covariance.

    Attributes
    ----------
    H : (3, 3) array
        Plane coordinates in metres to homogeneous pixels, of unit Frobenius norm, positive at the circles.
    cov : (9, 9) array
        Covariance of its elements, row by row; of rank 8.
    chi2, freedom : float, int
        Sum of the squared residuals, and the numbers less the unknowns.
    """

    H: Array
    cov: Array
    chi2: float
    freedom: int


def fit_homography(
    ellipses: ArrayLike, shape_covs: ArrayLike, centres_m: ArrayLike, radii_m: ArrayLike
) -> PlaneHomography | FailedFit:
    """Fit the homography that takes circles of a plane to their ellipses.

    Parameters
    ----------
    ellipses : (n, 5) array_like
        Of four circles or more, no three of them in a line, in undistorted pixels.
    shape_covs : (n, 5, 5) array_like
    centres_m : (n, 2) array_like
        The circles' centres in the plane.
    radii_m : (n,) array_like

    Returns
    -------
    PlaneHomography or FailedFit
    """
    e, covs = np.asarray(ellipses, dtype=np.float64), np.asarray(shape_covs, dtype=np.float64)
    c, r = np.asarray(centres_m, dtype=np.float64), np.asarray(radii_m, dtype=np.float64)
    if len(e) < 4:
        return FailedFit(f"a homography needs four circles; there are {len(e)}")
    # Both planes in units of their circles' extent: the matrix is then of order one, and its last element not zero.
    to_image, to_plane = _frame(e[:, :2]), _frame(c)
    image, plane = (e[:, :2] - to_image[:2, 2]) / to_image[0, 0], (c - to_plane[:2, 2]) / to_plane[0, 0]
    shapes = shape_of_ellipse(np.column_stack([image, e[:, 2:4] / to_image[0, 0], e[:, 4]]))
    r2 = (r / to_plane[0, 0]) ** 2
    try:
        whitening = np.linalg.inv(np.linalg.cholesky(covs)) * to_image[0, 0]
    except np.linalg.LinAlgError:
        return FailedFit("the covariance of an ellipse is not positive definite")
    dual = np.zeros((len(e), 3, 3))
    dual[:, :2, :2] = plane[:, :, None] * plane[:, None, :] - r2[:, None, None] * np.eye(2)
    dual[:, :2, 2] = dual[:, 2, :2] = plane
    dual[:, 2, 2] = 1.0

    def imaged(theta: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        h = np.concatenate([theta, np.ones_like(theta[..., :1])], axis=-1).reshape(*theta.shape[:-1], 1, 3, 3)
        d = h @ dual @ np.swapaxes(h, -1, -2)
        corner = d[..., 2:, 2]
        centre = d[..., :2, 2] / corner
        return centre, centre[..., :, None] * centre[..., None, :] - d[..., :2, :2] / corner[..., None], corner

    def rows(theta: Array) -> Array:
        centre, spread, _ = imaged(theta + 1j * _COMPLEX_STEP * np.eye(9, 8))
        whitened = (whitening @ (shapes_of_spread(centre, spread) - shapes)[..., None])[..., 0].reshape(9, -1)
        return np.concatenate([whitened[:-1].imag / _COMPLEX_STEP, whitened[-1:].real])

    def valid(theta: Array) -> bool:
        if not np.all(np.isfinite(theta)):
            return False
        _, spread, corner = imaged(theta)
        return bool(np.all(corner > 0) and np.all(spread[:, 0, 0] > 0) and np.all(np.linalg.det(spread) > 0))

    try:
        start = homography(plane, image).ravel()[:8]
    except ValueError as error:
        return FailedFit(str(error))
    if not valid(start):
        return FailedFit("the ellipses are not those of circles at these places")
    theta, at = minimise(start, rows, valid, 1e-12)
    inverse = inverse_of(at[:-1] @ at[:-1].T)
    if isinstance(inverse, FailedFit):
        return FailedFit("the circles do not determine a homography: three of four lie in a line")
    # To metres and pixels, of unit norm: both maps are linear in the elements, the norm has the derivative I - h h^T.
    between = np.kron(to_image, np.linalg.inv(to_plane).T)
    h = between @ np.append(theta, 1.0)
    norm = float(np.linalg.norm(h))
    rate = (np.eye(9) - np.outer(h, h) / norm**2) @ between[:, :8] / norm
    return PlaneHomography((h / norm).reshape(3, 3), rate @ inverse @ rate.T, float(at[-1] @ at[-1]), 5 * len(e) - 8)


def _frame(points: Array) -> Array:
    """Matrix (3, 3) from coordinates in units of the points' extent, with the origin at their mean."""
    middle = points.mean(axis=0)
    size = float(np.max(np.linalg.norm(points - middle, axis=1)))
    return np.array([[size, 0.0, middle[0]], [0.0, size, middle[1]], [0.0, 0.0, 1.0]])
