"""Caveats of an estimate: numbers and sentences about how well its model holds, from its fit and its image."""

from __future__ import annotations

import math
from typing import Any

from roundel.solver import caveats
from roundel.solver.detect.detect import Detection
from roundel.solver.fit.edge_fit import EdgeFit
from roundel.solver.fit.ellipse import EllipseFit, FailedFit
from roundel.solver.fit.pixel_covariance import PixelFit
from roundel.solver.methods.roundel_fits import Detections, FallbackFit
from roundel.solver.photometry.edge_levels import clipped_fraction, overshoots

_MISFIT = 1.5  # reduced chi-square that is reported; the covariance is widened where it is more than chance


def caveats_of(
    fit: EllipseFit | FailedFit, method: str, detection: Detection | None = None, seen: Detections | None = None
) -> dict[str, Any]:
    """The fields of `Estimate` that qualify it: fractions, misfit, fit_used, curve, caveats.

    Parameters
    ----------
    fit : EllipseFit or FailedFit
    method : str
        The requested method.
    detection, seen : Detection, Detections, optional
        The detection and its image, if the ellipse comes from an image.
    """
    fields: dict[str, Any] = {"fit_used": method}
    words = []
    if isinstance(fit, FallbackFit):
        fields["fit_used"] = f"ml: {fit.reason}"
        words.append(caveats.fallback_words(fit.reason))
    elif detection is None and method == "pixels":
        fields["fit_used"] = "ml: there are only points"
    if isinstance(fit, PixelFit):
        fields["misfit"] = fit.misfit if math.isfinite(fit.misfit) else None
        if fit.misfit > _MISFIT:
            words.append(caveats.misfit_words(fit.misfit))
    if detection is not None and seen is not None:
        # Hidden or weak parts have no edge; of the others some do not follow the ellipse.
        deviating = fit.rejected_fraction if isinstance(fit, PixelFit | EdgeFit) else 0.0
        rejected = max(0.0, 1.0 - detection.edges.coverage * (1.0 - deviating) / max(detection.visible, 1e-9))
        if isinstance(fit, PixelFit):
            clipped = fit.clipped_fraction
        else:
            clipped = clipped_fraction(seen.grey, detection.edges, seen.full_scale_dn)
        fields |= {"clipped_fraction": clipped, "rejected_fraction": rejected}
        words += [caveats.clipped_words(clipped), caveats.rejected_words(rejected)]
        words += _of_image(seen, detection)
        curve = seen.photometry.curve
        fields["curve"] = f"{curve}: {curve.basis}" if curve.basis else str(curve)
    fields["caveats"] = tuple(word for word in words if word)
    return fields


def _of_image(seen: Detections, detection: Detection) -> list[str]:
    photometry, words = seen.photometry, []
    if detection.cut:
        words.append(caveats.BORDER)
    if not photometry.curve.known:
        words.append(caveats.CURVE_UNKNOWN)
    elif photometry.curve.basis.startswith("estimated"):
        words.append(caveats.curve_words(str(photometry.curve)))
    if photometry.sharpened:
        words.append(caveats.SHARPENED_RECORD)
    elif overshoots(seen.grey, detection.edges):
        words.append(caveats.SHARPENED_PIXELS)
    if photometry.toned:
        words.append(caveats.TONED)
    return words
