"""Response curves: `locate` on arrays of which nothing is said, against the same arrays with their curve declared.

    python benchmarks/solver/response_curve.py [WORK] [--frames N] [--json FILE]

WORK (default out/bench-response-curve) holds the rendered frames. Each frame is exposed as 8-bit levels by every sensor
below, through each curve, and solved with the true camera three times: as `linear`, whatever it is; without a word; and
with its curve declared. For each: how often the curve was recognised, left undecided or wrong; the median and the worst
position error relative to the one with the declared curve; and the part of all true positions within the 95 % region of
the reported covariance (3 degrees of freedom), and beyond 5 sigma. JPEG's tables are not known to `locate`, which gets
an array.

Exits with status 1 if more than 0.5 % of the decisions are wrong, or if a position is more than twice as far off as
with the declared curve while the answer has neither a caveat about the curve nor the truth within 5 sigma.
"""

from __future__ import annotations

import argparse
import io
import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image
from scipy.stats import chi2 as chi2_distribution

from roundel.datasets.layout import files
from roundel.datasets.layout.radiance import read_radiance
from roundel.render.run import render_study
from roundel.render.sensor.develop import develop
from roundel.render.sensor.encode import jpeg_bytes
from roundel.scenes.study.sensor_file import study_with_sensor
from roundel.scenes.study.study import Study, load_study
from roundel.scenes.world.frame import Frame, frame_of
from roundel.solver.estimates import Estimate
from roundel.solver.methods.locate import locate

Array = NDArray[np.float64]

HERE = Path(__file__).resolve().parent
CURVES = ("linear", "srgb")
SENSORS: dict[str, dict[str, Any]] = {
    "clean (10,000 e)": {},
    "noisy (1,000 e)": {"full_well_e": 1000},
    "very noisy (250 e)": {"full_well_e": 250},
    "dim (0.3 of white)": {"white_level": 0.3},
    "saturated (1.1)": {"white_level": 1.1},
    "saturated (1.6)": {"white_level": 1.6},
    "JPEG 90": {"jpeg_quality": 90},
    "JPEG 60": {"jpeg_quality": 60},
    "sharpened": {"isp": {"sharpen_amount": 0.7}},
}
WORDS = ("as linear", "without a word", "declared")
_REGION_95, _FIVE_SIGMA = (float(v) for v in chi2_distribution.ppf([0.95, chi2_distribution.cdf(25.0, 1)], 3))


@dataclass
class Score:
    """One sensor and curve, by what `locate` was told."""

    sensor: str
    curve: str
    told: str
    circles: int
    recognised: int
    undecided: int
    wrong: int
    median_ratio: float
    worst_ratio: float
    median_error_um: float
    within_95: float
    beyond_5: float
    unannounced: int


def rendered(work: Path) -> Study:
    """The study, rendered if it is not yet."""
    study = load_study(HERE / "response_curve.yaml")
    if not (work / "dataset" / files.MANIFEST).is_file():
        render_study(study, work / "dataset")
    return study


def exposed(frame: Frame, radiance: NDArray[np.float32], quality: int | None) -> NDArray[np.uint8]:
    """The frame's levels, through JPEG if it has a quality."""
    image = develop(frame, radiance).image
    return image if quality is None else np.asarray(Image.open(io.BytesIO(jpeg_bytes(image, quality))))


def nearest(estimates: list[Estimate], truth_m: Array) -> tuple[Estimate, float, float] | None:
    """The estimate nearest to the true centre, its error in m, and the error over its covariance, squared."""
    best = None
    for estimate in estimates:
        if not estimate or estimate.centre_m is None or estimate.cov is None:
            continue
        for candidate in range(len(estimate.centre_m)):
            error = estimate.centre_m[candidate] - truth_m
            size = float(np.linalg.norm(error))
            if size < 0.02 and (best is None or size < best[1]):
                cov = estimate.cov[candidate][:3, :3]
                best = estimate, size, float(error @ np.linalg.solve(cov, error))
    return best


def solved(
    study: Study, work: Path, sensor: str, curve: str, count: int
) -> dict[str, list[tuple[Estimate, float, float]]]:
    """The answers for the frames of one sensor and curve, by what `locate` was told; see `nearest`."""
    keys = {"curve": curve, **SENSORS[sensor]}
    path = work / "sensor.yaml"
    path.write_text(yaml.safe_dump(keys), encoding="utf-8")
    exposing = study_with_sensor(study, path)
    found: dict[str, list[tuple[Estimate, float, float]]] = {told: [] for told in WORDS}
    for i in range(count):
        frame = frame_of(exposing, i)
        radiance = read_radiance(work / "dataset" / files.radiance_name(i))["Y"]
        image = exposed(frame, radiance, keys.get("jpeg_quality"))
        truth_m = frame.camera_from_sheet[:3, 3]
        answers = [nearest(locate(image, 0.08, frame.camera, curve=said), truth_m) for said in ("linear", None, curve)]
        if all(answers):
            for told, answer in zip(WORDS, answers, strict=True):
                assert answer is not None
                found[told].append(answer)
    return found


def scored(study: Study, work: Path, sensor: str, curve: str, count: int) -> list[Score]:
    """The scores of one sensor and curve, by what `locate` was told."""
    found = solved(study, work, sensor, curve, count)
    reference = np.array([error for _, error, _ in found["declared"]])
    out = []
    for told in WORDS:
        estimates = [estimate for estimate, _, _ in found[told]]
        errors, squares = np.array([(error, square) for _, error, square in found[told]]).reshape(-1, 2).T
        kinds = [estimate.curve.partition(":")[0] for estimate in estimates]
        undecided = kinds.count("unknown")
        # An error of a hundredth of a sigma may be doubled: the reference is at least the median error.
        ratio = errors / np.maximum(reference, np.median(reference)) if len(errors) else np.zeros(0)
        silent = [not any("curve" in text for text in estimate.caveats) for estimate in estimates]
        out.append(
            Score(
                sensor,
                curve,
                told,
                len(errors),
                kinds.count(curve),
                undecided,
                len(kinds) - kinds.count(curve) - undecided,
                float(np.median(errors) / np.median(reference)) if len(errors) else float("nan"),
                float(np.max(ratio, initial=0.0)),
                1e6 * float(np.median(errors)) if len(errors) else float("nan"),
                float(np.mean(squares <= _REGION_95)) if len(errors) else float("nan"),
                float(np.mean(squares > _FIVE_SIGMA)) if len(errors) else float("nan"),
                int(np.count_nonzero((ratio > 2.0) & silent & (squares > _FIVE_SIGMA))),
            )
        )
    return out


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("work", nargs="?", type=Path, default=Path("out/bench-response-curve"))
    parser.add_argument("--frames", type=int, default=48)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    arguments.work.mkdir(parents=True, exist_ok=True)
    study = rendered(arguments.work)
    print("| sensor | levels | told | recognised | undecided | wrong | median ratio | worst | within 95 % | > 5 |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    scores: list[Score] = []
    for sensor in SENSORS:
        for curve in CURVES:
            for s in scored(study, arguments.work, sensor, curve, arguments.frames):
                scores.append(s)
                decided = (f"{s.recognised}/{s.circles}", str(s.undecided), str(s.wrong))
                if s.told != "without a word":
                    decided = ("", "", "")
                cells = (*decided, f"{s.median_ratio:.2f}", f"{s.worst_ratio:.1f}")
                parts = (f"{100 * s.within_95:.0f} %", f"{100 * s.beyond_5:.0f} %")
                print(f"| {s.sensor} | {s.curve} | {s.told} | {' | '.join((*cells, *parts))} |", flush=True)
    if arguments.json:
        arguments.json.write_text(json.dumps([asdict(s) for s in scores], indent=1), encoding="utf-8")
    mine = [s for s in scores if s.told == "without a word"]
    circles, wrong, silent = (sum(getattr(s, name) for s in mine) for name in ("circles", "wrong", "unannounced"))
    print(f"\n{circles} circles without a word: {wrong} wrong decisions, {silent} wrong in silence")
    return 1 if wrong > 0.005 * circles or silent else 0


if __name__ == "__main__":
    sys.exit(main())
