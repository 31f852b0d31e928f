"""`import roundel`: its public names, completion in editors, and lazy loading."""

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import roundel

HOUSE = Path(__file__).resolve().parents[1]
SOURCE = HOUSE / "roundel" / "__init__.py"


def names_for_checkers() -> dict[str, str]:
    """Public names as the block under TYPE_CHECKING imports them: name to module."""
    block = next(node for node in ast.parse(SOURCE.read_text()).body if isinstance(node, ast.If))
    return {
        alias.name: str(node.module).removeprefix("roundel.")
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }


def test_checkers_and_the_interpreter_see_the_same_names() -> None:
    assert names_for_checkers() == roundel._MODULES
    assert sorted([*roundel._MODULES, "__version__"]) == sorted(roundel.__all__)


@pytest.mark.parametrize("name", sorted(roundel._MODULES))
def test_each_name_is_there_under_its_own_module(name: str) -> None:
    home = importlib.import_module(f"roundel.{roundel._MODULES[name]}")
    assert getattr(roundel, name) is getattr(home, name)
    assert getattr(roundel, name).__doc__


def test_completion_lists_all_names() -> None:
    assert set(roundel.__all__) <= set(dir(roundel))


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'locat'"):
        _ = roundel.locat


def test_import_loads_nothing_heavy() -> None:
    # The promise is 0.1 s; without a clock: nothing beyond the standard library is loaded.
    script = (
        "import sys; before = set(sys.modules); import roundel; roundel.__version__\n"
        "heavy = {'numpy', 'cv2', 'mitsuba', 'drjit', 'scipy', 'pydantic', 'pyarrow'} & set(sys.modules)\n"
        "sys.exit(f'imported: {sorted(heavy)}' if heavy else 0)\n"
    )
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False, timeout=60)
    assert run.returncode == 0, run.stderr


def test_no_package_imports_the_front_door() -> None:
    rooms = ("configs", "scenes", "render", "datasets", "solver", "validate", "cli")
    offenders = []
    for path in (path for room in rooms for path in (HOUSE / room).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            if "roundel" in names or (isinstance(node, ast.ImportFrom) and node.module == "roundel"):
                offenders.append(path.name)
    assert offenders == []


def test_a_circle_there_and_back() -> None:
    K = np.array([[800.0, 0.0, 319.5], [0.0, 800.0, 239.5], [0.0, 0.0, 1.0]])
    tilt = np.radians(30)
    # The marker's Z is out of the printed face, toward the camera.
    pose = np.eye(4)
    pose[:3, :3] = [[1, 0, 0], [0, -np.cos(tilt), np.sin(tilt)], [0, -np.sin(tilt), -np.cos(tilt)]]
    pose[:3, 3] = [0.02, -0.01, 0.9]
    found = roundel.poses_from_conic(roundel.conic_of_circle(pose, 0.04, K), K, 0.04)
    errors = roundel.normal_error_deg(found.normal, pose[:3, 2])
    # Closed form in float64: 1e-6 degrees is far above its rounding, far below anything an image shows.
    assert np.min(errors) < 1e-6
    np.testing.assert_allclose(found.centre_m[np.argmin(errors)], pose[:3, 3], atol=1e-9)
