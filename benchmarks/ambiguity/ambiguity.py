"""How often is the ambiguity resolved? Every kind of prior knowledge on rendered frames.

    python benchmarks/ambiguity/ambiguity.py [--folder out/ambiguity] [--page] [--study FILE]

Renders `ambiguity.yaml`, or a copy of it with another seed, into FOLDER unless it is there, observes each circle with
the `pixels` method, once with its true camera and once with `default` intrinsics, declares each kind of knowledge of it
(`declared.py`), and prints how often the stated probabilities decide and how often they are right. `--page` writes the
tables to `ambiguity.md`, and the figure to `docs/ambiguity/ambiguity.svg`. Exits with status 1 if the probabilities of
a kind that `--knowledge` offers are overconfident beyond chance. All draws are seeded by frame and kind.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from declared import FALSE, KINDS
from figure import write_figure
from observed import COPLANAR, INTRINSICS, Circle, circles
from page import write_page
from scores import Stated, score_of

from roundel.datasets.dataset import Dataset, open_dataset
from roundel.render.run import render_study
from roundel.scenes.geometry.pose import angle_deg
from roundel.scenes.study.study import load_study
from roundel.solver.ambiguity.disambiguation import choose

STUDY = Path(__file__).with_name("ambiguity.yaml")
OVERCONFIDENT = -3.0  # standard deviations of what chance allows


@dataclass(frozen=True)
class Line:
    """One circle with one kind of knowledge."""

    kind: str
    circle: Circle
    probability: float


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--folder", type=Path, default=Path("out/ambiguity"))
    parser.add_argument("--page", action="store_true")
    parser.add_argument("--study", type=Path, default=STUDY)
    arguments = parser.parse_args()
    dataset = rendered(arguments.folder / "dataset", arguments.study)
    lines: list[Line] = []
    missed: dict[str, int] = {}
    for circle in circles(dataset):
        if circle.seen is None:
            missed[circle.group] = missed.get(circle.group, 0) + 1
            continue
        lines += declared_lines(circle)
    stated = gathered(lines)
    print(f"not found: {missed or 'none'}")
    wrong = []
    for s in stated:
        score = score_of(s.probability)
        print(
            f"{s.intrinsics:8s} {s.kind:45s} {score.circles:5d}"
            f" decided {score.decided:6.1%}, right {score.right_decided:6.1%};"
            f" right {score.right:6.1%}, stated {score.stated:6.1%}, excess {score.excess:+5.1f},"
            f" Brier {score.brier:.3f}, log {score.log_score:.3f}, error {score.calibration_error:.3f}"
        )
        if score.excess < OVERCONFIDENT and s.kind not in FALSE:
            wrong.append(s)
    if arguments.page:
        write_page(stated, len(dataset))
        write_figure(stated)
    return int(bool(wrong))


def rendered(folder: Path, study: Path) -> Dataset:
    """The study's dataset, rendered once."""
    if not (folder / "manifest.json").exists():
        render_study(load_study(study), folder)
    return open_dataset(folder)


def declared_lines(circle: Circle) -> list[Line]:
    """Every kind of knowledge that can be declared of a circle."""
    assert circle.seen is not None
    out = []
    for number, kind in enumerate(KINDS):
        if circle.group not in kind.groups:
            continue
        generator = np.random.default_rng([18, number, circle.frame_id])  # the same for both kinds of intrinsics
        knowledge = kind.declare(circle, generator)
        if knowledge is None:
            continue
        out.append(Line(kind.name, circle, choose(circle.seen, knowledge).probability[circle.true_candidate]))
    if circle.group in COPLANAR and circle.estimate is not None:
        estimate = circle.estimate
        assert estimate.normal is not None
        assert estimate.probability is not None
        true = int(np.argmin(angle_deg(estimate.normal, circle.normal)))
        name = {"two_discs": "coplanar, two discs", "dot_ring": "coplanar, six discs"}[circle.group]
        out.append(Line(name, circle, estimate.probability[true]))
    return out


def gathered(lines: list[Line]) -> list[Stated]:
    """The lines by kind of intrinsics and of knowledge."""
    out = []
    for intrinsics in INTRINSICS:
        mine = [line for line in lines if line.circle.intrinsics == intrinsics]
        for kind in dict.fromkeys([*(k.name for k in KINDS), *(line.kind for line in mine)]):
            own = [line for line in mine if line.kind == kind]
            values = np.array(
                [(x.probability, x.circle.distance_D, x.circle.line_of_sight_tilt_deg, x.circle.offset_px) for x in own]
            ).reshape(-1, 4)
            out.append(Stated(kind, intrinsics, *values.T))
    return out


if __name__ == "__main__":
    sys.exit(main())
