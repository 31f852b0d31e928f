"""Tutorials and recipes: their commands exist, their studies are studies, and the built pages do what they say."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers_pages import (
    DOCS,
    HOUSE,
    TUTORIALS,
    Block,
    blocks_of_html,
    blocks_of_source,
    documents_of,
    roundel_calls,
    without_documents,
)

import roundel
from roundel.cli.parser import build_parser
from roundel.scenes.study.study import load_study
from roundel.solver.intrinsics.specification import camera_for, parse_intrinsics

sys.path.insert(0, str(DOCS / "site"))
from transcript import difference, shown

RECIPES = sorted((DOCS / "how-to").glob("*.md"))
INDENTED = re.compile(r"^    (roundel .*)$", flags=re.M)


def parsed(call: list[str]) -> str | None:
    """What the command's parser has against a call."""
    try:
        build_parser().parse_args(call)
    except SystemExit as error:
        return None if error.code == 0 else " ".join(call)
    return None


@pytest.mark.parametrize("page", TUTORIALS, ids=lambda p: p.stem)
def test_the_commands_of_a_tutorial_parse(page: Path) -> None:
    blocks = blocks_of_source(page)
    assert len(blocks) >= 5
    for block in blocks:
        done = subprocess.run(["bash", "-n", "-c", block.commands], capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, "")
        # Each block is a script of its own in the build; a reader's shell would keep these.
        assert not re.search(r"^\s*(cd|export|source|\.) ", "\n".join(without_documents(block.commands)), flags=re.M)
    calls = [call for block in blocks for call in roundel_calls(without_documents(block.commands))]
    assert len(calls) >= 6
    assert [wrong for call in calls if (wrong := parsed(call))] == []


@pytest.mark.parametrize("page", TUTORIALS, ids=lambda p: p.stem)
def test_the_studies_of_a_tutorial_are_read(page: Path, tmp_path: Path) -> None:
    studies = {
        name: text
        for block in blocks_of_source(page)
        for name, text in documents_of(block.commands).items()
        if name.endswith(".yaml")
    }
    assert studies
    for name, text in studies.items():
        path = tmp_path / Path(name).name
        path.write_text(text, encoding="utf-8")
        load_study(path)


@pytest.mark.parametrize("page", [*RECIPES, DOCS / "troubleshooting.md"], ids=lambda p: p.stem)
def test_the_commands_of_a_recipe_parse(page: Path) -> None:
    lines = INDENTED.findall(page.read_text(encoding="utf-8"))
    assert [wrong for call in roundel_calls(lines) if (wrong := parsed(call))] == []


def test_the_studies_and_cameras_of_recipes_are_read(tmp_path: Path) -> None:
    texts = {page.stem: page.read_text(encoding="utf-8") for page in RECIPES}
    studies = re.findall(r"^```yaml\n(schema: .*?)^```", "\n".join(texts.values()), flags=re.S | re.M)
    assert len(studies) == 1
    for text in studies:
        (tmp_path / "study.yaml").write_text(text, encoding="utf-8")
        load_study(tmp_path / "study.yaml")
    (record,) = re.findall(r"^```json\n(.*?)^```", texts["own-camera"], flags=re.S | re.M)
    (tmp_path / "camera.json").write_text(record, encoding="utf-8")
    found = camera_for(parse_intrinsics(f"calibrated:{tmp_path / 'camera.json'}"), None, 1920, 1080)
    (call,) = re.findall(r"^camera = (roundel\.Camera\(.*\))$", texts["own-camera"], flags=re.M)
    assert np.array_equal(eval(call, {"roundel": roundel}).K, found.K)


def test_the_rule_of_transcripts() -> None:
    line = "pixels  true  24/24  0.00768 / 0.0284  0.7 %"
    assert difference(line, "pixels  true    24/24  0.00775 / 0.0280  0.7 %") is None  # 1 %, and another width
    assert difference(line, line.replace("0.0284", "0.0384")) is not None
    assert difference(line, line.replace("24/24", "22/24")) is not None
    assert difference(line, line.replace("pixels", "direct")) is not None
    assert difference("a\nb", "a") is not None
    assert difference("in 3 s, sha256 0123456789abcdef, p = 0.2", "in 12 s, sha256 fedcba9876543210, p = 1e-7") is None
    assert shown("render: 3 of 24 frames, 10 s\n\x1b[1mdone\x1b[0m \n") == "done"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built site; `make docs` does nothing anew where nothing has changed."""
    environment = {key: value for key, value in os.environ.items() if key not in ("MAKEFLAGS", "MAKELEVEL")}
    done = subprocess.run(["make", "docs"], cwd=HOUSE, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return HOUSE / "out" / "docs"


@pytest.fixture(scope="module")
def fresh_python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The `bin` folder of a new virtual environment into which Roundel was installed as a user installs it."""
    room = tmp_path_factory.mktemp("fresh")
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"], cwd=HOUSE, capture_output=True, text=True, check=True
    ).stdout
    for name in listed.splitlines():
        if not name.startswith(("docs/", "tests/", "benchmarks/")) and (HOUSE / name).is_file():
            (room / "source" / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(HOUSE / name, room / "source" / name)
    subprocess.run([sys.executable, "-m", "venv", str(room / "venv")], check=True)
    pip = [str(room / "venv" / "bin" / "python"), "-m", "pip", "install", "--disable-pip-version-check", "--quiet"]
    subprocess.run([*pip, "-c", str(HOUSE / "constraints.txt"), str(room / "source")], check=True)
    return room / "venv" / "bin"


def pasted(blocks: list[Block], folder: Path, binaries: Path) -> list[Block]:
    """Blocks as they end when they are pasted one after another into a shell that starts in an empty folder."""
    marks = [f"--- end of block {i} ---" for i in range(len(blocks))]
    script = "".join(f"{b.commands}\nprintf '\\n%s %s\\n' '{m}' $?\n" for b, m in zip(blocks, marks, strict=True))
    environment = {"PATH": f"{binaries}:/usr/local/bin:/usr/bin:/bin", "HOME": str(folder), "LANG": "C.UTF-8"}
    # Not interactive, as it reads from a pipe; otherwise it is the shell of a reader: no -e, and variables stay.
    output = subprocess.run(
        ["bash", "--noprofile", "--norc", "-s"],
        input=script,
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=1800,
        check=False,
    ).stdout
    found = []
    for block, mark in zip(blocks, marks, strict=True):
        text, _, output = output.partition(f"\n{mark} ")
        status, _, output = output.partition("\n")
        found.append(Block(block.commands, int(status), shown(text)))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("name", [page.stem for page in TUTORIALS])
def test_a_tutorial_ends_as_its_built_page_says(name: str, site: Path, fresh_python: Path, tmp_path: Path) -> None:
    blocks = blocks_of_html(site / "tutorials" / f"{name}.html")
    sources = blocks_of_source(DOCS / "tutorials" / f"{name}.md")
    # What is copied is what was written: no prompts, no line lost.
    assert [block.commands for block in blocks] == [source.commands for source in sources]
    for stated, found in zip(blocks, pasted(blocks, tmp_path, fresh_python), strict=True):
        assert (found.status, found.commands) == (stated.status, stated.commands), found.output
        lines = stated.output.splitlines()
        if lines[:1] == ["[...]"]:
            lines = lines[1:]
            found_lines = found.output.splitlines()[-len(lines) :]
        else:
            found_lines = found.output.splitlines()
        assert difference("\n".join(lines), "\n".join(found_lines)) is None, found.commands


@pytest.mark.slow
def test_pictures_and_pages_of_a_tutorial_are_on_the_site(site: Path) -> None:
    for page in TUTORIALS:
        html = (site / "tutorials" / f"{page.stem}.html").read_text(encoding="utf-8")
        for name in re.findall(r"```\{made\} (\S+)", page.read_text(encoding="utf-8")):
            flat = name.replace("/", "-")
            target = re.search(rf'(?:src|href)="([^"]*{re.escape(flat)})"', html)
            if target is None:  # Sphinx flattens pictures into _images, under the last part of their names
                target = re.search(rf'src="([^"]*{re.escape(Path(flat).stem)}\d*{Path(flat).suffix})"', html)
            assert target is not None, name
            assert (site / "tutorials" / target[1]).resolve().is_file(), name
