"""Each import contract fails if it is broken: forbidden imports are planted in a copy of the tree, one at a time."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("configs", "scenes", "render", "datasets", "solver", "validate", "cli")

# Contract, the file that breaks it, and the import that is planted there.
BREAKS = {
    "scenes stands alone": ("scenes/geometry/pose.py", "roundel.datasets.layout.files"),
    "datasets rests on scenes alone": ("datasets/layout/files.py", "roundel.solver.estimates"),
    "render rests on scenes and datasets": ("render/sensor/encode.py", "cv2"),
    "the solver is blind": ("solver/detect/arcs.py", "roundel.scenes.truth.truth"),
    "validate rests on": ("validate/statistics/intervals.py", "roundel.render.run"),
    "the solver's records are types": ("solver/estimates.py", "roundel.solver.fit.edges"),
    "the poses of an ellipse are": ("solver/pose/circle_pose.py", "roundel.solver.fit.edges"),
    "configs is data": ("configs/shipped.py", "roundel.scenes.errors"),
    "layers of scenes": ("scenes/geometry/pose.py", "roundel.scenes.study.values"),
    "layers of datasets": ("datasets/layout/files.py", "roundel.datasets.flags"),
    "layers of render": ("render/sensor/encode.py", "roundel.render.rays.rays"),
    "layers of solver": ("solver/fit/edges.py", "roundel.solver.detect.arcs"),
    "layers of validate": ("validate/statistics/intervals.py", "roundel.validate.metrics.metric"),
}


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tree")
    for name in FOLDERS:
        shutil.copytree(ROOT / name, folder / "roundel" / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "roundel" / "__init__.py", folder / "roundel")
    shutil.copy(ROOT / "pyproject.toml", folder)
    return folder


def broken_contracts(tree: Path) -> list[str]:
    command = [Path(sys.executable).parent / "lint-imports", "--no-logo", "--no-cache"]
    run = subprocess.run(command, cwd=tree, capture_output=True, text=True, check=False, timeout=120)
    assert "Contracts:" in run.stdout, run.stdout + run.stderr
    return [line for line in run.stdout.splitlines() if " BROKEN" in line]


def test_the_tree_keeps_every_contract(tree: Path) -> None:
    assert broken_contracts(tree) == []


@pytest.mark.parametrize("contract", BREAKS)
def test_a_planted_import_breaks_its_contract(contract: str, tree: Path) -> None:
    name, module = BREAKS[contract]
    file = tree / "roundel" / name
    kept = file.read_text(encoding="utf-8")
    file.write_text(f"{kept}\nimport {module}\n", encoding="utf-8")
    try:
        assert any(found.startswith(contract) for found in broken_contracts(tree))
    finally:
        file.write_text(kept, encoding="utf-8")
