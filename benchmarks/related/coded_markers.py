"""Coded markers read on rendered frames: identities, recall, poses, focal length.

    python benchmarks/related/coded_markers.py [WORK] [--frames N] [--markdown FILE]

WORK (default out/bench-coded-markers) holds the rendered frames of `coded_markers.yaml`: 1,000 of `ring_code`, 1,000 of
`dot_code`, every identity, 20 to 29 px of semi-axis, tilts from 0 to 65 degrees. `calvet2016` and `bergamasco2011` read
those that they can, `pagani2011` 300 of them, with the true camera. For each: recall; wrong identities; normal and
position errors; the focal length from one image alone, its stated sigma, and how much it adds to a prior of 11.5 %
(drawn about the truth, fused by `fused_focal_px`), by distance. For `pagani2011` also how often it says that it cannot
tell, and how often the pose it chose is the wrong one.

Exits with status 1 if an identity is wrong, if recall is below 95 %, if less than 90 or more than 98 % of the true
focal lengths are in the stated regions of 95 %, or if a fused focal length is worse than the prior.
"""

from __future__ import annotations

import argparse
import importlib
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta

from roundel.datasets.dataset import Dataset, open_dataset
from roundel.datasets.layout import files
from roundel.render.run import render_study
from roundel.scenes.camera.focal_fusion import fused_focal_px
from roundel.scenes.camera.response_curve import LINEAR
from roundel.scenes.geometry.pose import angle_deg
from roundel.scenes.study.study import load_study
from roundel.solver.methods.plugin import Found, MethodFailure, View

Array = NDArray[np.float64]

HERE = Path(__file__).resolve().parent
READS = {"calvet2016": "ring_code", "bergamasco2011": "dot_code", "pagani2011": "ring_code"}
MOST = {"pagani2011": 300}
PRIOR = 0.115
DISTANCES = ((7.0, 8.0), (8.0, 9.0), (9.0, 10.0))


@dataclass
class Score:
    """What one method did with the frames of its marker."""

    frames: int = 0
    found: int = 0
    false: int = 0
    wrong_identity: list[int] = field(default_factory=list)
    missed: list[tuple[int, float, str]] = field(default_factory=list)
    untold: int = 0
    wrong_pose: list[int] = field(default_factory=list)
    normal_deg: list[float] = field(default_factory=list)
    position_pct: list[float] = field(default_factory=list)
    focal: list[tuple[float, float, float, float, float]] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)


def interval(hits: int, of: int) -> tuple[float, float]:
    """Clopper-Pearson interval of 95 % of a proportion."""
    low = 0.0 if hits == 0 else float(beta.ppf(0.025, hits, of - hits + 1))
    return low, 1.0 if hits == of else float(beta.ppf(0.975, hits + 1, of - hits))


def judge(score: Score, frame: int, truth: dict[str, Any], focal_px: float, answer: list[Found], identity: int) -> None:
    """Enter the answer for one frame: the detection nearest to the marker is its, all others are false."""
    true_px = np.array([truth["centre_image_x_px"], truth["centre_image_y_px"]])
    away = [float(np.hypot(*(np.asarray(one.centre_px) - true_px))) for one in answer]
    nearest = int(np.argmin(away)) if away and min(away) < truth["ellipse_a_px"] / 2 else -1
    score.false += len(answer) - (nearest >= 0)
    if nearest < 0:
        return
    one = answer[nearest]
    score.found += 1
    if one.identity != identity:
        score.wrong_identity.append(frame)
    normal = np.array([truth[f"normal_{axis}"] for axis in "xyz"])
    centre = np.array([truth[f"centre_{axis}_m"] for axis in "xyz"])
    errors = [float(angle_deg(np.asarray(n), normal)) for n, _ in one.poses]
    chosen = one.chosen if one.chosen is not None else int(np.argmin(errors))
    score.untold += one.chosen is None
    # A wrong branch is off by twice the tilt from the line of sight.
    sight = float(angle_deg(-normal, centre))
    if one.chosen is not None and errors[chosen] > max(sight, 1.0):
        score.wrong_pose.append(frame)
    score.normal_deg.append(errors[chosen])
    length = float(np.linalg.norm(centre))
    score.position_pct.append(100 * float(np.linalg.norm(np.asarray(one.poses[chosen][1]) - centre)) / length)
    prior = focal_px * float(np.exp(np.random.default_rng(frame).normal(0, PRIOR)))
    fused, measured, sigma = prior, np.nan, np.nan
    if one.focal_px is not None and one.focal_sigma_px is not None:
        measured, sigma = float(np.log(one.focal_px / focal_px)), one.focal_sigma_px / one.focal_px
        fused, _ = fused_focal_px(prior, PRIOR, one.focal_px, one.focal_sigma_px)
    errors_of_log = float(np.log(prior / focal_px)), float(np.log(fused / focal_px))
    score.focal.append((float(truth["distance_D"]), measured, sigma, *errors_of_log))


def measure(dataset: Dataset, count: int | None, scores: dict[str, Score]) -> None:
    """Enter every method over the frames of its marker."""
    finders = {name: importlib.import_module(f"roundel.solver.related.{name}").find for name in READS}
    images, rows = dataset.images, {row["frame_id"]: row for row in dataset.truth.to_pylist()}
    for i, frame in enumerate(images.frame_ids):
        markers, camera = images.markers(i), images.camera(i)
        kind, identity = str(markers[0]["kind"]), int(markers[0]["layout"]["id"])
        for name, reads in READS.items():
            score = scores[name]
            if kind != reads or score.frames >= min(MOST.get(name, len(images)), count or len(images)):
                continue
            view = View(images.image(i), camera, float(markers[0]["diameter_m"]), markers, 255.0, LINEAR)
            score.frames += 1
            if score.frames % 100 == 0:
                print(f"{name}: {score.frames} frames", file=sys.stderr)
            began = time.perf_counter()
            reason, answer = "nothing found", list[Found]()
            try:
                answer = finders[name](view)
            except MethodFailure as error:
                reason = str(error)
            score.seconds.append(time.perf_counter() - began)
            before = score.found
            judge(score, frame, rows[frame], float(camera.K[0, 0]), answer, identity)
            if score.found == before:
                score.missed.append((frame, float(rows[frame]["tilt_deg"]), reason))


def table(scores: dict[str, Score]) -> tuple[str, bool]:
    """The figures as Markdown, and whether all limits are kept."""
    lines = [
        "| method | frames | read | wrong identities | false | normal, deg | position, % | cannot tell | wrong pose "
        "| ms |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    good = True
    for name, s in scores.items():
        if not s.normal_deg:
            continue
        low, high = interval(s.found, s.frames)
        most = interval(len(s.wrong_identity), max(s.found, 1))[1]
        normal, position = (np.percentile(v, [50, 95]) for v in (s.normal_deg, s.position_pct))
        lines.append(
            f"| {name} | {s.frames} | {100 * s.found / s.frames:.1f} % ({100 * low:.1f} to {100 * high:.1f}) "
            f"| {len(s.wrong_identity)} (at most {100 * most:.2f} %) | {s.false} "
            f"| {normal[0]:.3f} / {normal[1]:.3f} | {position[0]:.4f} / {position[1]:.3f} "
            f"| {s.untold} | {len(s.wrong_pose)} | {1e3 * np.median(s.seconds):.0f} |"
        )
        good &= s.found >= 0.95 * s.frames and not s.wrong_identity
    lines += ["", "Median / 95th percentile. Focal length, error of its logarithm, in %:", ""]
    lines += [
        "| method | distance, D | frames | measured in | median error (interval) | sigma holds in "
        "| prior alone, RMS | fused, RMS | prior alone, median | fused, median |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name, s in scores.items():
        if name == "pagani2011" or not s.focal:
            continue
        every = np.array(s.focal)
        for near, far in (*DISTANCES, (0.0, np.inf)):
            some = every[(every[:, 0] >= near) & (every[:, 0] < far)]
            known = some[np.isfinite(some[:, 1])]
            if len(known) < 5:
                continue
            error = 100 * np.abs(known[:, 1])
            draws = np.median(np.random.default_rng(1).choice(error, (1000, len(error))), axis=1)
            inside = float(np.mean(np.abs(known[:, 1]) < 1.96 * known[:, 2]))
            alone, fused = 100 * np.abs(some[:, 3]), 100 * np.abs(some[:, 4])
            rms = np.sqrt(np.mean(alone**2)), np.sqrt(np.mean(fused**2))
            where = "all" if not near else f"{near:g} to {far:g}"
            lines.append(
                f"| {name} | {where} | {len(some)} | {len(known)} | {np.median(error):.2f} "
                f"({np.percentile(draws, 2.5):.2f} to {np.percentile(draws, 97.5):.2f}) | {100 * inside:.1f} % "
                f"| {rms[0]:.2f} | {rms[1]:.2f} | {np.median(alone):.2f} | {np.median(fused):.2f} |"
            )
            good &= rms[1] <= rms[0] and bool(np.median(fused) <= np.median(alone))
            good &= bool(near) or 0.90 <= inside <= 0.98
    return "\n".join(lines), good


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("work", nargs="?", type=Path, default=Path("out/bench-coded-markers"))
    parser.add_argument("--frames", type=int, help="at most so many of each marker")
    parser.add_argument("--markdown", type=Path, help="write the tables here, too")
    given = parser.parse_args()
    if not (given.work / files.MANIFEST).is_file():
        render_study(load_study(HERE / "coded_markers.yaml"), given.work)
    scores = {name: Score() for name in READS}
    try:
        measure(open_dataset(given.work), given.frames, scores)
    except KeyboardInterrupt:
        print("interrupted: the figures so far", file=sys.stderr)
    text, good = table(scores)
    print(text)
    for name, s in scores.items():
        for frame, tilt, reason in s.missed:
            print(f"{name}: frame {frame}, tilt {tilt:.0f} degrees: {reason}", file=sys.stderr)
        for what, which in (("identity", s.wrong_identity), ("pose", s.wrong_pose)):
            if which:
                print(f"{name}: wrong {what} in frames {which}", file=sys.stderr)
    if given.markdown is not None:
        head = "# Coded markers on rendered frames\n\nBy `python benchmarks/related/coded_markers.py`.\n\n"
        given.markdown.write_text(head + text + "\n", encoding="utf-8")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
