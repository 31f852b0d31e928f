"""Compare the closed forms of a circle's pose in simittag and pycalib with Roundel's: agreement and run time.

Both use OpenCV's pixel coordinates (the centre of the top-left pixel is 0) and the full axes of an ellipse, and do not
order the two poses: they are matched by their normals here. simittag gives lengths in radii and a homography per pose;
pycalib assumes square pixels without skew. Where one differs from ours, mpmath decides which is correct.
"""

from __future__ import annotations

import importlib.util
import sys
import time
import timeit
import types
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic
from roundel.scenes.geometry.pose import angle_deg, camera_from_marker_of, normal_of
from roundel.solver.pose.circle_pose import poses_from_conic, poses_from_ellipse

Array = NDArray[np.float64]
Poses = tuple[Array, Array]  # normals (n, 3) and centres (n, 3)
ClosedForm = Callable[[Any, Array, float], Poses]

PEERS_FOLDER = Path(__file__).resolve().parents[2] / ".bench-peers"
PACKAGES = {"simittag": "simittag", "pycalib": "pycalib-simple"}
TOLERANCE = 1e-6


def find_peers() -> dict[str, str]:
    """Versions of the peers that can be imported: from `make peers-env`'s folder, or this environment."""
    if PEERS_FOLDER.is_dir() and str(PEERS_FOLDER) not in sys.path:
        sys.path.append(str(PEERS_FOLDER))  # last, so that numpy and OpenCV remain Roundel's
    spec = importlib.util.find_spec("pycalib")
    if spec is not None and "pycalib" not in sys.modules:
        # The package's own __init__ imports scikit-image, pandas and yaml, which its closed form does not use.
        package = types.ModuleType("pycalib")
        package.__path__, package.__spec__ = list(spec.submodule_search_locations or ()), spec
        sys.modules["pycalib"] = package
    return {name: metadata.version(wheel) for name, wheel in PACKAGES.items() if importlib.util.find_spec(name)}


def opencv_ellipse(ellipse: Array) -> tuple[tuple[float, float], tuple[float, float], float]:
    """x, y, a, b, angle in the convention of `cv2.fitEllipse`: full axes, and the angle of the first."""
    x, y, a, b, angle = (float(v) for v in ellipse)
    return (x, y), (2 * a, 2 * b), angle


def ours(ellipse: Any, k: Array, radius: float) -> Poses:
    (x, y), (width, height), angle = ellipse
    poses = poses_from_ellipse([x, y, width / 2, height / 2, angle], k, radius)
    return poses.normal, poses.centre_m


def simittag(ellipse: Any, k: Array, radius: float) -> Poses:
    """The calls of a simittag user: the homographies, then their decomposition."""
    from simittag import pose

    found = [pose.decompose_H(h, k) for h in pose.pose_homographies(ellipse, k)]
    return np.array([turn[:, 2] for turn, _ in found]), radius * np.array([centre for _, centre in found])


def pycalib(ellipse: Any, k: Array, radius: float) -> Poses:
    from pycalib.circle import solve_circle_3d

    centres, normals = solve_circle_3d(k, ellipse, radius=radius)
    return np.array(normals).reshape(-1, 3), np.array(centres).reshape(-1, 3)


CLOSED_FORMS: dict[str, ClosedForm] = {"simittag": simittag, "pycalib": pycalib}


def random_scene(
    generator: np.random.Generator, distance_D: tuple[float, float] = (5, 50)
) -> tuple[Array, Array, float, Array]:
    """Conic, ellipse, radius and K of a circle up to 30 degrees off axis, with up to 75 degrees of tilt."""
    while True:
        f = generator.uniform(600, 2000)
        k = np.array([[f, 0, generator.uniform(300, 1000)], [0, f, generator.uniform(200, 600)], [0, 0, 1.0]])
        normal = normal_of(generator.uniform(0, 75), generator.uniform(-180, 180))
        off, azimuth = np.radians(generator.uniform(0, 30)), generator.uniform(0, 2 * np.pi)
        ray = np.array([np.sin(off) * np.cos(azimuth), np.sin(off) * np.sin(azimuth), np.cos(off)])
        radius = generator.uniform(0.01, 0.2)
        if -normal @ ray > 0.2:
            conic = conic_of_circle(
                camera_from_marker_of(normal, ray * 2 * radius * generator.uniform(*distance_D)), radius, k
            )
            return conic, ellipse_of_conic(conic), radius, k


def toward_camera(poses: Poses) -> tuple[Poses, int]:
    """Poses with normals toward the camera, and how many were flipped: a marker's normal is its printed face's."""
    normals, centres = poses
    away = np.sum(normals * centres, axis=-1) > 0
    return (np.where(away[:, None], -normals, normals), centres), int(np.count_nonzero(away))


def difference(one: Poses, other: Poses) -> float:
    """Largest difference of two pairs of poses, matched by their normals: rad, or as a fraction of the distance."""
    if one[0].shape != other[0].shape:
        return np.inf
    out = []
    for order in ([0, 1], [1, 0]):
        turn = np.radians(angle_deg(one[0], other[0][order]))
        move = np.linalg.norm(one[1] - other[1][order], axis=-1) / np.linalg.norm(one[1], axis=-1)
        out.append(float(max(turn.max(), move.max())))
    return min(out)


def exact(ellipse: Array, k: Array, radius: float) -> Poses:
    """The errata's closed form with mpmath's eigenvalues, to 50 digits: the reference where two forms differ."""
    import mpmath as mp

    with mp.workdps(50):
        x, y, a, b, angle = (mp.mpf(float(v)) for v in ellipse)
        c, s = mp.cos(mp.radians(angle)), mp.sin(mp.radians(angle))
        turn = mp.matrix([[c, -s], [s, c]])
        block = turn * mp.diag([1 / a**2, 1 / b**2]) * turn.T
        centre = mp.matrix([x, y])
        linear = -block * centre
        conic = mp.matrix(3, 3)
        conic[:2, :2] = -block
        for i in range(2):
            conic[i, 2] = conic[2, i] = -linear[i]
        conic[2, 2] = 1 - (centre.T * block * centre)[0]
        camera = mp.matrix(k.tolist())
        values, vectors = mp.eigsy(camera.T * conic * camera)
        l3, l2, l1 = values  # ascending; positive inside: l1 > 0 > l2 >= l3
        e1, e3 = vectors[:, 2], vectors[:, 0]
        e1, e3 = (e if e[2] >= 0 else -e for e in (e1, e3))
        cos, sin = mp.sqrt((l1 - l2) / (l1 - l3)), mp.sqrt((l2 - l3) / (l1 - l3))
        normals, centres = [], []
        for sign in (1, -1):
            n = cos * e1 + sign * sin * e3
            at = radius * (cos * mp.sqrt(-l3 / l1) * e1 - sign * sin * mp.sqrt(-l1 / l3) * e3)
            normals.append([-float(v) for v in n])
            centres.append([float(v) for v in at])
    return np.array(normals), np.array(centres)


def equality(names: list[str], count: int) -> list[str]:
    """Markdown: largest differences over random poses, and which form is correct if one is above the tolerance."""
    scenes = [random_scene(np.random.default_rng([41, i])) for i in range(count)]
    forms = {"ours, from the ellipse": ours, **{name: CLOSED_FORMS[name] for name in names}}
    out = [
        "| against ours, from the conic | median | largest | above 1e-6 | ours is nearer to mpmath in | "
        "normals that point away from the camera |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    for name, form in forms.items():
        gaps, turned, right = np.zeros(count), 0, 0
        for i, (conic, ellipse, radius, k) in enumerate(scenes):
            poses = poses_from_conic(conic, k, radius)
            mine = (poses.normal, poses.centre_m)
            other, away = toward_camera(form(opencv_ellipse(ellipse), k, radius))
            gaps[i], turned = difference(mine, other), turned + away
            if gaps[i] > TOLERANCE:
                truth = exact(ellipse, k, radius)
                right += difference(mine, truth) <= difference(other, truth)
        apart = int(np.count_nonzero(gaps > TOLERANCE))
        out.append(
            f"| {name} | {np.median(gaps):.1e} | {np.max(gaps):.1e} | {apart} of {count} | "
            f"{f'{right} of {apart}' if apart else '-'} | {turned} of {2 * count} |"
        )
    return out


def small_circles(names: list[str], count: int) -> list[str]:
    """Markdown: errors against mpmath for ellipses far below a pixel, where the smallest eigenvalue cancels."""
    scenes = [random_scene(np.random.default_rng([42, i]), (1e5, 1e6)) for i in range(count)]
    out = [
        "| closed form, ellipses of 0.0003 to 0.02 px | normal, median, rad | largest | distance, median | largest |",
        "|---|---:|---:|---:|---:|",
    ]
    for name, form in {"ours": ours, **{name: CLOSED_FORMS[name] for name in names}}.items():
        errors = []
        for _, ellipse, radius, k in scenes:
            truth = exact(ellipse, k, radius)
            (normal, centre), _ = toward_camera(form(opencv_ellipse(ellipse), k, radius))
            turn = min(np.max(angle_deg(normal, truth[0][order])) for order in ([0, 1], [1, 0]))
            far, true = (np.linalg.norm(c, axis=-1) for c in (centre, truth[1]))
            errors.append((np.radians(turn), np.max(np.abs(np.sort(far) / np.sort(true) - 1))))
        turn, far = np.transpose(errors)
        figures = (np.median(turn), np.max(turn), np.median(far), np.max(far))
        out.append(f"| {name} | {' | '.join(f'{v:.1e}' for v in figures)} |")
    return out


def speed(names: list[str], repeats: int) -> list[str]:
    """Markdown: microseconds per pose, minimum of many interleaved repeats; batched over 100,000."""
    conic, ellipse, radius, k = random_scene(np.random.default_rng(1))
    given = opencv_ellipse(ellipse)
    calls: dict[str, tuple[Callable[[], Any], int, int]] = {
        "Roundel, one ellipse": (lambda: poses_from_ellipse(ellipse, k, radius), 200, 1),
        "Roundel, one conic": (lambda: poses_from_conic(conic, k, radius), 200, 1),
    }
    many = 100_000
    batch = np.broadcast_to(ellipse, (many, 5)) + np.random.default_rng(2).normal(0.0, 0.01, (many, 5))
    calls[f"Roundel, {many:,} ellipses at once"] = (lambda: poses_from_ellipse(batch, k, radius), 1, many)
    if "simittag" in names:
        from simittag import pose

        centred = k.T @ conic @ k
        calls["simittag, `circle_poses_from_conic` (homographies, no normals)"] = (
            lambda: pose.circle_poses_from_conic(centred), 200, 1
        )  # fmt: skip
        calls["simittag, `pose_homographies` and `decompose_H`"] = (
            lambda: [pose.decompose_H(h, k) for h in pose.pose_homographies(given, k)], 200, 1
        )  # fmt: skip
    if "pycalib" in names:
        from pycalib.circle import solve_circle_3d

        calls["pycalib, `solve_circle_3d`"] = (lambda: solve_circle_3d(k, given, radius=radius), 200, 1)
    best = dict.fromkeys(calls, np.inf)
    for _ in range(repeats):
        for name, (call, number, poses) in calls.items():
            best[name] = min(best[name], timeit.timeit(call, number=number, timer=time.process_time) / number / poses)
    return [
        "| closed form | microseconds |",
        "|---|---:|",
        *(f"| {name} | {1e6 * seconds:.2f} |" for name, seconds in best.items()),
    ]
