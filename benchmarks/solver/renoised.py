"""Compare fits to pixels and to edge points with the bound, on many noisy copies of one rendered radiance.

    python benchmarks/solver/renoised.py [--copies 500] [--only NAME] [--folder FOLDER]

Renders a few cases (a disc or ring with a semi-major axis of 30 or 12 px, tilted, in and out of focus), develops
(re-exposes) each radiance with fresh noise, and prints for each case: scatter of the ellipse relative to the Cramer-Rao
bound of `scenes.geometry.pixel_information` (one pair of grey levels and one blur unknown), bias of centre and axes,
RMS error of the normal relative to its bound, and the mean of the squared error over the claimed covariance divided by
its 5 degrees of freedom.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.datasets.layout import files
from roundel.datasets.layout.radiance import read_radiance
from roundel.render.run import render_study
from roundel.render.sensor.develop import develop
from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic
from roundel.scenes.geometry.information import pose_bound, pose_information_of_shape
from roundel.scenes.geometry.pixel_information import shape_information_of_pixels
from roundel.scenes.study.study import load_study
from roundel.scenes.world.frame import Frame, frame_of, group_ranges
from roundel.solver.fit.edges import edge_points
from roundel.solver.fit.ellipse import EllipseFit, FailedFit, direct_ellipse, fit_ellipse, shape_of_ellipse
from roundel.solver.fit.pixel_fit import fit_pixels
from roundel.solver.pose.circle_pose import poses_from_ellipse

Array = NDArray[np.float64]

FOCAL_PX, RADIUS_M = 500.0, 0.04
METHODS = ("pixels", "ml", "direct")
# Semi-major axis in px, tilt in degrees, semi-minor axis over blur (0: sharp), marker.
CASES = {
    f"a{a}-t{tilt}-{'sharp' if not part else f'b/{part}'}{'' if kind == 'disc' else '-' + kind}": (a, tilt, part, kind)
    for a, tilt, part, kind in [
        *((a, tilt, part, "disc") for a in (30, 12) for tilt in (30, 60) for part in (0, 16, 8, 4)),
        (30, 60, 2, "disc"),
        (30, 30, 0, "ring"),
        (30, 60, 8, "ring"),
        (30, 60, 8, "narrow"),
        (30, 30, 16, "narrow"),
    ]
}


@dataclass(frozen=True, eq=False)
class Score:
    """Results of one method over the copies of one case."""

    scatter: Array  # (5,) over the bound, in x, y, S11, S12, S22
    bias_px: Array  # (4,) x, y, a, b
    normal: float  # rms error over the bound
    coverage: float  # mean of the squared error over its claimed covariance, over 5
    failed: int
    ms: float


def study_text(names: list[str]) -> str:
    """The cases as a study; a blur b is a circle of confusion of radius 2 b, the focus at half the distance."""
    groups = []
    for name in names:
        a, tilt, part, kind = CASES[name]
        distance_m = FOCAL_PX * RADIUS_M / a
        # A wide sheet, so that only the marker affects the band; `narrow` has the default margin, a third of it.
        lens, more = "", "" if kind == "narrow" else ", margin_m: 0.08"
        if kind == "ring":
            more += ", inner_diameter_m: 0.03"
        if part:
            blur_px = a * math.cos(math.radians(tilt)) / part
            aperture_mm = 4e3 * blur_px * distance_m / FOCAL_PX
            lens = f", aperture_mm: {aperture_mm:.6g}, focus_m: {distance_m / 2:.6g}"
        groups.append(
            f"  {group_name(name)}:\n"
            f"    camera: {{width_px: 160, height_px: 120, focal_px: {FOCAL_PX:g}{lens}}}\n"
            f"    marker: {{kind: {'ring' if kind == 'ring' else 'disc'}, diameter_m: {2 * RADIUS_M}{more}}}\n"
            f"    pose: {{distance_D: {distance_m / RADIUS_M / 2:.6g}, tilt_deg: {tilt}, azimuth_deg: 40,"
            " offset_x_px: 7.3, offset_y_px: -4.1}\n"
        )
    return (
        "schema: 1\nname: renoised\nseed: 4\n"
        "light:\n  environment: 0.7\n  lamps:\n    - {position_m: [-0.6, -0.8, -0.2], size_m: 0.3, radiance: 12}\n"
        "sensor: {full_well_e: 10000, read_noise_e: 5}\n"
        "render: {target_error: 0.001, band_samples: 16384, samples: 512}\n"
        "frames: 1\ngroups:\n" + "".join(groups)
    )


def group_name(name: str) -> str:
    return name.replace("/", "_").replace("-", "_")


def rendered(names: list[str], folder: Path) -> dict[str, tuple[Frame, NDArray[np.float32]]]:
    """Frame and radiance of each case."""
    path = folder / "renoised.yaml"
    path.write_text(study_text(names), encoding="utf-8")
    study = load_study(path)
    render_study(study, folder / "dataset")
    ids = {group: members[0] for group, members in group_ranges(study).items()}
    out = {}
    for name in names:
        i = ids[group_name(name)]
        out[name] = (frame_of(study, i), read_radiance(folder / "dataset" / files.radiance_name(i))["Y"])
    return out


def levels_and_noise(frame: Frame, radiance: NDArray[Any], ellipse: Array, ring: bool) -> tuple[Array, Array, float]:
    """Grey levels and noise inside and outside next to the edge, and the saturation level."""
    developed = develop(frame, radiance)
    y, x = np.mgrid[: radiance.shape[0], : radiance.shape[1]]
    c, s = np.cos(np.radians(ellipse[4])), np.sin(np.radians(ellipse[4]))
    dx, dy = x - ellipse[0], y - ellipse[1]
    radius = np.hypot((c * dx + s * dy) / ellipse[2], (c * dy - s * dx) / ellipse[3])
    sheet = developed.sheet
    mean = radiance * developed.exposure_e * sheet.gain_dn_per_e + sheet.black_level_dn
    noise = developed.noise_dn()
    # The plateaus of a blurred edge begin beyond the blur; a ring's hole ends at 0.375.
    inner = (radius > 0.63) & (radius < 0.74) if ring else radius < 0.35
    outer = (radius > 1.6) & (radius < 1.8)
    levels = np.array([np.median(mean[inner]), np.median(mean[outer])])
    return (
        levels,
        np.array([np.median(noise[inner]), np.median(noise[outer])]),
        float(developed.record()["saturation_dn"]),
    )


def score_case(
    name: str, frame: Frame, radiance: NDArray[np.float32], copies: int
) -> tuple[dict[str, Score], float, float]:
    """Scores by method, the bound of the axes in px and that of the normal in degrees."""
    _, _, part, kind = CASES[name]
    pose, k = frame.camera_from_sheet, frame.camera.K
    truth = ellipse_of_conic(conic_of_circle(pose, RADIUS_M, k))
    levels, noise, full = levels_and_noise(frame, radiance, truth, kind == "ring")
    blur_px = truth[3] / part if part else 0.0
    information = shape_information_of_pixels(truth, levels[0], levels[1], blur_px, (noise[0], noise[1]))
    bound = np.sqrt(np.diag(np.linalg.inv(information)))
    pose_limit = pose_bound(pose_information_of_shape(information, pose, RADIUS_M, k))
    start = truth + np.array([0.3, -0.2, 0.3, 0.2, 1.0])
    shapes: dict[str, list[Array]] = {m: [] for m in METHODS}
    ellipses: dict[str, list[Array]] = {m: [] for m in METHODS}
    squares: dict[str, list[float]] = {m: [] for m in METHODS}
    seconds, failed = dict.fromkeys(METHODS, 0.0), dict.fromkeys(METHODS, 0)
    for copy in range(copies):
        image = develop(replace(frame, noise_seed=copy), radiance).image
        edges = edge_points(image, start, full)
        for method in METHODS:
            before = time.perf_counter()
            fit: EllipseFit | FailedFit | Array
            if isinstance(edges, FailedFit):
                fit = edges
            elif method == "pixels":
                fit = fit_pixels(image, edges, None, full)
            elif method == "ml":
                fit = fit_ellipse(edges.points_px, edges.sigma_px)
            else:
                fit = direct_ellipse(edges.points_px)
            seconds[method] += time.perf_counter() - before
            if isinstance(fit, FailedFit):
                failed[method] += 1
                continue
            ellipse = fit.ellipse if isinstance(fit, EllipseFit) else fit
            ellipses[method].append(ellipse)
            shapes[method].append(shape_of_ellipse(ellipse))
            if isinstance(fit, EllipseFit):
                error = shapes[method][-1] - shape_of_ellipse(truth)
                squares[method].append(float(error @ np.linalg.solve(fit.shape_cov, error)) / 5)
    scores = {}
    for method in METHODS:
        if len(shapes[method]) < 2:
            continue
        shape, ellipse = np.array(shapes[method]), np.array(ellipses[method])
        normals = poses_from_ellipse(ellipse, k, RADIUS_M).normal
        cosine = np.clip(np.max(normals @ pose[:3, 2], axis=1), -1.0, 1.0)
        normal = math.degrees(math.sqrt(np.mean(np.arccos(cosine) ** 2)))
        scores[method] = Score(
            shape.std(axis=0, ddof=1) / bound,
            ellipse.mean(axis=0)[:4] - truth[:4],
            normal / pose_limit.normal_deg,
            float(np.mean(squares[method])) if squares[method] else math.nan,
            failed[method],
            1e3 * seconds[method] / copies,
        )
    return scores, float(bound[2]), pose_limit.normal_deg


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--copies", type=int, default=500)
    parser.add_argument("--only", default="", help="only cases whose name contains this")
    parser.add_argument("--folder", default="", help="folder of the rendered dataset, which is reused if it exists")
    options = parser.parse_args()
    if options.folder:
        Path(options.folder).mkdir(parents=True, exist_ok=True)
    names = [name for name in CASES if options.only in name]
    print(
        f"{options.copies} copies a case; scatter is the worst of x, y, S11, S12, S22 over its bound (mean in brackets)"
    )
    print(
        "| case | bound of S11 px, normal deg | method | scatter | centre bias px | axis bias px | normal | coverage |"
    )
    print("|---|---|---|---|---|---|---|---|", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        for name, (frame, radiance) in rendered(
            list(CASES) if options.folder else names, Path(options.folder or folder)
        ).items():
            if name not in names:
                continue
            scores, bound, normal_deg = score_case(name, frame, radiance, options.copies)
            for method, s in scores.items():
                case = f"{name} | {bound:.4f}, {normal_deg:.3f}" if method == "pixels" else " | "
                note = f" ({s.failed} failed)" if s.failed else ""
                rms = float(np.sqrt(np.mean(s.scatter**2)))
                print(
                    f"| {case} | {method}{note} | {s.scatter.max():.2f} ({rms:.2f}) "
                    f"| {np.hypot(*s.bias_px[:2]):.4f} | {s.bias_px[2]:+.4f} {s.bias_px[3]:+.4f} "
                    f"| {s.normal:.2f} | {s.coverage:.2f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
