"""Calibration from a circle grid, a chessboard and ChArUco at equal views, printed area and noise, over many sets.

    python benchmarks/calibration/boards.py [--sets 40] [--folder FOLDER] [--markdown FILE]

FOLDER (default out/bench-boards) holds the rendered sets (`boards.yaml`; 15 s of one core each) and goes on where it
stopped. Each set has views of the three boards from the same poses. Only views in which every method finds its board
are used, so that all have the same poses. Methods:

- Roundel: the contours of the circles (`roundel.solver.calibration`);
- OpenCV, circles: `findCirclesGrid` and `calibrateCamera` on the same images;
- OpenCV, chessboard: `findChessboardCornersSB` and `cornerSubPix` (`roundel.solver.detect.chessboard_corners`);
- OpenCV, ChArUco: `CharucoDetector.detectBoard`, with its corner refinement.

All fit fx, fy, cx, cy, k1, k2, p1, p2; OpenCV's standard deviations are those of `calibrateCameraExtended`.

Exits with status 1 if the mean error of one of Roundel's fx, fy, cx, cy is outside its 95 % interval, if one of them
has an RMS error that is not below that of OpenCV from the same circles, or if less than 90 or more than 98 % of the
95 % intervals hold the truth.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.stats import t as student

from roundel.datasets.dataset import open_dataset
from roundel.datasets.layout.images import Images
from roundel.render.run import render_study
from roundel.scenes.camera.model import Camera
from roundel.solver.calibration.calibrate_images import grids_of_dataset
from roundel.solver.calibration.grid_layout import layout_of
from roundel.solver.detect.chessboard_corners import board_points_m, detect_corners
from roundel.solver.detect.chessboard_corners import layout_of as chessboard_layout
from roundel.validate.calibration.camera_errors import projection_difference

Array = NDArray[np.float64]

HERE = Path(__file__).resolve().parent
PARAMETERS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")
METHODS = {
    "Roundel, circles": "circles",
    "OpenCV, circles": "circles",
    "OpenCV, chessboard": "chessboard",
    "OpenCV, ChArUco": "charuco",
}
# Standard normal quantile of a two-sided 95 % interval.
TWO_SIDED = 1.959964
# Of the parameters whose standard deviations are judged: over 40 sets of 8 parameters, 320 intervals, nearly as many
# independent, a share of 95 % scatters by some 1.5 %.
LEAST_COVERAGE, MOST_COVERAGE = 0.90, 0.98


def render_set(number: int, folder: Path) -> Path:
    """Render a set, unless it is there."""
    path = folder / f"set-{number:02d}"
    study = yaml.safe_load((HERE / "boards.yaml").read_text(encoding="utf-8")) | {"seed": 1000 + number}
    file = folder / f"set-{number:02d}.yaml"
    file.write_text(yaml.safe_dump(study, sort_keys=False), encoding="utf-8")
    render_study(file, path, threads=1)
    return path


def opencv_circles(image: NDArray[Any], marker: dict[str, Any]) -> tuple[Array, Array] | None:
    layout = layout_of(marker["layout"])
    flags = cv2.CALIB_CB_ASYMMETRIC_GRID if layout.asymmetric else cv2.CALIB_CB_SYMMETRIC_GRID
    found, centres = cv2.findCirclesGrid(image, (layout.columns, layout.rows), flags=flags)
    return (layout.centres_m(), np.reshape(centres, (-1, 2))) if found else None


def opencv_chessboard(image: NDArray[Any], marker: dict[str, Any]) -> tuple[Array, Array] | None:
    layout = chessboard_layout(marker["layout"])
    corners = detect_corners(image, layout.columns, layout.rows)
    return None if corners is None else (board_points_m(layout)[:, :2], corners)


def opencv_charuco(image: NDArray[Any], marker: dict[str, Any]) -> tuple[Array, Array] | None:
    layout = marker["layout"]
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    size = layout["columns"], layout["rows"]
    board = cv2.aruco.CharucoBoard(size, layout["square_m"], layout["tag_m"], dictionary)
    corners, ids, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(image)
    if ids is None or len(ids) != (size[0] - 1) * (size[1] - 1):
        return None
    return np.asarray(board.getChessboardCorners(), dtype=np.float64)[np.ravel(ids), :2], np.reshape(corners, (-1, 2))


FINDERS = {
    "OpenCV, circles": opencv_circles,
    "OpenCV, chessboard": opencv_chessboard,
    "OpenCV, ChArUco": opencv_charuco,
}


def opencv_calibration(found: list[tuple[Array, Array]], size: tuple[int, int]) -> tuple[Camera, Array]:
    """Camera and standard deviations of `calibrateCameraExtended`."""
    points = [np.column_stack([p, np.zeros(len(p))]).astype(np.float32) for p, _ in found]
    pixels = [c.astype(np.float32).reshape(-1, 1, 2) for _, c in found]
    none: Any = None
    _, k, distortion, _, _, sigmas, _, _ = cv2.calibrateCameraExtended(
        points, pixels, size, none, none, flags=cv2.CALIB_FIX_K3
    )
    return Camera(*size, np.asarray(k, dtype=np.float64), tuple(np.ravel(distortion)[:4].tolist())), np.ravel(sigmas)[
        :8
    ]


def values_of(camera: Camera) -> Array:
    k = camera.K
    return np.array([k[0, 0], k[1, 1], k[0, 2], k[1, 2], *camera.distortion[:4]])


def by_group(images: Images) -> dict[str, list[int]]:
    return {g: [i for i, name in enumerate(images.groups) if name == g] for g in dict.fromkeys(images.groups)}


def record_of(path: Path) -> dict[str, Any]:
    """Errors and standard deviations of all methods on one set."""
    images = open_dataset(path).images
    groups = by_group(images)
    truth = images.camera(0)
    size = truth.width_px, truth.height_px
    started = time.process_time()
    grids = grids_of_dataset(images, "circles")
    seconds = {"Roundel, circles": time.process_time() - started}
    found: dict[str, list[Any]] = {"Roundel, circles": [v if len(v.index) == 35 else None for v in grids.images]}
    for name, find in FINDERS.items():
        started = time.process_time()
        found[name] = [find(images.image(i), images.markers(i)[0]) for i in groups[METHODS[name]]]
        seconds[name] = time.process_time() - started
    missed = {name: sum(view is None for view in views) for name, views in found.items()}
    common = [i for i in range(len(grids.images)) if all(views[i] is not None for views in found.values())]
    out: dict[str, Any] = {"views": len(common), "missed": missed, "methods": {}}
    for name, views in found.items():
        started = time.process_time()
        if name == "Roundel, circles":
            calibration = replace(grids, images=[grids.images[i] for i in common]).calibrate()
            camera, sigma = calibration.camera, np.array(list(calibration.sigmas.values()))[:8]
            out["chi_square"], out["left_out"] = calibration.chi_square, calibration.left_out
        else:
            camera, sigma = opencv_calibration([views[i] for i in common], size)
        seconds[name] += time.process_time() - started
        difference = projection_difference(camera, truth)
        out["methods"][name] = {
            "error": (values_of(camera) - values_of(truth)).tolist(),
            "sigma": sigma.tolist(),
            **difference.figures(),
            "seconds": seconds[name],
        }
    return out


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=40)
    parser.add_argument("--folder", type=Path, default=Path("out/bench-boards"))
    parser.add_argument("--markdown", type=Path, help="also write the tables to this file")
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    records = []
    for number in range(arguments.sets):
        file = arguments.folder / f"set-{number:02d}.json"
        if not file.exists():
            file.write_text(json.dumps(record_of(render_set(number, arguments.folder))), encoding="utf-8")
        records.append(json.loads(file.read_text(encoding="utf-8")))
        print(f"set {number}: {records[-1]['views']} views", file=sys.stderr, flush=True)
    text = tables(records)
    print(text)
    if arguments.markdown:
        arguments.markdown.write_text(text, encoding="utf-8")
    wrong = failures(records)
    print("\n".join(wrong), file=sys.stderr)
    return 1 if wrong else 0


def errors_of(records: list[dict[str, Any]], name: str) -> tuple[Array, Array]:
    """Errors and standard deviations (sets, 8) of a method."""
    mine = [record["methods"][name] for record in records]
    return np.array([m["error"] for m in mine]), np.array([m["sigma"] for m in mine])


def mean_interval(errors: Array) -> tuple[Array, Array]:
    """Mean over the sets, and the half width of its 95 % interval by Student's t."""
    count = len(errors)
    half = student.ppf(0.975, count - 1) * errors.std(axis=0, ddof=1) / np.sqrt(count)
    return errors.mean(axis=0), np.asarray(half)


def coverage(errors: Array, sigmas: Array) -> Array:
    """Share of the sets whose 95 % interval holds the truth, by parameter."""
    return np.asarray(np.mean(np.abs(errors) < TWO_SIDED * sigmas, axis=0))


def tables(records: list[dict[str, Any]]) -> str:
    views = [record["views"] for record in records]
    spread = str(min(views)) if min(views) == max(views) else f"{min(views)} to {max(views)}"
    missed = {name: sum(record["missed"][name] for record in records) for name in METHODS}
    lines = [
        f"{len(records)} sets of {spread} views in which every method found its board; views that "
        f"a method missed: {', '.join(f'{name} {count}' for name, count in missed.items())}.",
        "",
        "Mean error over the sets with its 95 % interval, px:",
        "",
        "| method | fx | fy | cx | cy |",
        "|---|---|---|---|---|",
    ]
    for name in METHODS:
        mean, half = mean_interval(errors_of(records, name)[0])
        lines.append(
            f"| {name} | " + " | ".join(f"{m:+.3f} ± {h:.3f}" for m, h in zip(mean[:4], half[:4], strict=True)) + " |"
        )
    lines += ["", "RMS error, px, and the median over the sets of the projection difference over the image, px:", ""]
    lines += [
        "| method | fx | fy | cx | cy | mean | mean, rotated | largest | CPU s |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name in METHODS:
        rms = np.sqrt(np.mean(errors_of(records, name)[0] ** 2, axis=0))
        figures = [
            np.median([record["methods"][name][key] for record in records])
            for key in ("projection_mean_px", "projection_mean_rotated_px", "projection_max_px", "seconds")
        ]
        texts = [f"{v:.3f}" for v in (*rms[:4], *figures[:3])] + [f"{figures[3]:.1f}"]
        lines.append(f"| {name} | " + " | ".join(texts) + " |")
    lines += ["", "Share of the 95 % intervals of the stated standard deviations that hold the truth, %:", ""]
    lines += ["| method | " + " | ".join(PARAMETERS) + " | all |", "|---" * (len(PARAMETERS) + 2) + "|"]
    for name in METHODS:
        shares = coverage(*errors_of(records, name))
        lines.append(f"| {name} | " + " | ".join(f"{100 * v:.0f}" for v in (*shares, shares.mean())) + " |")
    chi_square = [record["chi_square"] for record in records]
    lines += [
        "",
        f"Chi-square of Roundel's circles per degree of freedom: {min(chi_square):.2f} to {max(chi_square):.2f}, mean "
        f"{np.mean(chi_square):.2f}; dots left out: {sum(record['left_out'] for record in records)}.",
    ]
    return "\n".join(lines) + "\n"


def failures(records: list[dict[str, Any]]) -> list[str]:
    """What does not hold of the three claims."""
    ours, sigmas = errors_of(records, "Roundel, circles")
    theirs, _ = errors_of(records, "OpenCV, circles")
    mean, half = mean_interval(ours)
    found = [f"{name} is biased" for name, m, h in zip(PARAMETERS[:4], mean[:4], half[:4], strict=True) if abs(m) > h]
    better = np.sqrt(np.mean(ours**2, axis=0)) < np.sqrt(np.mean(theirs**2, axis=0))
    found += [
        f"{name} is no better than OpenCV's from circles"
        for name, b in zip(PARAMETERS[:4], better[:4], strict=True)
        if not b
    ]
    share = float(coverage(ours, sigmas).mean())
    if not LEAST_COVERAGE <= share <= MOST_COVERAGE:
        found.append(f"{100 * share:.0f} % of the 95 % intervals hold the truth")
    return found


if __name__ == "__main__":
    sys.exit(main())
