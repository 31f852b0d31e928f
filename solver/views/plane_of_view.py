"""From the circles of a view to its answers: which are printed, the focal length of their plane, a pose of each."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2 as chi2_distribution

from roundel.scenes.camera.focal_fusion import fused_camera
from roundel.scenes.camera.model import Camera
from roundel.solver.fit.ellipse import FailedFit
from roundel.solver.methods.plugin import Found, MethodFailure, View
from roundel.solver.pose.circle_pose import poses_from_ellipse
from roundel.solver.pose.coplanar_circles import CoplanarFit, fit_coplanar
from roundel.solver.pose.focal_uncertainty import MeasuredFocal
from roundel.solver.pose.plane_homography import PlaneHomography
from roundel.solver.views.circles_of_view import CircleImage, circles_of_view, require_kind

Array = NDArray[np.float64]

# Error of a fitted ellipse that its covariance leaves out, in each shape parameter: ink and blur that no model has.
_FLOOR_PX = 0.002
# At this standard deviation of log f the perspective that measures f is five of its own standard deviations. Of weaker
# ones only those that noise has magnified would be stated, with too small a standard deviation, and too short an f.
LARGEST_SIGMA = 0.25
# Circles that are circles of one plane are refused once in a million images.
_MISFIT = 1e-6
# Radii over printed radii of circles in one plane agree to this fraction, and to three standard deviations.
_RADIUS_TOLERANCE = 0.03


def printed_circles(view: View, least: int) -> tuple[list[CircleImage], Array]:
    """The circles of a view, as many as are printed, the strongest; and their printed diameters (n,), in any order.

    Raises
    ------
    MethodFailure
        If other things than discs are printed, or fewer than `least` circles are printed, or found.
    """
    require_kind(view, "disc", "disc_with_tick")
    diameters = [float(m["diameter_m"]) for m in view.markers if m.get("diameter_m")]
    if diameters and len(diameters) < least:
        count = "one circle is" if len(diameters) == 1 else f"{len(diameters)} circles are"
        raise MethodFailure(f"{count} printed, and it needs {least} or more in one plane")
    circles = circles_of_view(view)
    if len(circles) < least:
        raise MethodFailure(f"it needs {least} circles or more; {len(circles)} found")
    if not diameters:
        return circles, np.full(len(circles), view.diameter_m)
    circles = circles[: len(diameters)]
    if len(set(diameters)) == 1:
        return circles, np.full(len(circles), diameters[0])
    if len(circles) < len(diameters):
        raise MethodFailure(
            f"only {len(circles)} of {len(diameters)} printed circles are found, and their sizes differ: which they "
            "are is not known"
        )
    return circles, np.array(diameters)


def measurements(circles: Sequence[CircleImage]) -> tuple[Array, Array]:
    """Ellipses (n, 5) and the covariances (n, 5, 5) of their shapes, with a floor."""
    ellipses = np.array([circle.ellipse for circle in circles])
    covs = np.array([circle.shape_cov for circle in circles]) + _FLOOR_PX**2 * np.eye(5)
    if not np.all(np.isfinite(covs)):
        raise MethodFailure("an ellipse has no covariance: its points do not determine it")
    return ellipses, covs


def focal_of_fit(fit: CoplanarFit | FailedFit) -> MeasuredFocal | None:
    """The focal length of a fit; None if the image does not determine it."""
    if isinstance(fit, FailedFit) or not fit.focal_sigma <= LARGEST_SIGMA:
        return None
    return MeasuredFocal(fit.focal_px, fit.focal_sigma)


def refuse_misfit(fit: CoplanarFit | PlaneHomography, what: str) -> None:
    """Refuse ellipses whose residuals have chance below one in a million.

    Raises
    ------
    MethodFailure
        With `what`, a clause that says what the circles are not.
    """
    if fit.freedom > 0 and chi2_distribution.sf(fit.chi2, fit.freedom) < _MISFIT:
        raise MethodFailure(f"{what}: the best fit leaves {math.sqrt(fit.chi2 / fit.freedom):.1f} sigma a number")


def camera_of(view: View, focal: MeasuredFocal | None) -> Camera:
    """The camera for the poses: the view's, its focal length fused with the measured one where it is uncertain."""
    if focal is None:
        return view.camera
    return fused_camera(view.camera, view.focal_sigma, focal.focal_px, focal.sigma * focal.focal_px)


def fit_plane(ellipses: Array, covs: Array, K: Array, concentric: bool = False) -> CoplanarFit | FailedFit:
    """The plane of circles for a known camera, from both normals of the first circle; the better fit of the two."""
    normals = poses_from_ellipse(ellipses, K, 1.0).normal
    best: CoplanarFit | FailedFit = FailedFit("no plane fits the circles")
    for first in normals[0]:
        mean = np.mean(normals[np.arange(len(normals)), np.argmax(normals @ first, axis=1)], axis=0)
        start = mean / np.linalg.norm(mean)
        fit = fit_coplanar(ellipses, covs, K, start, concentric=concentric, focal_known=True)
        if not isinstance(fit, FailedFit) and (isinstance(best, FailedFit) or fit.chi2 < best.chi2):
            best = fit
    return best


def founds_in_plane(
    view: View,
    circles: Sequence[CircleImage],
    diameters_m: Array,
    focal: MeasuredFocal | None,
    *,
    concentric: bool = False,
) -> list[Found]:
    """One pose of each circle, all in one plane, with the camera of `camera_of`.

    Parameters
    ----------
    view : View
    circles : sequence of CircleImage
    diameters_m : (n,) array
        Of the circles, in any order.
    focal : MeasuredFocal or None
        As measured from this image alone.
    concentric : bool
        Whether the circles have one centre; one answer is then given, for the first.

    Raises
    ------
    MethodFailure
        If they are not circles of one plane.
    """
    ellipses, covs = measurements(circles)
    camera = camera_of(view, focal)
    fit = fit_plane(ellipses, covs, camera.K, concentric)
    if isinstance(fit, FailedFit):
        raise MethodFailure(fit.reason)
    # Which circle has which diameter follows from the order of the sizes in the plane, not in the image.
    rank = np.argsort(np.argsort(fit.radius))
    depth = np.sort(diameters_m)[rank] / 2 / fit.radius
    middle = float(np.median(depth))
    spread = float(np.max(np.abs(depth / middle - 1.0)))
    # A wrong focal length bends the sizes of circles at other depths.
    bend = 3.0 * max(view.focal_sigma, 0.0) * float(np.ptp(fit.centre[:, 2]) / np.mean(fit.centre[:, 2]))
    noise = 3.0 * float(np.max(np.sqrt(covs[:, 2, 2] + covs[:, 4, 4]) / ellipses[:, 2]))
    if not concentric and spread > _RADIUS_TOLERANCE + bend + noise:
        raise MethodFailure(
            f"the circles are not in one plane with these diameters: their distances differ by {100 * spread:.0f} %"
        )
    out = []
    for i, circle in enumerate(circles[:1] if concentric else circles):
        out.append(
            Found(
                poses=[(fit.normal, fit.centre[i] * depth[i])],
                ellipse=circle.ellipse,
                confidence=circle.confidence,
                focal_px=None if focal is None else focal.focal_px,
                focal_sigma_px=None if focal is None else focal.sigma * focal.focal_px,
                camera=None if camera is view.camera else camera,
            )
        )
    return out
