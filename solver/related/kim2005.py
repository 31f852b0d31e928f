"""Kim 2005: two concentric circles give the image of their centre, the vanishing line, and the focal length.

Scaled so that C_i = H^-T diag(1, 1, -r_i^2) H^-1, the images of two concentric circles differ by

    C1 - C2 = (r2^2 - r1^2) H^-T e3 e3^T H^-1 ~ v v^T:

the vanishing line v counts twice in their pencil. C2^-1 C1 has the eigenvalues 1, 1 and r1^2 / r2^2, up to their common
scale; the eigenvector of the odd one is the image o of the centre, and v ~ C1 o ~ C2 o. Noise splits the double
eigenvalue; o belongs to the odd one still, and v is the mean of both polars. The points in which v meets the conics
are the images of the circular points, which give the focal length for a known principal point and square pixels.

One eigenvector of three is ill-conditioned where the radii are nearly equal, so images are fitted jointly
(`roundel.solver.pose.coplanar_circles`, concentric, from this start).

Source: J.-S. Kim, P. Gurdjos, I.-S. Kweon, Geometric and algebraic constraints of projected concentric circles and
their applications to camera calibration, IEEE Trans. PAMI 27(4) (2005), sections 3 and 4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.geometry.conic import ellipse_of_conic
from roundel.solver.related.dual_circular_points import (
    dual_circular_points,
    focal_from_dual,
    image_frame,
    line_from_centre,
    moved_conic,
)

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ConcentricPair:
    """What two concentric circles tell of their plane, without a camera.

    Attributes
    ----------
    centre_px : (2,) array
        Image of the common centre.
    line : (3,) array
        Vanishing line, of unit norm.
    ratio : float
        Radius of the outer circle over that of the inner one.
    eccentricity : float
        Relative difference of the two eigenvalues that are equal for concentric circles: about the square of the
        distance between both centres in radii.
    """

    centre_px: Array
    line: Array
    ratio: float
    eccentricity: float


def concentric_pair(outer: ArrayLike, inner: ArrayLike, tolerance: float = 1e-5) -> ConcentricPair:
    """Centre and vanishing line of two concentric circles.

    Parameters
    ----------
    outer, inner : (3, 3) array_like
        Images of the circles, in undistorted pixels of any camera.
    tolerance : float
        Largest `eccentricity`. The equal eigenvalues of exact conics differ by the root of the rounding, 1e-7.

    Raises
    ------
    ValueError
        If a conic is not an ellipse, `inner` is not inside `outer`, or the circles are not concentric.
    """
    c1, c2 = np.asarray(outer, dtype=np.float64), np.asarray(inner, dtype=np.float64)
    x, y, a, b, angle = ellipse_of_conic(c1)
    ellipse_of_conic(c2)
    cos, sin = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    # Coordinates in which the outer circle's image is the unit circle: everything is of order one.
    to_px = np.array([[a * cos, -b * sin, x], [a * sin, b * cos, y], [0.0, 0.0, 1.0]])
    unit = np.diag([-1.0, -1.0, 1.0])
    second = moved_conic(c2, np.linalg.inv(to_px))
    values, vectors = np.linalg.eig(np.linalg.solve(second, unit))
    odd = _odd(values)
    others = np.delete(values, odd)
    double = float(np.real(np.mean(others)))
    ratio2 = float(np.real(values[odd])) / double
    if not ratio2 > 1.0 or second[2, 2] <= 0:
        raise ValueError(
            "the second circle is not inside the first: are the radii swapped? The outer circle has to come first"
        )
    eccentricity = float(np.abs(others[0] - others[1]) / np.abs(double))
    if eccentricity > tolerance:
        raise ValueError(
            f"the circles are not concentric: two eigenvalues of their pencil differ by {eccentricity:.2g} of their size"
        )
    o = np.real(vectors[:, odd])
    if abs(o[2]) <= np.hypot(o[0], o[1]):
        raise ValueError("the circles are not concentric: the pole of their pencil is outside the outer one")
    o = o / o[2]
    polars = line_from_centre(np.stack([unit, second]), o)
    line = polars[0] + np.copysign(1.0, polars[0] @ polars[1]) * polars[1]
    line = line @ np.linalg.inv(to_px)
    return ConcentricPair((to_px @ o)[:2], line / np.linalg.norm(line), float(np.sqrt(ratio2)), eccentricity)


def focal_of_concentric(
    outer: ArrayLike, inner: ArrayLike, principal_point: ArrayLike, tolerance: float = 1e-5
) -> float:
    """Focal length in pixels from the images of two concentric circles, for square pixels.

    Parameters
    ----------
    outer, inner : (3, 3) array_like
    principal_point : (2,) array_like
    tolerance : float
        See `concentric_pair`.

    Raises
    ------
    ValueError
        As `concentric_pair`; if the plane is parallel to the image, which leaves the focal length undetermined; or if
        no focal length fits.
    """
    principal = np.asarray(principal_point, dtype=np.float64)
    pair = concentric_pair(outer, inner, tolerance)
    conics = np.stack([np.asarray(outer, dtype=np.float64), np.asarray(inner, dtype=np.float64)])
    x, y, a, _, _ = ellipse_of_conic(conics[0])
    size = float(np.hypot(x - principal[0], y - principal[1]) + a)
    frame = image_frame(principal, size)
    line = pair.line @ np.linalg.inv(frame)
    dual = dual_circular_points(moved_conic(conics, frame), line / np.linalg.norm(line)).mean(axis=0)
    return size * focal_from_dual(dual)


def _odd(values: NDArray[np.number]) -> int:
    """Index of the eigenvalue that is not one of the closest two; the real one beside a complex pair."""
    if np.iscomplexobj(values) and np.any(np.imag(values) != 0):
        return int(np.argmin(np.abs(np.imag(values))))
    logs = np.log(np.abs(np.real(values)))
    gaps = [abs(logs[(i + 1) % 3] - logs[(i + 2) % 3]) for i in range(3)]
    return int(np.argmin(gaps))
