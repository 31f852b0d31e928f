"""Numbers about the two poses: digits of the closed form, distance of the candidates, propositions, reliability.

The pencil is implemented again here, with NumPy only, so that the page does not depend on the code that it describes.
"""

from __future__ import annotations

import mpmath
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from roundel.scenes.geometry.conic import conic_of_circle, conic_of_ellipse, ellipse_of_conic, ellipse_points
from roundel.scenes.geometry.pose import angle_deg, camera_from_marker_of, normal_of
from roundel.solver.fit.ellipse import FailedFit, fit_ellipse
from roundel.solver.pose.circle_pose import poses_from_conic, poses_from_ellipse

Array = NDArray[np.float64]

WIDTH, HEIGHT = 1280, 720
PAPER_K = np.array([[1280.0, 0.0, 639.5], [0.0, 1280.0, 359.5], [0.0, 0.0, 1.0]])
DEFAULT_K = np.array([[1016.6, 0.0, 639.5], [0.0, 1016.6, 359.5], [0.0, 0.0, 1.0]])


def table(head: list[str], rows: list[list[str]]) -> str:
    """Format a table in Markdown."""
    return "\n".join("| " + " | ".join(row) + " |" for row in [head, ["---"] * len(head), *rows])


def _exact_ellipse(normal: Array, centre: Array, radius: float, k: Array) -> Array:
    """Compute the image of a circle to fifty digits; return x, y, a, b, angle as doubles."""
    with mpmath.workdps(50):
        c, n, kk = mpmath.matrix(centre.tolist()), mpmath.matrix(normal.tolist()), mpmath.matrix(k.tolist())
        n = n / mpmath.norm(n)
        dual = kk * (c * c.T + radius**2 * (n * n.T - mpmath.eye(3))) * kk.T
        dual = dual / dual[2, 2]
        x, y = dual[0, 2], dual[1, 2]
        p, q, r = x * x - dual[0, 0], x * y - dual[0, 1], y * y - dual[1, 1]
        mean, half = (p + r) / 2, mpmath.hypot((p - r) / 2, q)
        angle = mpmath.degrees(mpmath.atan2(q, (p - r) / 2) / 2)
        return np.array([float(v) for v in (x, y, mpmath.sqrt(mean + half), mpmath.sqrt(mean - half), angle)])


def _by_eigenvalues(conic: Array, k: Array, radius: float) -> tuple[Array, Array]:
    """Evaluate the textbook closed form, with eigenvalues of K^T C K: normals and centres (2, 3)."""
    a = k.T @ conic @ k
    values, vectors = np.linalg.eigh(a if np.linalg.det(a) > 0 else -a)
    (l1, l2, l3), e1, e3 = values[::-1], vectors[:, 2], vectors[:, 0]
    e1, e3 = e1 * np.sign(e1[2]), e3 * (1.0 if e3[2] >= 0 else -1.0)
    cos, sin = np.sqrt((l1 - l2) / (l1 - l3)), np.sqrt(max(l2 - l3, 0.0) / (l1 - l3))
    along, across = cos * np.sqrt(-l3 / l1) * e1, sin * np.sqrt(-l1 / l3) * e3
    return np.stack([-cos * e1 - sin * e3, -cos * e1 + sin * e3]), radius * np.stack([along - across, along + across])


def digits() -> str:
    """Errors of both ways to evaluate the closed form, over the size of the ellipse (30 degrees of tilt, off axis)."""
    rows = []
    normal, ray = normal_of(30.0, 40.0), np.array([0.1, -0.05, 1.0])
    for size in (1e-5, 1e-2, 1.0, 100.0):
        centre = ray * PAPER_K[0, 0] / size  # the image of a radius of 1 is `size` pixels long
        ellipse = _exact_ellipse(normal, centre, 1.0, PAPER_K)
        ours = poses_from_ellipse(ellipse, PAPER_K, 1.0)
        naive = _by_eigenvalues(conic_of_ellipse(ellipse), PAPER_K, 1.0)
        cells = [f"{size:g} px"]
        for normals, centres in (naive, (ours.normal, ours.centre_m)):
            apart = np.linalg.norm(centres - centre, axis=1).min() / np.linalg.norm(centre)
            cells += [f"{angle_deg(normals, normal).min():.0e}", f"{apart:.0e}"]
        rows.append(cells)
    head = ["semi-axis", "eigenvalues: normal, deg", "centre, relative", "dual cone: normal, deg", "centre, relative"]
    return table(head, rows)


def ar_poses(count: int, spread: float | None, seed: int) -> tuple[Array, Array]:
    """Random poses of a marker of diameter 1: 5 to 50 D, tilt 10 to 70 degrees; normals and centres (count, 3).

    The marker is anywhere in the image, or normally distributed about its middle with a standard
    deviation of `spread` times the width.
    """
    rng = np.random.default_rng(seed)
    half = np.array([WIDTH, HEIGHT]) / 2
    pixel = rng.uniform(-half, half, (count, 2)) if spread is None else rng.normal(0, spread * WIDTH, (count, 2))
    ray = np.concatenate([pixel / DEFAULT_K[0, 0], np.ones((count, 1))], axis=1)
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    normal = normal_of(rng.uniform(10, 70, count), rng.uniform(-180, 180, count))
    centre = ray * rng.uniform(5, 50, (count, 1))
    seen = np.sum(normal * centre, axis=1) < -0.05 * np.linalg.norm(centre, axis=1)  # neither edge-on nor from behind
    return normal[seen], centre[seen]


def conics(normal: Array, centre: Array, radius: float | Array, k: Array) -> Array:
    """Conics of many circles."""
    poses = np.stack([camera_from_marker_of(n, c) for n, c in zip(normal, centre, strict=True)])
    return conic_of_circle(poses, radius, k)


def candidates(count: int = 4000) -> dict[str, float]:
    """Measure how far apart the two candidates are, and how well the wrong one fits the image."""
    normal, centre = ar_poses(count, None, 1)
    conic = conics(normal, centre, 0.5, DEFAULT_K)
    poses = poses_from_conic(conic, DEFAULT_K, 0.5)
    again = [conics(poses.normal[:, i], poses.centre_m[:, i], 0.5, DEFAULT_K) for i in (0, 1)]
    apart = np.linalg.norm(poses.centre_m[:, 0] - poses.centre_m[:, 1], axis=1)
    return {
        "angle": float(np.median(angle_deg(poses.normal[:, 0], poses.normal[:, 1]))),
        "centre_median": float(np.median(apart)),
        "centre_max": float(np.max(apart)),
        "contour_px": max(_largest_gap(conic, other) for other in again),
    }


def candidates_table() -> str:
    """Tabulate the results of `candidates`."""
    found = candidates()
    rows = [
        ["angle between the normals, median", f"{found['angle']:.0f} degrees"],
        ["distance of the centres, median", f"{found['centre_median']:.4f} D"],
        ["distance of the centres, largest", f"{found['centre_max']:.3f} D"],
        ["distance between the contours, largest", f"{found['contour_px']:.0e} px"],
    ]
    return table(["4,000 poses, 5 to 50 D", ""], rows)


def _largest_gap(first: Array, second: Array) -> float:
    """Largest distance of the points of one conic from the other, to first order (F / |grad F|), pixels."""
    points = ellipse_points(ellipse_of_conic(first), 16)
    x = np.concatenate([points, np.ones((*points.shape[:2], 1))], axis=2)
    lines = x @ second
    return float(np.max(np.abs(np.sum(lines * x, axis=2)) / (2 * np.linalg.norm(lines[..., :2], axis=2))))


def plane_frame(normal: Array, centre: Array) -> tuple[Array, Array, Array, Array]:
    """Theta and (xc, yc) in the frame of section 5, and the unit of length: the distance along the optical axis."""
    foot = np.sum(normal * centre, axis=1)
    unit = foot / normal[:, 2]  # depth at which the optical axis meets the plane
    origin = np.stack([0 * unit, 0 * unit, unit], axis=1)
    # Y is the optical axis projected on the plane, X completes it.
    sine = -normal[:, 2]
    y = np.array([0.0, 0.0, 1.0]) + sine[:, None] * normal
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    x = np.cross(y, normal)
    offset = (centre - origin) / unit[:, None]
    return np.arcsin(sine), np.sum(offset * x, axis=1), np.sum(offset * y, axis=1), unit


def criterion(theta: Array, xc: Array, yc: Array, radius: Array) -> Array:
    """E of proposition 3."""
    c = np.cos(theta)
    return np.asarray((1 + c * yc) * (xc**2 + yc**2 + c * yc) - c * radius**2 * (yc + c))


def pencil(conic: Array, k: Array) -> tuple[Array, Array, Array]:
    """Vanishing lines that do not and do separate the limiting points, and these, all (N, 3) or (N, 2, 3)."""
    a = np.swapaxes(k, 0, 1) @ conic @ k
    values, vectors = np.linalg.eigh(a * np.sign(np.linalg.det(a))[:, None, None])
    first, third = vectors[..., 2], vectors[..., 0]
    first, third = first * np.sign(first[:, 2:]), third * np.sign(third[:, 2:])
    alpha = np.sqrt(values[:, 2] - values[:, 1])[:, None] * first
    beta = np.sqrt(values[:, 1] - values[:, 0])[:, None] * third
    back = np.linalg.inv(k)
    return (alpha + beta) @ back, (alpha - beta) @ back, np.stack([first, third], axis=1) @ k.T


def propositions(count: int = 20000) -> dict[str, float]:
    """Fraction of random circles, entirely in front of the camera, for which each statement is true."""
    rng = np.random.default_rng(2)
    theta = rng.uniform(np.radians(2), np.radians(88), count)
    xc, yc, radius = rng.normal(0, 0.8, count), rng.normal(0, 0.8, count), rng.uniform(0.01, 0.6, count)
    c, s = np.cos(theta), np.sin(theta)
    front = 1 + c * (yc - radius) > 0.02
    theta, xc, yc, radius, c, s = (v[front] for v in (theta, xc, yc, radius, c, s))
    zero, one = np.zeros_like(c), np.ones_like(c)
    # Rows: the camera's axes in the plane's frame; the camera is at (0, -c, s) and is aimed at the origin.
    turn = np.stack([np.stack(v, -1) for v in ((one, zero, zero), (zero, -s, -c), (zero, c, -s))], axis=1)
    centre = np.einsum("nij,nj->ni", turn, np.stack([xc, yc + c, -s], -1))
    normal = turn[:, :, 2]
    k = np.array([[900.0, 40.0, 300.0], [0.0, 1100.0, 200.0], [0.0, 0.0, 1.0]])
    conic = conics(normal, centre, radius, k)
    plain, separating, points = pencil(conic, k)
    true = normal @ np.linalg.inv(k)  # v ~ K^-T n

    def is_true(line: Array) -> NDArray[np.bool_]:
        unit = line / np.linalg.norm(line, axis=1, keepdims=True)
        wanted = true / np.linalg.norm(true, axis=1, keepdims=True)
        return np.asarray(np.abs(np.sum(unit * wanted, axis=1)) > 1 - 1e-9)

    e = criterion(theta, xc, yc, radius)
    # Limiting points in the plane: m on the line from the foot F = (0, -c) through the circle's centre.
    ell = np.hypot(xc, yc + c)
    axis = (ell**2 - radius**2 - s**2) / (2 * ell)
    depth = [1 + c * (-c + m * (yc + c) / ell) for m in (axis + np.hypot(axis, s), axis - np.hypot(axis, s))]
    same = depth[0] * depth[1] > 0
    split = np.prod(np.einsum("nij,nj->ni", points / points[..., 2:], true), axis=1) < 0
    enough = (yc > 0) & (yc**2 > radius**2) | (yc < -c)
    poses = poses_from_conic(conic, k, 1.0)
    nearer = angle_deg(poses.normal[:, 0], normal) < angle_deg(poses.normal[:, 1], normal)
    return {
        "count": float(len(e)),
        "one line separates": float(np.mean(is_true(plain) ^ is_true(separating))),
        "proposition 2": float(np.mean(split == ~same)),
        "proposition 3, <= 0": float(np.mean((e <= 0) == same)),
        "proposition 3, >= 0": float(np.mean((e >= 0) == same)),
        "candidate 0 is true exactly when E > 0": float(np.mean(nearer == (e > 0))),
        "(i) and (ii) suffice": float(np.mean(e[enough] > 0)),
    }


def propositions_table() -> str:
    """Tabulate the results of `propositions`."""
    found = propositions()
    count = int(found.pop("count"))
    return table([f"{count:,} random circles", "true for"], [[name, f"{100 * v:.3f} %"] for name, v in found.items()])


def frequencies(count: int = 20000) -> str:
    """How often E > 0, and how often (i) and (ii) hold, by the position of the marker in the image."""
    rows = []
    for name, spread in (("anywhere", None), ("15 % of the width", 0.15), ("5 %", 0.05), ("1 %", 0.01)):
        normal, centre = ar_poses(count, spread, 3)
        theta, xc, yc, unit = plane_frame(normal, centre)
        radius = 0.5 / unit
        e = criterion(theta, xc, yc, radius)
        known = ((yc > 0) | (yc < -np.cos(theta))) & (yc**2 > radius**2)
        rows.append([name, f"{np.mean(e > 0):.2f}", f"{np.mean(known):.2f}"])
    return table(["marker in the image", "E > 0", "(i) and (ii) hold"], rows)


def reliability(trials: int = 400) -> str:
    """How often the side rule finds the true pose in the paper's set-up, where the camera is aimed at the marker."""
    rng = np.random.default_rng(4)
    rows = []
    for distance in (15, 20, 30, 50):
        for tilt in (15, 30, 45):
            normal, centre = normal_of(tilt, 90.0), np.array([0.0, 0.0, float(distance)])
            ellipse = ellipse_of_conic(conic_of_circle(camera_from_marker_of(normal, centre), 0.5, PAPER_K))
            offset = abs(float(ellipse[1] - PAPER_K[1, 2]))
            hits = []
            for _ in range(trials):
                fit = fit_ellipse(ellipse_points(ellipse, 200) + rng.normal(0, 1, (200, 2)))
                assert not isinstance(fit, FailedFit)
                errors = angle_deg(poses_from_ellipse(fit.ellipse, PAPER_K, 0.5).normal, normal)
                hits.append(errors[1] < errors[0])  # E < 0 here: the rule says candidate 1
            cells = [f"{distance} D", f"{tilt}", f"{offset:.2f}", f"{np.mean(hits):.2f}"]
            rows.append([*cells, *(f"{ndtr(offset / sigma):.2f}" for sigma in (1, 5, 20))])
    head = [
        "distance",
        "tilt",
        "offset, px",
        "correct: edge noise 1 px",
        "principal point error 1 px",
        "5 px",
        "20 px",
    ]
    return table(head, rows)
