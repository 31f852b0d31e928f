"""The documents: valid links, a README that works, and generated pages that cover the code."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

import roundel
from roundel.datasets.layout.truth_table import TRUTH_COLUMNS
from roundel.scenes.study.schema import json_schema

HOUSE = Path(__file__).resolve().parents[1]
PAGES = sorted(
    path
    for path in (*HOUSE.glob("*.md"), *(HOUSE / "docs").rglob("*.md"), *(HOUSE / "benchmarks").rglob("*.md"))
    if "reference" not in path.parts
)
LINK = re.compile(r"\[[^\]]*\]\(((?:[^()\s]|\([^()\s]*\))+)\)")


def anchors_of(page: Path) -> set[str]:
    """Anchors of a page's headings, as GitHub and MyST make them."""
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.S)
    headings = re.findall(r"^#+ (.+)$", text, flags=re.M)
    plain = (re.sub(r"[^\w\- ]", "", re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", h)).lower() for h in headings)
    return {h.strip().replace(" ", "-") for h in plain}


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(HOUSE)))
def test_links_lead_somewhere(page: Path) -> None:
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.S)
    broken = []
    for target in LINK.findall(text):
        if target.startswith(("http://", "https://", "mailto:")):
            continue
        name, _, anchor = target.partition("#")
        file = (page.parent / name).resolve() if name else page
        if HOUSE / "docs" / "reference" in file.parents:
            continue  # made by the build, which fails on a link that leads nowhere
        if not file.exists() or (anchor and file.suffix == ".md" and anchor not in anchors_of(file)):
            broken.append(target)
    assert broken == []


def test_the_readme_is_short() -> None:
    assert len((HOUSE / "README.md").read_text(encoding="utf-8").splitlines()) <= 130


@pytest.fixture
def generators(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(HOUSE / "docs" / "site"))
    yield
    for name in ("api_pages", "column_pages", "import_graph", "study_pages", "generate"):
        sys.modules.pop(name, None)


def test_the_study_page_has_every_key(generators) -> None:
    from study_pages import study_page

    page = study_page()
    schema = json_schema()
    sections = [schema, *schema["$defs"].values()]
    keys = {key for section in sections for key in section.get("properties", {})} - {"groups", "preset"}
    assert {key for key in keys if f"| `{key}` |" not in page} == set()


def test_the_columns_page_has_every_column_of_the_truth(generators) -> None:
    from column_pages import columns_page

    page = columns_page()
    for columns in TRUTH_COLUMNS:
        assert f"| `{columns.names[0]}`" in page
        assert columns.meaning in page


def test_the_command_page_has_every_verb(generators) -> None:
    from generate import command_page

    page = command_page()
    for verb in ("check", "render", "solve", "validate", "run", "gate", "studies", "init", "doctor"):
        assert f"## roundel {verb}" in page


def test_the_api_page_has_every_public_name(generators) -> None:
    from api_pages import api_page

    page = api_page()
    assert [name for name in roundel.__all__ if name != "__version__" and f":: roundel.{name}\n" not in page] == []


def test_the_import_graph_is_of_this_tree(generators) -> None:
    from import_graph import draw_graph, imports_of

    graph = imports_of(HOUSE)
    assert "scenes/camera" in graph["solver/fit"]
    assert not any(
        target.startswith("validate") for name in graph if name.startswith("solver") for target in graph[name]
    )
    assert draw_graph(HOUSE).count("<rect") == len(graph) + 1


def test_the_example_of_the_theory_page_runs(capsys) -> None:
    page = (HOUSE / "docs" / "theory.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", page, flags=re.S)
    scope: dict[str, object] = {}
    exec(code, scope)
    pencil, both = scope["pencil"], roundel.poses_from_conic(scope["conic"], scope["K"], 0.04)
    np.testing.assert_allclose(pencil.normal, both.normal, atol=1e-9)
    assert "[False  True]" in capsys.readouterr().out
    # The homography carries the circle to its image.
    t = np.linspace(0, 6, 7)
    plane = np.stack([0.04 * np.cos(t), 0.04 * np.sin(t), np.ones(7)])
    image = scope["H"] @ plane
    image /= np.linalg.norm(image, axis=0)
    np.testing.assert_allclose(np.sum(image * (scope["conic"] @ image), axis=0), 0, atol=1e-9)
