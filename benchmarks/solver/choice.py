"""Check whether the disambiguation probabilities are calibrated: of the cases declared 0.8, are 80 % correct?

    python benchmarks/solver/choice.py [--cases 2000] [--kinds KIND,...] [--json FILE]

For each kind of prior knowledge, cases are drawn from the prior that it declares: markers 5 to 50 D away, tilted 10 to
70 degrees in any direction, anywhere in the image (f = 1,016 px on 1280x720), with noise on the ellipse. Names ending
in `_default` have a focal length wrong by 11.5 % and a principal point wrong by 20 px (one sigma each). Cues on the
print are rendered and measured, so that real pixels decide; they declare nothing about the normal, so all directions
are equally likely. `_far` cases are 25 to 60 D away, with stronger noise. The output is a table of bins of the
probability declared for candidate 0 against how often it was the true one, and the expected calibration error: the mean
of |declared - right| over the bins, weighted by cases. The true candidate is the one whose normal is nearer to the true
normal.

These are thousands of simulated cases, which tell calibration errors of 0.03; `benchmarks/ambiguity/ambiguity.py` has
the whole solver on rendered frames, fewer of them, and says how often the choice is decided.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from choice_cases import KINDS, MARKS, cases
from numpy.typing import NDArray

BINS = 10
MOST = 0.03


def reliability(declared: NDArray[np.float64], first: NDArray[np.bool_]) -> tuple[list[dict[str, Any]], float]:
    """Bins of equal width over the probability of candidate 0, and the expected calibration error."""
    index = np.minimum((declared * BINS).astype(int), BINS - 1)
    rows, error = [], 0.0
    for b in range(BINS):
        inside = index == b
        if np.any(inside):
            said, was = float(declared[inside].mean()), float(first[inside].mean())
            error += float(np.mean(inside)) * abs(said - was)
            rows.append({"from": b / BINS, "cases": int(inside.sum()), "declared": said, "right": was})
    return rows, error


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", type=int, default=2000)
    parser.add_argument("--kinds", default=",".join([*KINDS, *MARKS]))
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    result: dict[str, Any] = {}
    for kind in arguments.kinds.split(","):
        outcome = list(cases(kind, arguments.cases))
        declared = np.array([p for p, _ in outcome])
        first = np.array([right for _, right in outcome])
        rows, error = reliability(declared, first)
        sure = np.maximum(declared, 1 - declared)
        right = np.where(declared > 0.5, first, ~first)
        informed = np.abs(declared - 0.5) > 1e-6
        result[kind] = {
            "cases": len(outcome),
            "expected_calibration_error": error,
            "chosen": float(informed.mean()),
            "mean_declared": float(sure.mean()),
            "right_where_chosen": float(right[informed].mean()) if informed.any() else None,
            "bins": rows,
        }
        print(
            f"\n{kind}: {len(outcome)} cases, expected calibration error {error:.4f}"
            f" ({'within' if error <= MOST else 'ABOVE'} {MOST}); chosen {informed.mean():.3f},"
            f" mean probability of the likelier {sure.mean():.3f}, right where chosen"
            f" {right[informed].mean() if informed.any() else float('nan'):.3f}"
        )
        print("   declared     cases  mean    right")
        for row in rows:
            low = row["from"]
            print(f"   {low:.1f} - {low + 1 / BINS:.1f}  {row['cases']:6d}  {row['declared']:.3f}   {row['right']:.3f}")
        sys.stdout.flush()
    if arguments.json:
        arguments.json.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    return int(any(kind["expected_calibration_error"] > MOST for kind in result.values()))


if __name__ == "__main__":
    sys.exit(main())
