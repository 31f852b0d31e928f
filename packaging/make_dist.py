"""Build the sdist and the wheel from the files that git tracks, and check both (`make dist`).

An index shows the README away from the repository, where relative links lead nowhere. Roundel does not know where its
repository will be published, so the address is an argument: with it, links and pictures of the README become absolute,
at the tag, and the package gets its project URLs. Without it, links become names of files, which the sdist holds.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
_LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\((?!https?:|#|mailto:)([^)#\s]+)(#[^)\s]*)?\)")


def standalone(text: str, repository: str | None, ref: str, root: Path = ROOT) -> str:
    """The README as it can be read anywhere.

    Parameters
    ----------
    text : str
        Markdown whose relative links start at `root`.
    repository : str or None
        Address of the repository's page, `https://HOST/OWNER/NAME`.
    ref : str
        The tag that links lead to.
    root : Path
        The checkout, to tell folders from files.

    Raises
    ------
    ValueError
        If a link leads to nothing.
    """

    def replaced(match: re.Match[str]) -> str:
        picture, label, target, anchor = match[1], match[2], match[3].rstrip("/"), match[4] or ""
        path = root / target
        if not path.exists():
            raise ValueError(f"README.md: {target}: no such file")
        if repository is None:
            if picture:
                return f"*({' '.join(label.split())})*"
            if label.strip("`") == target:
                return f"`{target}`"
            inside = match.string[: match.start()].endswith("(")
            return f"{label}: `{target}`" if inside else f"{label} (`{target}`)"
        kind = "raw" if picture else "tree" if path.is_dir() else "blob"
        return f"{picture}[{label}]({_page(repository, kind, ref)}/{target}{anchor})"

    return _LINK.sub(replaced, text)


def _page(repository: str, kind: str, ref: str) -> str:
    """The address under which GitHub, or GitLab, shows the files of a tag."""
    host = repository.split("/")[2]
    return f"{repository}/{'-/' if 'gitlab' in host else ''}{kind}/{ref}"


def with_urls(pyproject: str, repository: str, ref: str) -> str:
    """The project file with a table of URLs, which it does not have in the repository."""
    blob = _page(repository, "blob", ref)
    urls = {
        "Homepage": repository,
        "Source": repository,
        "Documentation": f"{_page(repository, 'tree', ref)}/docs",
        "Changelog": f"{blob}/CHANGELOG.md",
    }
    table = "\n".join(["[project.urls]", *(f'{name} = "{url}"' for name, url in urls.items())])
    return pyproject.replace("\n[project.scripts]\n", f"\n{table}\n\n[project.scripts]\n", 1)


def tracked_files(root: Path = ROOT) -> list[str]:
    """Files that git tracks and that are there."""
    listed = subprocess.run(["git", "-C", str(root), "ls-files", "-z"], check=False, capture_output=True, text=True)
    if listed.returncode:
        sys.exit(f"make dist needs a checkout of git: {listed.stderr.strip()}")
    return sorted(name for name in listed.stdout.split("\0") if name and (root / name).is_file())


def copy_tree(to: Path, repository: str | None, ref: str) -> None:
    """A copy of the tracked files, so that nothing else gets into a distribution; the README stands alone in it."""
    for name in tracked_files():
        target = to / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / name, target)
    readme, project = to / "README.md", to / "pyproject.toml"
    readme.write_text(standalone(readme.read_text(encoding="utf-8"), repository, ref), encoding="utf-8")
    if repository is not None:
        project.write_text(with_urls(project.read_text(encoding="utf-8"), repository, ref), encoding="utf-8")


def main() -> int:
    """Build into a folder, and check what is there."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="folder to write to (default: dist)")
    parser.add_argument("--repository", default="", metavar="URL", help="address of the published repository")
    parser.add_argument("--tag", default="", help="the tag that is released (default: v and the version)")
    given = parser.parse_args()
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    tag = given.tag or f"v{version}"
    if tag != f"v{version}":
        parser.error(f"tag {tag}: pyproject.toml has version {version}, whose tag is v{version}")
    repository = given.repository.rstrip("/").removesuffix(".git") or None
    if repository is not None and not re.fullmatch(r"https://[\w.:-]+(/[\w.~-]+){2,}", repository):
        parser.error(f"--repository {repository}: give https://HOST/OWNER/NAME")
    given.out.mkdir(parents=True, exist_ok=True)
    for old in given.out.glob("roundel-*"):
        old.unlink()
    with tempfile.TemporaryDirectory() as folder:
        copy_tree(Path(folder), repository, tag)
        # The wheel is built from the sdist, so that the sdist is known to hold all that it needs.
        _python("build", "--outdir", str(given.out), folder)
    made = sorted(str(path) for path in given.out.glob("roundel-*"))
    _python("twine", "check", "--strict", *made)
    _python("check_wheel_contents", *(name for name in made if name.endswith(".whl")))
    if repository is None:
        print(
            "no --repository: the package has no project URLs, and its description names files instead of linking them"
        )
    print("\n".join(made))
    return 0


def _python(module: str, *arguments: str) -> None:
    done = subprocess.run([sys.executable, "-m", module, *arguments], check=False, capture_output=True, text=True)
    # A build lists every file that it copies: only its last line tells something, unless it fails.
    lines = (done.stdout + done.stderr).rstrip().splitlines()
    print("\n".join(lines if done.returncode or module != "build" else lines[-1:]), flush=True)
    if done.returncode:
        sys.exit(f"{module} failed with status {done.returncode}")


if __name__ == "__main__":
    sys.exit(main())
