"""Make the figure of docs/re-exposure.md: `python docs/re_exposure/make.py OUT`.

Renders scene.yaml once, re-exposes it for the sensors beside this script, solves and validates each, and compares the
reports. What OUT has already is kept.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from roundel.cli.main import main as roundel

HERE = Path(__file__).parent
SENSORS = ("iso", "exposure", "jpeg", "processing")


def run(*words: str | Path) -> None:
    """Run a command of `roundel`; stop if it fails."""
    status = roundel([str(word) for word in words])
    if status:
        raise SystemExit(status)


def main(out: Path) -> None:
    """Run every command of the page, and copy the figure of the comparison."""
    scene = out / "scene"
    run("run", HERE / "scene.yaml", scene)
    for name in SENSORS:
        mine = out / name
        run("develop", scene / "dataset", mine / "dataset", "--sensor", HERE / f"{name}.yaml")
        run("solve", mine / "dataset", mine / "estimates", "--intrinsics", "true")
        run("validate", mine / "dataset", mine / "estimates", "--out", mine / "report")
    reports = [out / name / "report" for name in ("scene", *SENSORS)]
    run("compare", *reports, "--out", out / "compare")
    shutil.copyfile(out / "compare" / "figures" / "sensors.svg", HERE / "sensors.svg")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
