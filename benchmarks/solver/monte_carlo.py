"""Monte-Carlo test of edge points, ellipse and both poses: efficiency against the bound, and coverage of the regions.

    python benchmarks/solver/monte_carlo.py [--runs 2000] [--fit batch|one] [--unbiased] [--json FILE]

Points are evenly spaced along the contour (random phase), with isotropic Gaussian noise. The geometric fit starts at
the truth and uses Gauss-Newton for all runs at once; `--fit one` calls `fit_ellipse` for each (the same minimum:
tests/solver/fit/test_monte_carlo.py). The candidate nearer to the truth is scored. For the regions sigma comes from the
residuals, so the quantiles are those of F with n - 5 degrees of freedom; the region of the normal is evaluated in q
(`solver.theory.pose_region`).
"""

from __future__ import annotations

import argparse
import itertools
import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic, ellipse_perimeter_px, ellipse_points
from roundel.scenes.geometry.information import contour_information, pose_bound
from roundel.scenes.geometry.pose import camera_from_marker_of, normal_of
from roundel.solver.fit.ellipse import ellipse_of_shape, fit_ellipse, shape_of_ellipse
from roundel.solver.pose.pose_covariance import poses_with_covariance
from roundel.solver.theory.pose_region import quantile, squared_distances

Array = NDArray[np.float64]

K = np.array([[1280.0, 0.0, 639.5], [0.0, 1280.0, 359.5], [0.0, 0.0, 1.0]])
RADIUS_M = 0.5  # so that one metre is one diameter
# Line of sight to the marker, and the azimuths of its normal: on the axis all azimuths are equivalent; off the axis, by
# 18.5 degrees at azimuth 26.6, the tilt is away from the line of sight or across it.
SIGHTS = {"on axis": ((0.0, 0.0, 1.0), (30.0,)), "off axis": ((6.0, 3.0, 20.0), (26.6, 116.6))}


@dataclass(frozen=True)
class Case:
    view: str
    azimuth_deg: float
    tilt_deg: float
    distance_D: float
    sigma_px: float
    points: str
    judged: bool


@dataclass(frozen=True)
class Outcome:
    """Standard deviations and RMS errors relative to the bound, and how often the 95 % regions contain the truth."""

    count: int
    bound_normal_deg: float
    bound_position_m: float
    std_normal: float
    std_position: float
    rms_normal: float
    rms_position: float
    covered_normal: float
    covered_position: float
    failed: int


def cases() -> list[Case]:
    out = []
    for (view, (_, azimuths)), tilt, points in itertools.product(
        SIGHTS.items(), (15.0, 30.0, 45.0), ("200", "perimeter")
    ):
        for azimuth in azimuths:
            levels = [(1.0, d, d <= 30) for d in (15.0, 20.0, 25.0, 30.0, 40.0, 50.0)]
            levels += [(0.1, d, True) for d in (15.0, 30.0, 50.0)]
            out += [Case(view, azimuth, tilt, d, sigma, points, judged) for sigma, d, judged in levels]
    return out


def noisy_points(ellipse: Array, count: int, sigma_px: float, runs: int, generator: np.random.Generator) -> Array:
    """Points (runs, count, 2), evenly spaced along the contour except for their noise."""
    t = np.linspace(0.0, 2 * np.pi, 4097)
    closed = ellipse_points(ellipse, 4096)[np.r_[0:4096, 0]]
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))])
    at = (np.arange(count) + generator.random((runs, 1))) * (length[-1] / count)
    u = np.interp(at, length, t)
    s11, s12, s22 = shape_of_ellipse(ellipse)[2:]
    # The eccentric angle starts at the major axis; in the frame of the symmetric S it starts at x.
    u = u + np.radians(ellipse[4])
    # S = Rot diag(a, b) Rot^T maps (cos, sin)(t + angle) to the same point as Rot diag(a, b) maps (cos, sin)(t).
    x, y = ellipse[0] + s11 * np.cos(u) + s12 * np.sin(u), ellipse[1] + s12 * np.cos(u) + s22 * np.sin(u)
    return np.stack([x, y], axis=-1) + generator.normal(0.0, sigma_px, (runs, count, 2))


def fit_many(points: Array, start: Array) -> tuple[Array, Array, Array]:
    """Orthogonal-distance fits for many sets of points (B, N, 2) at once, by Gauss-Newton from one ellipse.

    Returns shapes (B, 5), their covariances (B, 5, 5) and whether each converged (B,).
    """
    theta = np.tile(shape_of_ellipse(start), (len(points), 1))
    settled = np.zeros(len(points), dtype=bool)
    for _ in range(30):
        distance, rows = _distance_and_rows(theta, points)
        gram = np.einsum("bni,bnj->bij", rows, rows)
        step = np.linalg.solve(gram, np.einsum("bni,bn->bi", rows, distance)[..., None])[..., 0]
        theta = theta - step
        settled = np.max(np.abs(step), axis=1) < 1e-7 * start[3]
        if np.all(settled | ~np.isfinite(theta).all(axis=1)):
            break
    distance, rows = _distance_and_rows(theta, points)
    variance = np.sum(distance**2, axis=1) / (points.shape[1] - 5)
    cov = np.linalg.inv(np.einsum("bni,bnj->bij", rows, rows)) * variance[:, None, None]
    return theta, cov, settled


def _distance_and_rows(theta: Array, points: Array) -> tuple[Array, Array]:
    """Signed distances (B, N) and their derivatives (B, N, 5); method as in `solver.foot_points`."""
    _, _, a, b, angle = ellipse_of_shape(theta).T[:, :, None]
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    dx, dy = points[..., 0] - theta[:, :1], points[..., 1] - theta[:, 1:2]
    x, y = c * dx + s * dy, c * dy - s * dx
    ax, by = a * np.maximum(np.abs(x), 1e-12 * a), b * np.maximum(np.abs(y), 1e-12 * b)
    gap = (a - b) * (a + b)

    def newton(root: Array) -> Array:
        p, q = (ax / (root + gap)) ** 2, (by / root) ** 2
        return np.asarray(root + 0.5 * (p + q - 1.0) / (p / (root + gap) + q / root))

    root = np.maximum(np.maximum(by, ax - gap), newton(np.broadcast_to(b * b, by.shape)))
    for _ in range(60):
        before, root = root, newton(root)
        if np.max(np.abs(root - before) / root) < 1e-9:
            break
    ux, uy = np.copysign(ax / (root + gap), x), np.copysign(by / root, y)
    gx, gy = ux / a, uy / b
    steep = np.hypot(gx, gy)
    gx, gy = gx / steep, gy / steep
    nx, ny, vx, vy = c * gx - s * gy, s * gx + c * gy, c * ux - s * uy, s * ux + c * uy
    rows = -np.stack([nx, ny, nx * vx, nx * vy + ny * vx, ny * vy], axis=-1)
    return np.asarray((root - b * b) * steep), rows


def _one_by_one(points: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    theta, cov = np.full((len(points), 5), np.nan), np.full((len(points), 5, 5), np.nan)
    for i, own in enumerate(points):
        fit = fit_ellipse(own)
        if fit:
            theta[i], cov[i] = shape_of_ellipse(fit.ellipse), fit.shape_cov
    return theta, cov, np.isfinite(theta).all(axis=1)


def less_bias(theta: Array, points: Array) -> Array:
    """`solver.curvature_bias`, for many fits at once."""
    distance, rows = _distance_and_rows(theta, points)
    _, _, a, b, angle = ellipse_of_shape(theta).T[:, :, None]
    foot = points - theta[:, None, :2] + distance[..., None] * rows[..., :2]
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    x, y = c * foot[..., 0] + s * foot[..., 1], c * foot[..., 1] - s * foot[..., 0]
    outward = a * b / ((a * y / b) ** 2 + (b * x / a) ** 2) ** 1.5
    outward *= np.sum(distance**2, axis=1, keepdims=True) / (points.shape[1] - 5) / 2
    gram = np.einsum("bni,bnj->bij", rows, rows)
    return np.asarray(theta + np.linalg.solve(gram, np.einsum("bni,bn->bi", rows, outward)[..., None])[..., 0])


def run(case: Case, runs: int, seed: int = 0, fit: str = "batch", unbiased: bool = False) -> Outcome:
    sight = np.array(SIGHTS[case.view][0])
    centre, normal = sight / np.linalg.norm(sight) * case.distance_D, normal_of(case.tilt_deg, case.azimuth_deg)
    pose = camera_from_marker_of(normal, centre)
    ellipse = ellipse_of_conic(conic_of_circle(pose, RADIUS_M, K))
    count = round(float(ellipse_perimeter_px(ellipse))) if case.points == "perimeter" else int(case.points)
    bound = pose_bound(contour_information(pose, RADIUS_M, K, case.sigma_px, count))
    generator = np.random.default_rng(seed)
    theta, cov, good = [], [], []
    for size in [250] * (runs // 250) + [runs % 250] * (runs % 250 > 0):
        points = noisy_points(ellipse, count, case.sigma_px, size, generator)
        t, c, ok = fit_many(points, ellipse) if fit == "batch" else _one_by_one(points)
        for i in np.flatnonzero(~ok) if fit == "batch" else []:
            t[i : i + 1], c[i : i + 1], ok[i : i + 1] = _one_by_one(points[i : i + 1])
        if unbiased:
            t[ok] = less_bias(t[ok], points[ok])
        theta.append(t), cov.append(c), good.append(ok)
    keep = np.concatenate(good)
    poses, pose_cov = poses_with_covariance(
        ellipse_of_shape(np.concatenate(theta)[keep]), np.concatenate(cov)[keep], K, RADIUS_M
    )
    assert pose_cov is not None
    nearer = np.argmax(poses.normal @ normal, axis=1)
    pick = (np.arange(len(nearer)), nearer)
    of_normal, of_centre = squared_distances(poses.normal[pick], poses.centre_m[pick], pose_cov[pick], normal, centre)
    # Angles in the plane tangent at the truth.
    error = poses.normal[pick] - normal
    error = np.degrees(error - (error @ normal)[:, None] * normal)
    apart = poses.centre_m[pick] - centre

    def spread(v: Array) -> float:
        return float(np.sqrt(np.sum(np.var(v, axis=0, ddof=1))))

    def rms(v: Array) -> float:
        return float(np.sqrt(np.mean(np.sum(v**2, axis=1))))

    return Outcome(
        count,
        bound.normal_deg,
        bound.position_m,
        spread(error) / bound.normal_deg,
        spread(apart) / bound.position_m,
        rms(error) / bound.normal_deg,
        rms(apart) / bound.position_m,
        float(np.mean(of_normal <= quantile(2, 0.95, count - 5))),
        float(np.mean(of_centre <= quantile(3, 0.95, count - 5))),
        int(np.sum(~keep)),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--fit", choices=["batch", "one"], default="batch")
    parser.add_argument("--unbiased", action="store_true", help="remove the bias of isotropic noise")
    parser.add_argument("--json", type=Path, help="also write the table here")
    parser.add_argument("--only", default="", help="only cases whose line contains this text")
    arguments = parser.parse_args()
    print("view      azim tilt   r/D sigma points    N |  bound deg   std   rms cover | bound D    std   rms cover")
    rows, outside = [], 0
    for i, case in enumerate(cases()):
        head = (
            f"{case.view:8} {case.azimuth_deg:5.1f} {case.tilt_deg:4.0f} {case.distance_D:5.0f} {case.sigma_px:5.1f} "
            f"{case.points:9}"
        )
        if arguments.only not in head:
            continue
        o = run(case, arguments.runs, seed=i, fit=arguments.fit, unbiased=arguments.unbiased)
        good = max(o.std_normal, o.std_position) <= 1.05
        good = good and all(0.93 <= c <= 0.97 for c in (o.covered_normal, o.covered_position))
        outside += case.judged and not good
        verdict = ("" if good else "  OUTSIDE") if case.judged else "  (beyond)"
        print(
            f"{head} {o.count:4d} | {o.bound_normal_deg:10.3f} {o.std_normal:5.3f} {o.rms_normal:5.3f} "
            f"{o.covered_normal:5.3f} | {o.bound_position_m:7.4f} {o.std_position:5.3f} {o.rms_position:5.3f} "
            f"{o.covered_position:5.3f}{verdict}{f'  {o.failed} failed' if o.failed else ''}",
            flush=True,
        )
        rows.append({**asdict(case), **asdict(o)})
    print(
        f"{outside} of {sum(r['judged'] for r in rows)} judged cases outside (std <= 1.05 bounds, coverage 0.93..0.97)"
    )
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
