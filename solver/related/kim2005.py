"""Kim: two concentric circles give the image of their centre, the vanishing line, and the focal length.

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

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.geometry.conic import conic_of_ellipse, ellipse_of_conic
from roundel.solver.fit.ellipse import FailedFit
from roundel.solver.methods.plugin import Found, MethodFailure, View
from roundel.solver.pose.coplanar_circles import CoplanarFit, fit_coplanar
from roundel.solver.views.circles_of_view import CircleImage, circles_of_view, require_kind
from roundel.solver.views.dual_circular_points import (
    focal_from_line,
    line_from_centre,
    moved_conic,
    normal_from_line,
)
from roundel.solver.views.plane_of_view import focal_of_fit, founds_in_plane, measurements, refuse_misfit

Array = NDArray[np.float64]

# Focal lengths from which the joint fit starts, in units of the distance from the principal point to the ellipse's far
# end: fields of view from some 100 to 10 degrees for a marker in the outer part of an image, and one in its middle.
_STARTS = (1.0, 4.0, 16.0)
_RATIO_TOLERANCE = 0.03


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
    eccentricity = float(np.abs(others[0] - others[1]) / np.abs(double))
    if eccentricity > tolerance:
        raise ValueError(
            "the circles are not concentric: two eigenvalues of their pencil differ by "
            f"{eccentricity:.2g} of their size"
        )
    if not ratio2 > 1.0 or second[2, 2] <= 0:
        raise ValueError(
            "the second circle is not inside the first: are the radii swapped? The outer circle has to come first"
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
    line = concentric_pair(outer, inner, tolerance).line
    conics = [np.asarray(outer, dtype=np.float64), np.asarray(inner, dtype=np.float64)]
    return focal_from_line(np.stack(conics), line, principal_point)


def find(view: View) -> list[Found]:
    """Focal length and pose of each pair of concentric circles: the outer one, and the inner one that tells most."""
    require_kind(view, "ring", "rings", "coded_rings", "ring_code")
    circles = circles_of_view(view, inner=True)
    if not circles:
        return []
    pairs = [(circle, inner) for circle in circles for inner in circle.inner]
    if not pairs:
        raise MethodFailure(f"it needs two concentric circles; none of the {len(circles)} circles found has one inside")
    return [_found(view, circle) for circle in circles if circle.inner]


def _found(view: View, circle: CircleImage) -> Found:
    best: tuple[CoplanarFit, CircleImage] | None = None
    problem = ""
    for inner in circle.inner:
        try:
            fit = measured_pair([circle, inner], view.camera.K)
            if isinstance(fit, FailedFit):
                raise MethodFailure(fit.reason)
            refuse_misfit(fit, "the circles are not concentric")
            _refuse_ratio(view, float(fit.radius[1] / fit.radius[0]))
        except ValueError as error:
            problem = problem or str(error)
            continue
        if best is None or fit.focal_sigma < best[0].focal_sigma:
            best = fit, inner
    if best is None:
        return Found(failure=problem)
    fit, inner = best
    diameters_m = view.diameter_m * fit.radius / fit.radius[0]
    try:
        return founds_in_plane(view, [circle, inner], diameters_m, focal_of_fit(fit), concentric=True)[0]
    except MethodFailure as error:
        return Found(failure=str(error))


def measured_pair(pair: Sequence[CircleImage], K: Array) -> CoplanarFit | FailedFit:
    """The joint fit of an outer and an inner circle, started from the closed form; the focal length of K is not used.

    Raises
    ------
    ValueError
        If the closed form refuses them.
    """
    ellipses, covs = measurements(pair)
    # Noise splits the double eigenvalue by a few times its size over the smaller ellipse's; the joint fit decides.
    noise = math.sqrt(float(np.max(np.linalg.eigvalsh(covs)))) / float(ellipses[1, 3])
    outer, inner = conic_of_ellipse(ellipses)
    line = concentric_pair(outer, inner, 0.01 + 20.0 * noise).line
    reach = float(np.hypot(*(ellipses[0, :2] - K[:2, 2])) + ellipses[0, 2])
    best: CoplanarFit | FailedFit = FailedFit("no plane fits the circles")
    for focal in reach * np.array(_STARTS):
        start = np.array(K)
        start[:2, :2] *= focal / K[0, 0]
        fit = fit_coplanar(ellipses, covs, start, normal_from_line(line, start), concentric=True)
        if not isinstance(fit, FailedFit) and (isinstance(best, FailedFit) or fit.chi2 < best.chi2 - 1e-6):
            best = fit
    return best


def _refuse_ratio(view: View, ratio: float) -> None:
    """Refuse a ratio of radii that the print does not have: a swapped, or another, circle."""
    printed = []
    for marker in view.markers:
        layout = marker.get("layout") or {}
        if "inner_diameter_m" in layout:
            printed.append(layout["inner_diameter_m"] / marker["diameter_m"])
        printed += [d / marker["diameter_m"] for d in layout.get("diameters_m", [])[1:]]
        printed += layout.get("radii", [])[1:]
        printed += [layout[key] for key in ("disc", "code_from", "code_to", "ring_from") if key in layout]
    if printed and min(abs(ratio - p) for p in printed) > _RATIO_TOLERANCE:
        raise MethodFailure(
            f"the radii have the ratio {ratio:.3f}, which the print does not have "
            f"({', '.join(f'{p:.3g}' for p in sorted(printed))}): they are swapped, or another circle is inside"
        )


def _odd(values: NDArray[np.number]) -> int:
    """Index of the eigenvalue that is not one of the closest two; the real one beside a complex pair."""
    if np.iscomplexobj(values) and np.any(np.imag(values) != 0):
        return int(np.argmin(np.abs(np.imag(values))))
    logs = np.log(np.abs(np.real(values)))
    gaps = [abs(logs[(i + 1) % 3] - logs[(i + 2) % 3]) for i in range(3)]
    return int(np.argmin(gaps))
