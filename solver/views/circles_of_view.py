"""Circles of a view, as conics with covariance: what methods of several circles start from."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.geometry.conic import conic_of_ellipse
from roundel.solver.detect.detect import Detection
from roundel.solver.fit.ellipse import EllipseFit, FailedFit
from roundel.solver.methods.plugin import MethodFailure, View
from roundel.solver.methods.roundel_fits import detect_circles, fit_detection, with_estimated_curve
from roundel.solver.photometry.image_levels import averaged_rounding, grey_levels
from roundel.solver.photometry.photometry import Photometry

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CircleImage:
    """The image of one circle, in undistorted pixel coordinates of the view's camera.

    Attributes
    ----------
    ellipse : (5,) array
        x_px, y_px, a_px, b_px, angle_deg.
    shape_cov : (5, 5) array
        Covariance of the shape parameters, see `roundel.solver.fit.ellipse.shape_of_ellipse`.
    conic : (3, 3) array
        Unit Frobenius norm, positive inside.
    confidence : float
        That it is the image of a circle.
    detection : Detection
    fit : EllipseFit
    inner : list of CircleImage
        Concentric contours inside it, the largest first, if they were asked for.
    """

    ellipse: Array
    shape_cov: Array
    conic: Array
    confidence: float
    detection: Detection
    fit: EllipseFit
    inner: list[CircleImage] = field(default_factory=list)


def circles_of_view(
    view: View, method: str = "pixels", least_confidence: float = 0.5, inner: bool = False
) -> list[CircleImage]:
    """The circles of a view by Roundel's detector and one of its fits, those with the strongest contours first.

    Parameters
    ----------
    view : View
    method : str
        One of `roundel.solver.methods.roundel_fits.METHODS`.
    least_confidence : float
        Detections below it are left out.
    inner : bool
        Also fit the concentric contours inside each circle.
    """
    grey, full_scale_dn = grey_levels(view.image, view.curve, keep_8bit=True)
    photometry = Photometry(view.curve, full_scale_dn, 1.0, averaged_rounding(view.image))
    seen = detect_circles(grey, full_scale_dn, photometry, own_ellipses=method == "edgedrawing")
    if not view.curve.known:
        seen = with_estimated_curve(seen, lambda found: grey_levels(view.image, found))

    def fitted(detection: Detection) -> CircleImage | None:
        fit = fit_detection(seen, detection, view.camera, method)
        if isinstance(fit, FailedFit):
            return None
        return CircleImage(
            fit.ellipse, fit.shape_cov, conic_of_ellipse(fit.ellipse), detection.confidence, detection, fit
        )

    out = []
    for detection in seen.detections:
        circle = fitted(detection) if detection.confidence >= least_confidence else None
        if circle is not None and inner:
            within = [fitted(replace(detection, edges=edges, inner=[])) for edges in detection.inner]
            circle = replace(circle, inner=[one for one in within if one is not None])
        if circle is not None:
            out.append(circle)
    return out


def require_kind(view: View, *kinds: str) -> None:
    """Refuse a view whose printed marker is none of these kinds; a view that tells nothing passes.

    Raises
    ------
    MethodFailure
    """
    printed = {str(marker["kind"]) for marker in view.markers}
    if printed and not printed & set(kinds):
        raise MethodFailure(f"it reads {' and '.join(kinds)}; the printed marker is {', '.join(sorted(printed))}")
