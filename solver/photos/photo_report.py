"""Results of photographs as text: `estimates.json`, and one line each for the terminal."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from roundel.scenes.camera.model import camera_to_json
from roundel.scenes.geometry.pose import tilt_azimuth_deg
from roundel.solver.ambiguity.disambiguation import CONTRADICTORY
from roundel.solver.ambiguity.normal_prior import FITS_NEITHER
from roundel.solver.caveats import count_caveats
from roundel.solver.estimates import NOT_FOUND, Estimate
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera

# The terminal shows the poses of so many circles of a photograph.
_MOST_CIRCLES = 6


@dataclass(frozen=True, eq=False)
class PhotoResult:
    """The result of one photograph.

    Attributes
    ----------
    file : str
        The path as given.
    status : str
        `ok`, `no circle`, or `failed`: the file could not be read, or lacks data for the intrinsics.
    reason : str
    width_px, height_px : int or None
        Size of the upright image.
    cameras : dict
        The camera of each available intrinsics label.
    estimates : list of Estimate
    found : int
        Number of detections.
    overlay : str
        Path within the output folder; empty if there is none.
    exif_problem : str
        Why the focal length of the file's EXIF was not used where it would have been, as one clause; empty if it was.
    """

    file: str
    status: str
    reason: str = ""
    width_px: int | None = None
    height_px: int | None = None
    cameras: dict[str, UncertainCamera] = field(default_factory=dict)
    estimates: list[Estimate] = field(default_factory=list)
    found: int = 0
    overlay: str = ""
    exif_problem: str = ""


def distance_m(estimate: Estimate, candidate: int) -> tuple[float, float | None]:
    """Distance from the camera to the circle's centre, and its standard deviation to first order, if it is known."""
    assert estimate.centre_m is not None
    centre = estimate.centre_m[candidate]
    distance = float(np.linalg.norm(centre))
    if estimate.cov is None:
        return distance, None
    ray = centre / distance
    return distance, float(np.sqrt(max(ray @ estimate.cov[candidate, :3, :3] @ ray, 0.0)))


def with_sigma(value: float, sigma: float | None, unit: str = "m") -> str:
    """A value and its standard deviation with two significant digits: `0.830 ± 0.095 m`."""
    if sigma is None or not math.isfinite(sigma) or sigma <= 0:
        return f"{value:.4g} {unit}"
    decimals = min(max(0, 1 - math.floor(math.log10(sigma))), 9)
    return f"{value:.{decimals}f} ± {sigma:.{decimals}f} {unit}"


def distance_label(estimate: Estimate) -> str:
    """Distance of the chosen or first candidate; the two differ by at most some hundredths of a diameter."""
    if not estimate:
        return estimate.reason
    if estimate.centre_m is None:
        return "unknown distance"
    return with_sigma(*distance_m(estimate, estimate.chosen or 0))


def shown_estimates(result: PhotoResult) -> list[Estimate]:
    """The estimates of a photograph that its line and its picture show: of the first method and the first camera."""
    label = next(iter(result.cameras), None)
    of = result.estimates[0].method if result.estimates else None, label
    return [e for e in result.estimates if e.detection_id != NOT_FOUND and (e.method, e.intrinsics) == of]


def caveat_lines(result: PhotoResult) -> list[str]:
    """The caveats of a photograph: the sentences of a single circle, the number of circles with each of several."""
    shown = shown_estimates(result)
    if len(shown) == 1:
        return list(shown[0].caveats)
    return [f"{count} of {len(shown)}: {what}" for what, count in count_caveats(e.caveats for e in shown).items()]


def line_of(result: PhotoResult) -> str:
    """One photograph in one line."""
    if result.status != "ok":
        return f"{result.file}: {result.reason or result.status}"
    label, first = next(iter(result.cameras)), shown_estimates(result)
    distances = ", ".join(distance_label(e) for e in first[:4]) + (", ..." if len(first) > 4 else "")
    circles = "1 circle" if len(first) == 1 else f"{len(first)} circles"
    camera = result.cameras[label].basis + (f"; {result.exif_problem}" if result.exif_problem else "")
    return f"{result.file}: {circles} at {distances} ({camera})"


def pose_lines(result: PhotoResult) -> list[str]:
    """Both candidate poses of each circle, a line each: distance, tilt, azimuth and probability; the chosen one named.

    Below them, knowledge that fits neither. At most `_MOST_CIRCLES` circles: all are in the files.
    """
    shown = [estimate for estimate in shown_estimates(result) if estimate.normal is not None]
    lines: list[str] = []
    for estimate in shown[:_MOST_CIRCLES]:
        name = f"circle {estimate.detection_id + 1}, " if len(shown) > 1 else ""
        for k in range(0 if estimate.normal is None else len(estimate.normal)):
            lines.append(f"{name}pose {k + 1}: {_pose_text(estimate, k)}")
        if FITS_NEITHER in estimate.choice_basis or CONTRADICTORY in estimate.choice_basis:
            lines.append(f"{name}the knowledge does not help: {estimate.choice_basis}")
    if len(shown) > _MOST_CIRCLES:
        lines.append(f"and {len(shown) - _MOST_CIRCLES} more circles, in the files")
    return lines


def _pose_text(estimate: Estimate, k: int) -> str:
    record = candidate_record(estimate, k)
    tilt = with_sigma(record["tilt_deg"], record.get("normal_sigma_deg"), "deg")
    text = f"{with_sigma(*distance_m(estimate, k))}, tilt {tilt}, azimuth {record['azimuth_deg']:.0f} deg"
    if record["probability"] is not None:
        text += f" ({100 * record['probability']:.0f} %{', chosen' if estimate.chosen == k else ''})"
    return text


def readable(results: Sequence[PhotoResult], diameter_m: float) -> str:
    """The text of `estimates.json`: all results of every photograph."""
    photographs = [_photograph(frame_id, result) for frame_id, result in enumerate(results)]
    record = {"schema": 1, "diameter_m": diameter_m, "photographs": photographs}
    return json.dumps(record, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _photograph(frame_id: int, result: PhotoResult) -> dict[str, Any]:
    cameras = {label: _camera(one) for label, one in result.cameras.items()}
    found = sorted({e.detection_id for e in result.estimates} - {NOT_FOUND})
    detections = [
        {"detection_id": i, "estimates": [_estimate(e) for e in result.estimates if e.detection_id == i]} for i in found
    ]
    failures = [
        {"method": e.method, "intrinsics": e.intrinsics, "reason": e.reason}
        for e in result.estimates
        if e.detection_id == NOT_FOUND
    ]
    return {
        "frame_id": frame_id,
        "file": result.file,
        "status": result.status,
        "reason": result.reason,
        "exif_problem": result.exif_problem,
        "width_px": result.width_px,
        "height_px": result.height_px,
        "overlay": result.overlay,
        "cameras": cameras,
        "detections": detections,
        "failures": failures,
    }


def _camera(one: UncertainCamera) -> dict[str, Any]:
    return {
        "basis": one.basis,
        "focal_sigma": one.focal_sigma,
        "principal_sigma_px": one.principal_sigma_px,
        **camera_to_json(one.camera),
    }


def _estimate(estimate: Estimate) -> dict[str, Any]:
    out: dict[str, Any] = {
        "method": estimate.method,
        "intrinsics": estimate.intrinsics,
        "status": estimate.status,
        "reason": estimate.reason,
        "confidence": _finite(estimate.confidence),
        "chosen": estimate.chosen,
        "choice_basis": estimate.choice_basis,
        "caveats": list(estimate.caveats),
    }
    if estimate.ellipse is not None:
        out["ellipse"] = estimate.ellipse._asdict()
        out["edge_points"], out["edge_sigma_px"] = estimate.edge_points, _finite(estimate.edge_sigma_px)
        out["blur_px"], out["contrast_dn"] = _finite(estimate.blur_px), _finite(estimate.contrast_dn)
        for name in ("clipped_fraction", "rejected_fraction", "misfit"):
            out[name] = _finite(getattr(estimate, name))
        out["fit_used"], out["curve"] = estimate.fit_used, estimate.curve
    if estimate.normal is not None and estimate.centre_m is not None:
        out["candidates"] = [candidate_record(estimate, candidate) for candidate in range(len(estimate.normal))]
    if estimate.centre_image is not None:
        out["centre_image_px"] = [float(v) for v in estimate.centre_image]
    return out


def candidate_record(estimate: Estimate, candidate: int) -> dict[str, Any]:
    """One candidate pose as plain values: probability, distance, tilt, azimuth, normal, centre, their deviations."""
    assert estimate.normal is not None
    assert estimate.centre_m is not None
    distance, sigma = distance_m(estimate, candidate)
    tilt, azimuth = tilt_azimuth_deg(estimate.normal[candidate])
    out: dict[str, Any] = {
        "probability": None if estimate.probability is None else estimate.probability[candidate],
        "distance_m": distance,
        "distance_sigma_m": _finite(sigma),
        "tilt_deg": float(tilt),
        "azimuth_deg": float(azimuth),
        "normal": [float(v) for v in estimate.normal[candidate]],
        "centre_m": [float(v) for v in estimate.centre_m[candidate]],
    }
    if estimate.cov is not None:
        variances = np.diag(estimate.cov[candidate])
        out["centre_sigma_m"] = [_finite(float(np.sqrt(max(v, 0.0)))) for v in variances[:3]]
        # Standard deviation of the angle: both directions perpendicular to the normal combined.
        out["normal_sigma_deg"] = _finite(float(np.degrees(np.sqrt(max(variances[3:].sum(), 0.0)))))
    return out


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
