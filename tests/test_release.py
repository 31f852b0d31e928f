"""What a release consists of: one version, a description that stands alone, wheel and sdist, and files beside them."""

from __future__ import annotations

import importlib
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path
from types import ModuleType

import pytest
import yaml
from helpers_runner import Runner, github
from packaging.requirements import Requirement

HOUSE = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((HOUSE / "pyproject.toml").read_text(encoding="utf-8"))
VERSION = PROJECT["project"]["version"]
LINK = re.compile(r"\]\(([^)]+)\)")
REPOSITORY = "https://github.com/owner/name"


@pytest.fixture
def make_dist(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    monkeypatch.syspath_prepend(str(HOUSE / "packaging"))
    yield importlib.import_module("make_dist")
    sys.modules.pop("make_dist", None)


def text_of(name: str) -> str:
    return (HOUSE / name).read_text(encoding="utf-8")


def test_every_file_that_repeats_the_version_has_this_one() -> None:
    assert f"\nversion: {VERSION}\n" in text_of("CITATION.cff")
    assert f"\n## [{VERSION}] - 20" in text_of("CHANGELOG.md")
    assert yaml.safe_load(text_of("packaging/conda/recipe.yaml"))["context"]["version"] == VERSION
    files = ("docs/gate.md", "docs/ci/github-actions.yml", "docs/ci/gitlab-ci.yml", "packaging/conda/environment.yaml")
    for name in files:
        assert set(re.findall(r"roundel-([\d.]+)-py3-none-any\.whl", text_of(name))) == {VERSION}, name
        assert set(re.findall(r"(?:roundel==|@v)([\d.]+\d)", text_of(name))) <= {VERSION}, name


def test_every_data_file_of_a_package_is_in_the_wheel() -> None:
    # setuptools ships what pyproject lists: a template that is missing there is left behind.
    data = PROJECT["tool"]["setuptools"]["package-data"]
    missing = []
    for package, folder in PROJECT["tool"]["setuptools"]["package-dir"].items():
        patterns = [*data["*"], *data.get(package, [])]
        for path in (HOUSE / folder).iterdir():
            shipped = path.suffix in (".py", ".pyc") or any(fnmatch(path.name, pattern) for pattern in patterns)
            if path.is_file() and not shipped:
                missing.append(path.relative_to(HOUSE).as_posix())
    assert missing == []


@pytest.mark.parametrize(
    ("repository", "between"), [("https://github.com/owner/name", "/"), ("https://gitlab.example/owner/name", "/-/")]
)
def test_links_of_the_description_are_absolute(make_dist: ModuleType, repository: str, between: str) -> None:
    made = make_dist.standalone(text_of("README.md"), repository, f"v{VERSION}")
    targets = LINK.findall(made)
    assert len(targets) == len(LINK.findall(text_of("README.md"))) > 10
    for target in targets:
        if not target.startswith(repository):
            assert target.startswith("https://"), target
            continue
        kind, tag, path = target.removeprefix(repository + between).split("#")[0].split("/", 2)
        assert tag == f"v{VERSION}"
        assert (HOUSE / path).is_dir() == (kind == "tree")
        assert (HOUSE / path).exists(), path
    assert f"{between}raw/v{VERSION}/docs/pictures/hero.png)" in made


def test_without_an_address_the_description_has_no_link_that_leads_nowhere(make_dist: ModuleType) -> None:
    made = make_dist.standalone(text_of("README.md"), None, f"v{VERSION}")
    assert [target for target in LINK.findall(made) if not target.startswith("https://")] == []
    assert "Results (`docs/results.md`)" in made
    assert "(how: `docs/store.md`)" in made


def test_a_link_of_the_description_that_leads_nowhere_stops_the_build(make_dist: ModuleType) -> None:
    with pytest.raises(ValueError, match=r"docs/gone\.md: no such file"):
        make_dist.standalone("See [this](docs/gone.md).", None, "v1")


def test_the_urls_are_part_of_the_project(make_dist: ModuleType) -> None:
    made = tomllib.loads(make_dist.with_urls(text_of("pyproject.toml"), REPOSITORY, "v1"))
    assert made["project"]["urls"]["Changelog"] == f"{REPOSITORY}/blob/v1/CHANGELOG.md"
    assert {**made, "project": {k: v for k, v in made["project"].items() if k != "urls"}} == PROJECT


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["--tag", "v9.9.9"], "pyproject.toml has version"),
        (["--repository", "owner/name"], "give https://HOST/OWNER/NAME"),
    ],
)
def test_a_release_that_cannot_be_right_is_refused(tmp_path: Path, arguments: list[str], line: str) -> None:
    command = [sys.executable, HOUSE / "packaging" / "make_dist.py", "--out", tmp_path / "dist", *arguments]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 2
    assert line in run.stderr
    assert not (tmp_path / "dist").exists()


CONDA = {
    "opencv-contrib-python-headless": "py-opencv",
    "openexr": "openexr-python",
    "matplotlib": "matplotlib-base",
    "karellen-llvm-core": "libllvm19",
}


def test_the_conda_recipe_has_the_dependencies_of_the_project() -> None:
    recipe = yaml.safe_load(text_of("packaging/conda/recipe.yaml"))["requirements"]
    asked = [Requirement(line) for line in PROJECT["project"]["dependencies"]]
    wanted = {CONDA.get(one.name.lower(), one.name.lower()): str(one.specifier) for one in asked}
    wanted |= {"python": PROJECT["project"]["requires-python"], "libllvm19": "", "py-opencv": ">=4.10.0"}
    assert {name: "".join(bound) for name, *bound in (line.split() for line in recipe["run"])} == wanted
    (setuptools,) = PROJECT["build-system"]["requires"]
    assert setuptools.replace(">=", " >=") in recipe["host"]


def test_the_hooks_of_pre_commit_are_those_of_make_check() -> None:
    (repository,) = yaml.safe_load(text_of(".pre-commit-config.yaml"))["repos"]
    entries = " ; ".join(hook["entry"] for hook in repository["hooks"])
    (check,) = re.findall(r"^check:.*\n((?:\t.*\n)+)", text_of("Makefile"), flags=re.M)
    for command in ("ruff check", "ruff format", "mypy", "lint-imports --no-logo --config ../pyproject.toml"):
        assert f"$(BIN)/{command}" in check
        assert f".venv/bin/{command}" in entries
    assert check.count("$(BIN)") == len(repository["hooks"])


def test_the_container_takes_the_wheel_and_the_versions_that_are_tested() -> None:
    lines = text_of("packaging/Containerfile")
    (copied,) = re.findall(r"^COPY (.+) \S+$", lines, flags=re.M)
    constraints, wheel = copied.split()
    assert (HOUSE / constraints).is_file()
    assert fnmatch(f"dist/roundel-{VERSION}-py3-none-any.whl", wheel)
    assert 'CMD ["run", "demo"' in lines


@pytest.mark.slow
def test_the_release_workflow_as_it_is_written(tmp_path: Path) -> None:
    # All but what it uploads: a checkout of this tree, the tag, the build, and the wheel away from the checkout.
    runner = Runner(tmp_path)
    listed = subprocess.run(
        ["git", "-C", HOUSE, "ls-files", "-z", "-co", "--exclude-standard"], check=True, capture_output=True, text=True
    )
    known = sorted(name for name in listed.stdout.split("\0") if name and (HOUSE / name).is_file())
    for name in known:
        (runner.checkout / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(HOUSE / name, runner.checkout / name)
    subprocess.run("git init --quiet . && git add --all", shell=True, check=True, cwd=runner.checkout)
    server, name = REPOSITORY.rsplit("/", 2)[0], REPOSITORY.split("/", 3)[3]
    given = {"GITHUB_SERVER_URL": server, "GITHUB_REPOSITORY": name, "GITHUB_REF_NAME": f"v{VERSION}"}
    job = github(runner, text_of(".github/workflows/release.yml"), "build", given)
    assert job.failed is None, job.output
    assert job.output.count("PASSED") == 2  # twine, of both
    assert "no problems found" in job.output
    assert "gate: passed" in job.output
    with zipfile.ZipFile(runner.checkout / "dist" / f"roundel-{VERSION}-py3-none-any.whl") as wheel:
        names = wheel.namelist()
        described = wheel.read(f"roundel-{VERSION}.dist-info/METADATA").decode()
    assert {name.split("/")[0] for name in names} == {"roundel", f"roundel-{VERSION}.dist-info"}
    assert [name for name in names if "test" in Path(name).name.split("_")] == []
    assert {"roundel/configs/demo.yaml", "roundel/scenes/study/presets.yaml"} <= set(names)
    assert f"Project-URL: Source, {REPOSITORY}\n" in described
    assert f"({REPOSITORY}/blob/v{VERSION}/docs/gate.md)" in described
    with tarfile.open(runner.checkout / "dist" / f"roundel-{VERSION}.tar.gz") as sdist:
        inside = {name.partition("/")[2] for name in sdist.getnames()}
    assert set(known) - inside == {".gitignore"}


@pytest.mark.slow
@pytest.mark.skipif(
    "ROUNDEL_CONTAINER" not in os.environ,
    reason="set ROUNDEL_CONTAINER to the flags of packaging/container.sh ('', or --debootstrap) where a builder works",
)
def test_the_container_builds_and_its_demo_runs(tmp_path: Path) -> None:
    subprocess.run(["make", "dist"], check=True, cwd=HOUSE)
    command = [HOUSE / "packaging" / "container.sh", *shlex.split(os.environ["ROUNDEL_CONTAINER"]), tmp_path / "out"]
    built = subprocess.run(command, check=False, capture_output=True, text=True)
    assert built.returncode == 0, built.stdout + built.stderr
    assert "no problems found" in built.stdout
    with (tmp_path / "out" / "demo" / "dataset" / "manifest.json").open(encoding="utf-8") as file:
        assert json.load(file)["versions"]["roundel"] == VERSION
