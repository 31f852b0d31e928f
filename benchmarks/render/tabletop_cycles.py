"""A tabletop in Roundel and in Cycles: where the ink is, and the processor time for the same noise.

    python benchmarks/render/tabletop_cycles.py [--poses 12] [--samples 256] [--no-speed] [--json FILE]

Each frame of the `tabletop` group of worlds.yaml is rebuilt in Cycles from the same bodies and panels; their textures
become their means. Ink is compared in a band around its contour: the image, divided by a smooth light that is fitted to
the sheet, gives the coverage of each pixel, and its difference from the exact one moves centroid and area.
Cycles is given a window around the ink for that, and one whole frame for its time.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from peers import find_bpy, read_image, work
from reference import Array, coverage_of, ellipse_of, on_sheet
from scipy.ndimage import binary_dilation

from roundel.render.backend import start
from roundel.render.radiance import render_radiance
from roundel.render.scene.meshes import mesh_of
from roundel.render.scene.textures import TILE_M
from roundel.scenes.study.study import load_study
from roundel.scenes.surroundings.bodies import Body, Material
from roundel.scenes.world.frame import Frame, frame_of, group_ranges
from roundel.scenes.world.lamps import luminance_of

STUDY = Path(__file__).resolve().parent / "worlds.yaml"
THREADS = 2
MOST_PX, LEAST_TIMES = 0.02, 5.0
# Half width of the band around the contour, and of the window around the ink, in pixels.
_BAND, _AROUND = 2, 12
# Residuals of the fitted light beyond this many medians are left out.
_FAR = 8.0


def kind_of(made: Material) -> str:
    """How Cycles shows a material; the same cases as `roundel.render.scene.bodies.material`."""
    if made.kind in ("metal", "glass"):
        return made.kind
    shines = made.kind == "plastic" or (made.kind == "wood" and made.roughness < 0.35)
    return "plastic" if shines else "diffuse"


def scene_file(frame: Frame, path: Path) -> None:
    """Everything that Cycles needs of a frame, in the camera frame."""
    around, sheet = frame.surroundings, frame.sheet
    assert around is not None
    (x0, y0), (x1, y1) = sheet.low_m, sheet.high_m
    # The paper's body, just below the print.
    place = frame.camera_from_sheet.copy()
    thick = around.sheet_thickness_m / 2
    place[:3, 3] += place[:3, :3] @ np.array([(x0 + x1) / 2, (y0 + y1) / 2, -thick - 2e-6])
    half = np.array([(x1 - x0) / 2, (y1 - y0) / 2, thick])
    bodies = [*around.bodies, Body("box", place, half, Material("matte", (sheet.paper,) * 3))]
    arrays: dict[str, Any] = {}
    for i, body in enumerate(bodies):
        mesh, pose = mesh_of(body), body.camera_from_body
        arrays[f"vertices_{i}"] = mesh.vertices @ pose[:3, :3].T + pose[:3, 3]
        arrays[f"normals_{i}"] = mesh.normals @ pose[:3, :3].T
        arrays[f"faces_{i}"] = mesh.faces
    (disc,) = sheet.shapes
    about = {
        "width_px": frame.camera.width_px,
        "height_px": frame.camera.height_px,
        "focal_px": float(frame.camera.K[0, 0]),
        "cx_px": float(frame.camera.K[0, 2]),
        "cy_px": float(frame.camera.K[1, 2]),
        "camera_from_sheet": frame.camera_from_sheet.tolist(),
        "low_m": list(sheet.low_m),
        "high_m": list(sheet.high_m),
        "radius_m": disc.radius_m,
        "ink": disc.reflectance,
        "paper": sheet.paper,
        "bodies": [
            {
                "kind": kind_of(body.material),
                "colour": luminance_of(list(body.material.colour)),
                "roughness": body.material.roughness,
                "textured": body.material.kind in TILE_M,
            }
            for body in bodies
        ],
        "panels": [
            {
                "camera_from_panel": panel.camera_from_panel.tolist(),
                "half_m": list(panel.half_m),
                "radiance": panel.radiance * luminance_of(list(panel.colour)),
            }
            for panel in around.panels
        ],
    }
    np.savez(path, about=json.dumps(about), **arrays)


def window_of(frame: Frame) -> list[int]:
    """Columns and rows (x0, y0, x1, y1) around the ink."""
    x, y, a, *_ = ellipse_of(frame)
    reach = int(a) + _AROUND
    return [int(x) - reach, int(y) - reach, int(x) + reach + 1, int(y) + reach + 1]


def measured(frame: Frame, image: Array) -> dict[str, float]:
    """Shift of the ink's centroid and of its area-equivalent radius against the truth, px, and the edge error."""
    x0, y0, x1, y1 = window_of(frame)
    window = np.s_[y0:y1, x0:x1]
    cover, seen = coverage_of(frame, (x0, y0, x1, y1))[window], image[window]
    sheet = on_sheet(frame, x0, y0, x1, y1)
    (disc,) = frame.sheet.shapes
    ink, paper = disc.reflectance, frame.sheet.paper
    rows, columns = np.mgrid[y0:y1, x0:x1]
    u, v = (columns - columns.mean()) / 50, (rows - rows.mean()) / 50
    terms = np.stack([u**i * v**j for i in range(4) for j in range(4 - i)], axis=-1)
    theory = paper + (ink - paper) * cover
    cut = (cover > 0) & (cover < 1)
    band = binary_dilation(cut, iterations=_BAND)
    plain = sheet & ~band
    design, values = terms[plain] * theory[plain][:, None], seen[plain]
    solution, *_ = np.linalg.lstsq(design, values, rcond=None)
    # Rare bright paths would draw the light toward them: once more without what is far from it.
    left = np.abs(values - design @ solution)
    near = left < _FAR * np.median(left)
    solution, *_ = np.linalg.lstsq(design[near], values[near], rcond=None)
    light = terms @ solution
    found = (seen / light - paper) / (ink - paper)
    left = np.where(band & sheet, found - cover, 0.0)
    area = float(cover.sum())
    return {
        "x_px": float((left * (columns - (cover * columns).sum() / area)).sum() / area),
        "y_px": float((left * (rows - (cover * rows).sum() / area)).sum() / area),
        "radius_px": float(left.sum() / (2 * np.sqrt(np.pi * area))),
        "edge_error": float(np.sqrt(np.mean(np.square((found - cover)[cut & (cover > 0.02) & (cover < 0.98)])))),
    }


def agreement(frames: list[Frame], ours: list[Array], samples: int, python: str, folder: Path) -> list[dict[str, Any]]:
    renders = []
    for i, frame in enumerate(frames):
        scene_file(frame, folder / f"scene_{i}.npz")
        renders.append(
            {
                "scene": str(folder / f"scene_{i}.npz"),
                "threshold": 0.0,
                "min_samples": 0,
                "samples": samples,
                "seed": 1,
                "window": window_of(frame),
                "out": str(folder / f"ink_{i}.exr"),
            }
        )
    work(python, "peer_tabletop.py", {"threads": THREADS, "renders": renders}, folder)
    found = []
    for i, (frame, image) in enumerate(zip(frames, ours, strict=True)):
        theirs = read_image(folder / f"ink_{i}.exr", frame, window_of(frame))
        found.append({"ours": measured(frame, image), "cycles": measured(frame, theirs)})
    return found


def noise_of(one: Array, other: Array, white: float) -> float:
    """Standard deviation of a pixel, as a fraction of white: the RMS over pixels below white, from two seeds."""
    dim = (one < white) & (other < white)
    return float(np.sqrt(np.mean(np.square(one[dim] - other[dim])) / 2) / white)


def speed(frame: Frame, threshold: float, samples: int, python: str, folder: Path) -> dict[str, Any]:
    """Processor seconds of the whole frame in both, its edge error and the noise of its background."""
    from dataclasses import replace

    mi = start(threads=THREADS)
    render_radiance(mi, frame)
    ours, seconds = [], []
    for seed in (1, 2):
        began = time.process_time()
        ours.append(render_radiance(mi, replace(frame, ray_seed=seed)).mean.astype(float))
        seconds.append(time.process_time() - began)
    scene_file(frame, folder / "whole.npz")
    renders = [
        {
            "scene": str(folder / "whole.npz"),
            "threshold": threshold,
            "min_samples": 4,
            "samples": samples,
            "seed": seed,
            "window": None,
            "out": str(folder / f"whole_{seed}.exr"),
        }
        for seed in (1, 2)
    ]
    told = work(python, "peer_tabletop.py", {"threads": THREADS, "renders": renders}, folder)
    theirs = [read_image(Path(r["out"]), frame, None) for r in renders]
    out: dict[str, Any] = {"threshold": threshold, "version": told["version"]}
    for name, images, cpu in (("ours", ours, seconds), ("cycles", theirs, [s[1] for s in told["seconds"]])):
        x0, y0, x1, y1 = window_of(frame)
        white = float(np.quantile(images[0][y0:y1, x0:x1], 0.9))
        edge = float(np.mean([measured(frame, image)["edge_error"] for image in images]))
        out[name] = {"cpu_s": cpu, "edge_error": edge, "noise": noise_of(images[0], images[1], white)}
    return out


def lines(result: dict[str, Any]) -> list[str]:
    out = [
        "| pose | ours: x, y, radius, px | Cycles: x, y, radius, px | edge error, ours; Cycles |",
        "|---|---|---|---|",
    ]
    for i, pose in enumerate(result["poses"]):
        cells = [
            ", ".join(f"{pose[who][key]:+.4f}" for key in ("x_px", "y_px", "radius_px")) for who in ("ours", "cycles")
        ]
        errors = "; ".join(f"{pose[who]['edge_error']:.4f}" for who in ("ours", "cycles"))
        out.append(f"| {i} | {cells[0]} | {cells[1]} | {errors} |")
    out += ["", f"Largest difference between the two: {result['most_px']:.4f} px; at most {MOST_PX}."]
    if "speed" in result:
        found = result["speed"]
        for name in ("ours", "cycles"):
            s = found[name]
            out.append(
                f"Whole frame, {name}: {np.median(s['cpu_s']):.1f} CPU s, edge error {s['edge_error']:.4f}, noise of "
                f"the background {s['noise']:.4f} of white."
            )
        out.append(f"Cycles takes {found['times']:.1f} times as long (at least {LEAST_TIMES:g} wanted).")
    return out


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--poses", type=int, default=12)
    parser.add_argument("--samples", type=int, default=256, help="Cycles' samples per pixel for the ink")
    parser.add_argument("--threshold", type=float, default=0.03, help="Cycles' threshold for the whole frame")
    parser.add_argument("--most", type=int, default=1024, help="Cycles' most samples per pixel for the whole frame")
    parser.add_argument("--no-speed", action="store_true")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    python = find_bpy()
    if python is None:
        raise SystemExit("Cycles: needs bpy on Python 3.11; `make bench-env` installs it")
    study = load_study(STUDY)
    frames = [frame_of(study, i) for i in group_ranges(study)["tabletop"][: asked.poses]]
    mi = start(threads=THREADS)
    ours = [render_radiance(mi, frame).mean.astype(float) for frame in frames]
    with tempfile.TemporaryDirectory() as name:
        poses = agreement(frames, ours, asked.samples, python, Path(name))
        keys = ("x_px", "y_px", "radius_px")
        result: dict[str, Any] = {
            "poses": poses,
            "most_px": max(abs(pose["ours"][key] - pose["cycles"][key]) for pose in poses for key in keys),
        }
        if not asked.no_speed:
            result["speed"] = speed(frames[0], asked.threshold, asked.most, python, Path(name))
            medians = [float(np.median(result["speed"][who]["cpu_s"])) for who in ("ours", "cycles")]
            result["speed"]["times"] = medians[1] / medians[0]
    print("\n".join(lines(result)))
    if asked.json:
        asked.json.write_text(json.dumps(result, indent=1))
    slow = "speed" in result and result["speed"]["times"] < LEAST_TIMES
    return int(result["most_px"] > MOST_PX or slow)


if __name__ == "__main__":
    sys.exit(main())
