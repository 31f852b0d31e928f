"""Calibration from photographs of circle grids: does the camera depend on what was assumed, or on the views?

    python benchmarks/calibration/photographs.py IMAGE... [--grid 10x7] [--ratio 0.683] [--curve linear]

All images show grids of one printed pattern by one camera; `--ratio` is the diameter of a dot over the spacing, to
start from. For each case (curve, distortion, bend) it prints RMS, chi-square per degree of freedom and the camera with
its standard deviations; then fx and cx without each view in turn (jackknife), whose scatter is a second opinion on the
stated standard deviations: they know nothing of what the dots of a board share.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace

import numpy as np

from roundel.cli.arguments import grid
from roundel.solver.calibration.calibrate_images import GridViews, photographed_grids
from roundel.solver.calibration.grid_calibration import GridCalibration
from roundel.solver.calibration.grid_layout import GridLayout

NAMES = ("fx", "fy", "cx", "cy")


def values_of(found: GridCalibration) -> np.ndarray:
    k = found.camera.K
    return np.array([k[0, 0], k[1, 1], k[0, 2], k[1, 2]])


def line_of(name: str, found: GridCalibration) -> str:
    sigma = found.sigmas
    camera = ", ".join(f"{n} {v:.2f} ± {sigma[n]:.2f}" for n, v in zip(NAMES, values_of(found), strict=True))
    return (
        f"| {name} | {found.used} | {found.rms_px:.4f} | {found.chi_square:.1f} | {found.widened:.1f} | {camera} | "
        f"{found.edge_px:+.3f} ± {sigma['edge_px']:.3f} |"
    )


def jackknife(views: GridViews, bend: int) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviations by leaving out each view, and the stated ones, of fx, fy, cx, cy."""
    count = len(views.images)
    without = [
        values_of(replace(views, images=views.images[:i] + views.images[i + 1 :]).calibrate(5, bend))
        for i in range(count)
    ]
    scatter = np.sqrt((count - 1) / count * np.sum((np.array(without) - np.mean(without, axis=0)) ** 2, axis=0))
    stated = views.calibrate(5, bend).sigmas
    return scatter, np.array([stated[name] for name in NAMES])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("images", nargs="+")
    parser.add_argument("--grid", type=grid, default=(10, 7))
    parser.add_argument("--ratio", type=float, default=0.683)
    parser.add_argument("--curve", default="linear")
    arguments = parser.parse_args()
    layout = GridLayout(*arguments.grid, 1.0, arguments.ratio)
    print("| case | circles | RMS, px | chi-square | widened | camera, px | edges, px |")
    print("|---|---|---|---|---|---|---|")
    for curve in dict.fromkeys((arguments.curve, "linear", "srgb")):
        views = photographed_grids(arguments.images, layout, curve)
        for coefficients, bend in ((4, 0), (5, 0), (5, 2), (5, 4)) if curve == arguments.curve else ((5, 2),):
            name = f"{curve}, {'k1 k2 p1 p2' + (' k3' if coefficients == 5 else '')}, "
            name += f"bend of order {bend}" if bend else "flat"
            print(line_of(name, views.calibrate(coefficients, bend)), flush=True)
    views = photographed_grids(arguments.images, layout, arguments.curve)
    if len(views.images) > 4:
        scatter, stated = jackknife(views, 2)
        for name, a, b in zip(NAMES, scatter, stated, strict=True):
            print(f"{name}: {a:.2f} px by leaving out a view, {b:.2f} px stated")
    return 0


if __name__ == "__main__":
    sys.exit(main())
