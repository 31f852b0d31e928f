"""Numbers about precision: bounds, estimators that attain them, approximations on the axis, blurred curved edges."""

from __future__ import annotations

import math

import numpy as np
from ambiguity import PAPER_K, Array, table
from scipy.optimize import least_squares
from scipy.special import ndtr
from scipy.stats import ncx2

from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic, ellipse_perimeter_px, ellipse_points
from roundel.scenes.geometry.edge_spread_function import curved_distance
from roundel.scenes.geometry.information import contour_information, pose_bound
from roundel.scenes.geometry.pose import angle_deg, camera_from_marker_of, normal_of
from roundel.solver.fit.ellipse import FailedFit, fit_ellipse
from roundel.solver.pose.circle_pose import poses_from_ellipse

DISTANCES = (15, 20, 25, 30, 35, 40, 45, 50)
TILTS = (15, 30, 45)
RADIUS = 0.5  # lengths in diameters


def pose_on_axis(tilt: float, distance: float) -> Array:
    """The paper's set-up: the camera is aimed at the marker, which is rotated about an axis of the image."""
    return camera_from_marker_of(normal_of(tilt, 90.0), np.array([0.0, 0.0, distance]))


def simulated(tilt: float, distance: float, trials: int, seed: int) -> tuple[Array, Array]:
    """Errors of normal (rad) and centre (D), (trials, 3), of the nearer candidate; 200 points with noise of 1 px."""
    rng = np.random.default_rng([seed, int(tilt), int(distance)])
    pose = pose_on_axis(tilt, distance)
    points = ellipse_points(ellipse_of_conic(conic_of_circle(pose, RADIUS, PAPER_K)), 4000)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    at = np.arange(200) / 200 * (length[-1] + np.linalg.norm(points[0] - points[-1]))
    even = np.stack([np.interp(at, length, points[:, i]) for i in (0, 1)], axis=1)
    normals, centres = [], []
    for _ in range(trials):
        fit = fit_ellipse(even + rng.normal(0, 1, even.shape))
        assert not isinstance(fit, FailedFit)
        poses = poses_from_ellipse(fit.ellipse, PAPER_K, RADIUS)
        best = int(np.argmin(angle_deg(poses.normal, pose[:3, 2])))
        normals.append(poses.normal[best] - pose[:3, 2])
        centres.append(poses.centre_m[best] - pose[:3, 3])
    return np.array(normals), np.array(centres)


def bound_table(trials: int = 400) -> str:
    """Compare Monte-Carlo simulation, the bound and the formulas on the axis: 200 points, 1 px."""
    rows = []
    for distance in (15, 30, 50):
        for tilt in TILTS:
            bound = pose_bound(contour_information(pose_on_axis(tilt, distance), RADIUS, PAPER_K, 1.0, 200))
            normals, centres = simulated(tilt, distance, trials, 1)
            spread = np.degrees(np.sqrt(np.sum(np.var(normals, axis=0))))
            f, sine = PAPER_K[0, 0], math.sin(math.radians(tilt))
            formula = math.degrees(4 * distance / (f * RADIUS * sine * math.sqrt(200)))
            deep = distance * math.sqrt(3 / 200) * distance / (RADIUS * f)
            depth = math.sqrt(bound.cov[4, 4])
            bias = f"{np.mean(centres[:, 2]):+.3f}"
            cells = [f"{distance} D", f"{tilt}", f"{spread:.2f}", f"{bound.normal_deg:.2f}", f"{formula:.2f}"]
            rows.append([*cells, f"{np.std(centres[:, 2]):.3f}", f"{depth:.3f}", f"{deep:.3f}", bias])
    head = ["distance", "tilt", "normal, deg: simulated", "bound", "formula"]
    return table([*head, "depth, D: simulated", "bound", "formula", "bias"], rows)


def breakdown_table(trials: int = 400) -> str:
    """The tilt below which the bound does not apply, and the mean estimated tilt at tilt zero."""
    rows = []
    for distance in (15, 30, 50):
        a = PAPER_K[0, 0] * RADIUS / distance
        limit = math.degrees(math.sqrt(2 * math.sqrt(2 / 200) / a))
        normals, _ = simulated(0.0, distance, trials, 2)
        found = angle_deg(normals + np.array([0.0, 0.0, -1.0]), [0, 0, -1])
        rows.append([f"{distance} D", f"{a:.1f}", f"{limit:.1f}", f"{np.mean(found):.1f}"])
    return table(["distance", "a, px", "breakdown tilt, deg", "mean estimated tilt at tilt 0, deg"], rows)


def prior_table() -> str:
    """Bounds with a known focal length and with a prior (11.5 %): 200 points of 1 px, tilt 30 degrees."""
    rows = []
    for name, centre in (("on the axis, 20 D", [0.0, 0.0, 20.0]), ("off the axis, (6, 3, 20) D", [6.0, 3.0, 20.0])):
        pose = camera_from_marker_of(normal_of(30.0, 90.0), np.array(centre))
        known = pose_bound(contour_information(pose, RADIUS, PAPER_K, 1.0, 200))
        assumed = pose_bound(contour_information(pose, RADIUS, PAPER_K, 1.0, 200, focal_sigma=0.115))
        cells = [name]
        for value in (known, assumed):
            cells += [f"{value.normal_deg:.2f}", f"{100 * value.position_m / np.linalg.norm(centre):.2f}"]
        rows.append(cells)
    head = ["marker", "f known: normal, deg", "position, %", "f with prior: normal, deg", "position, %"]
    return table(head, rows)


def rank_without_prior() -> int:
    """Rank of the information about pose and focal length together, no prior."""
    pose = camera_from_marker_of(normal_of(30.0, 60.0), np.array([6.0, 3.0, 20.0]))
    information = contour_information(pose, RADIUS, PAPER_K, 1.0, 200, focal_sigma=math.inf)
    scale = 1 / np.sqrt(np.diag(information))
    return int(np.linalg.matrix_rank(information * scale[:, None] * scale, tol=1e-9))


def blurred_disc(radius: float, blur: float, offset: tuple[float, float]) -> tuple[Array, Array]:
    """Exact pixels of a dark disc on white: distances of their centres from its centre (N,), and grey levels (N,).

    After a Gaussian blur, the disc's share is the probability that a Gaussian sample falls inside it, a noncentral
    chi^2 probability; a pixel is its mean over a square, by Gauss's rule.
    """
    size = math.ceil(radius + 6 * blur + 3)
    y, x = (g.astype(np.float64) for g in np.mgrid[-size : size + 1, -size : size + 1])
    x, y = x.ravel() - offset[0], y.ravel() - offset[1]
    nodes, weights = np.polynomial.legendre.leggauss(6)
    value = np.zeros_like(x)
    for u, wu in zip(nodes / 2, weights / 2, strict=True):
        for v, wv in zip(nodes / 2, weights / 2, strict=True):
            value += wu * wv * ncx2.cdf((radius / blur) ** 2, 2, ((x + u) ** 2 + (y + v) ** 2) / blur**2)
    return np.hypot(x, y), 1.0 - value


def shrinkage(radius: float, blur: float, order: int) -> float:
    """Error of the radius in px when the pixels of a blurred disc are fitted with a step.

    `order` 0 is a straight step, 1 has the shift b^2 / (2 rho), 2 is `curved_distance`.
    """
    at, level = blurred_disc(radius, blur, (0.31, -0.17))
    keep = at > 0.25 * radius
    at, level = at[keep], level[keep]

    def residual(p: Array) -> Array:
        width = p[1] ** 2 + 1 / 12
        z = at - p[0] + (width / (2 * p[0]) if order == 1 else 0.0)
        if order == 2:
            z, _ = curved_distance(z, np.full_like(z, 1 / p[0]), np.zeros_like(z), width)
        return np.asarray(p[2] + (p[3] - p[2]) * ndtr(z / math.sqrt(width)) - level)

    fit = least_squares(residual, [radius, blur, 0.0, 1.0], xtol=1e-12, ftol=1e-12, gtol=1e-12)
    return float(fit.x[0]) - radius


RADII, BLURS = (12.8, 21.3, 42.7), (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0)


def shrinkage_table() -> str:
    """Error of the radius with each model, and -b^2 / (2 rho)."""
    rows = []
    for radius in RADII:
        for blur in (1.0, 2.0, 3.0, 4.0):
            rule = -(blur**2 + 1 / 12) / (2 * radius)
            cells = [f"{radius:g}", f"{blur:g}", f"{rule:+.3f}"]
            rows.append([*cells, *(f"{shrinkage(radius, blur, order):+.4f}" for order in (0, 1, 2))])
    return table(["radius, px", "blur, px", "formula", "straight step", "shifted by the formula", "second order"], rows)


def eccentricity_table() -> str:
    """Distance from the centre of the ellipse to the image of the circle's centre, and the rule of thumb."""
    rows = []
    for distance in (15, 50):
        for tilt in TILTS:
            pose = pose_on_axis(tilt, distance)
            ellipse = ellipse_of_conic(conic_of_circle(pose, RADIUS, PAPER_K))
            exact = float(np.hypot(*(ellipse[:2] - PAPER_K[:2, 2])))
            rule = float(ellipse[2]) ** 2 * math.sin(math.radians(2 * tilt)) / (2 * PAPER_K[0, 0])
            perimeter = float(ellipse_perimeter_px(ellipse))
            rows.append([f"{distance} D", f"{tilt}", f"{perimeter:.0f}", f"{exact:.3f}", f"{rule:.3f}"])
    return table(["distance", "tilt", "perimeter, px", "distance of the centres, px", "a^2 sin 2 alpha / 2f"], rows)
