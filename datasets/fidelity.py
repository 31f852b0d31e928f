"""Fidelity: how far the rendered image of a circle lies from its analytic contour, measured.

The prediction shares nothing with the ray generator but the camera's mathematics in float64: each pixel near the edge
is undistorted and the part of it inside the conic is integrated. The rendered radiance is then explained as

    Y = E(x, y) (paper + (ink - paper) (coverage - shift . d coverage - scale d coverage))

by linear least squares, with E a quadratic (smooth light). What is left is the residual.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera import Camera, undistort_px
from roundel.scenes.conic import conic_of_circle, ellipse_of_conic, ellipse_points
from roundel.scenes.frame import Frame
from roundel.scenes.marker import reflectance_at

Array = NDArray[np.float64]

# Gauss-Legendre lines a pixel: the coverage of an edge pixel is then known to some 1e-4, far below Monte-Carlo error.
_LINES = 16
_BAND_PX = 2
_STEP_PX = 0.02


def _coverage(ellipse: Array, corner: Array, u_side: Array, v_side: Array) -> Array:
    """Fraction of each pixel, a parallelogram in undistorted coordinates (n, 2 each), inside an ellipse (5,).

    The ellipse becomes the unit circle; along each of the lines across the pixel its chord is exact.
    """
    angle = np.radians(ellipse[4])
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]) / ellipse[2:4, None]
    origin, a, b = (corner - ellipse[:2]) @ turn.T, u_side @ turn.T, v_side @ turn.T
    # Chords run across the edge, lines are stacked along it: the integrand is then smooth.
    middle = origin + (a + b) / 2
    across = np.abs(np.sum(middle * a, axis=1)) >= np.abs(np.sum(middle * b, axis=1))
    a, b = np.where(across[:, None], a, b), np.where(across[:, None], b, a)
    nodes, weights = np.polynomial.legendre.leggauss(_LINES)
    start = origin[:, None] + (nodes[:, None] + 1) / 2 * b[:, None]
    # |start + s a|^2 < 1 between the roots of a quadratic in s.
    q2, q1, q0 = np.sum(a * a, axis=1)[:, None], np.sum(start * a[:, None], axis=2), np.sum(start * start, axis=2) - 1
    root = np.sqrt(np.maximum(q1 * q1 - q2 * q0, 0.0))
    low, high = np.clip((-q1 - root) / q2, 0, 1), np.clip((-q1 + root) / q2, 0, 1)
    return np.asarray((high - low) @ weights / 2, dtype=np.float64)


def _band(camera: Camera, contour_px: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns of the pixels within `_BAND_PX` of a contour, inside the image."""
    columns, rows = np.rint(contour_px).astype(np.int64).T
    steps = np.arange(-_BAND_PX, _BAND_PX + 1)
    dr, dc = (a.ravel() for a in np.meshgrid(steps, steps))
    pixels = np.unique(np.stack([(rows[:, None] + dr).ravel(), (columns[:, None] + dc).ravel()], axis=1), axis=0)
    inside = (pixels >= 0).all(axis=1) & (pixels[:, 0] < camera.height_px) & (pixels[:, 1] < camera.width_px)
    return pixels[inside, 0], pixels[inside, 1]


def measure_circle(
    frame: Frame, marker_id: int, radiance: NDArray[np.float32], variance: NDArray[np.float32]
) -> dict[str, float] | None:
    """Compare one rendered circle with its analytic contour.

    Parameters
    ----------
    frame : Frame
    marker_id : int
    radiance, variance : (H, W) arrays
        Linear radiance and the variance of its Monte-Carlo estimate.

    Returns
    -------
    dict or None
        `shift_x_px`, `shift_y_px`: displacement of the rendered edge from the analytic one; `scale_px`: how much larger
        it is (along the normal); `shift_se_px`: standard error of a shift, from the residual; `residual`: RMS of what
        is left in the band, `monte_carlo`: RMS that the recorded variance predicts, both as fractions of the edge's
        contrast; `pixels`. None where there is nothing to compare: a lens with an aperture, a circle cut by the
        image's border.
    """
    from roundel.scenes.camera import distort_px

    part = next(p for p in frame.sheet.parts if p.marker_id == marker_id)
    camera = frame.camera
    if part.radius_m is None or camera.aperture_radius_m > 0:
        return None
    pose = frame.camera_from_part(part)
    ellipse = ellipse_of_conic(conic_of_circle(pose, part.radius_m, camera.K))
    count = int(np.ceil(8 * ellipse[2])) + 64
    contour = distort_px(camera, ellipse_points(ellipse, count))
    if contour.min() < _BAND_PX or np.any(contour > np.array([camera.width_px, camera.height_px]) - 1 - _BAND_PX):
        return None
    rows, columns = _band(camera, contour)
    # Within one pixel the lens is linear to some 1e-6 px: four corners say all.
    centres = np.stack([columns, rows], axis=-1).astype(np.float64)
    corners = [undistort_px(camera, centres + shift) for shift in ([-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5], [0.5, 0.5])]
    u_side = (corners[1] - corners[0] + corners[3] - corners[2]) / 2
    v_side = (corners[2] - corners[0] + corners[3] - corners[1]) / 2
    pixel = (np.mean(corners, axis=0) - (u_side + v_side) / 2, u_side, v_side)
    coverage = _coverage(ellipse, *pixel)

    def slope(index: tuple[int, ...]) -> Array:
        step = np.zeros(5)
        step[list(index)] = _STEP_PX
        return (_coverage(ellipse + step, *pixel) - _coverage(ellipse - step, *pixel)) / (2 * _STEP_PX)

    # The two sides of the edge as the sheet has them: a step inside and outside the circle, anywhere on it.
    x, zero = np.array([0.999, 1.001]) * part.radius_m, np.zeros(2)
    ink, paper = reflectance_at(frame.sheet, part.x_m + x, part.y_m + zero)
    u, v = (columns - ellipse[0]) / ellipse[2], (rows - ellipse[1]) / ellipse[2]
    light = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=1)
    observed = radiance[rows, columns].astype(np.float64)
    design = light * (paper + (ink - paper) * coverage)[:, None]
    start, *_ = np.linalg.lstsq(design, observed, rcond=None)
    contrast = (light @ start) * (ink - paper)
    design = np.column_stack([design, *(contrast * slope(i) for i in ((0,), (1,), (2, 3)))])
    solution, *_ = np.linalg.lstsq(design, observed, rcond=None)
    left = observed - design @ solution
    freedom = len(observed) - design.shape[1]
    covariance = np.linalg.pinv(design.T @ design) * (left @ left / freedom)
    height = float(np.abs(contrast).mean())
    return {
        "shift_x_px": float(solution[6]),
        "shift_y_px": float(solution[7]),
        "scale_px": float(solution[8]),
        "shift_se_px": float(np.sqrt(max(covariance[6, 6], covariance[7, 7]))),
        "residual": float(np.sqrt(np.mean(left**2))) / height,
        "monte_carlo": float(np.sqrt(np.mean(variance[rows, columns], dtype=np.float64))) / height,
        "pixels": float(len(observed)),
    }


def summarise(measured: list[dict[str, float]]) -> dict[str, Any]:
    """The fidelity of a dataset from that of its circles: mean shift with its 95 % interval, worst, residuals."""
    if not measured:
        return {"circles": 0, "reason": "no sharp, whole circle to measure"}
    out: dict[str, Any] = {"circles": len(measured)}
    for key in ("shift_x_px", "shift_y_px", "scale_px"):
        values = np.array([m[key] for m in measured])
        # One circle has no scatter; its own standard error stands in.
        spread = values.std(ddof=1) / np.sqrt(len(values)) if len(values) > 1 else measured[0]["shift_se_px"]
        out[key] = {"mean": float(values.mean()), "ci95": float(1.96 * spread), "worst": float(np.abs(values).max())}
    out["residual"] = float(np.sqrt(np.mean([m["residual"] ** 2 for m in measured])))
    out["monte_carlo"] = float(np.sqrt(np.mean([m["monte_carlo"] ** 2 for m in measured])))
    return out
