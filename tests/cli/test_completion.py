"""Completion in real shells: what they offer when you press Tab."""

import os
import pty
import select
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from roundel.cli import completion
from roundel.cli.main import main
from roundel.render.printing.marker_layouts import KINDS
from roundel.render.printing.print_page import PAPERS_MM
from roundel.solver.ambiguity.parse_prior import parse_knowledge
from roundel.solver.intrinsics.specification import parse_intrinsics
from roundel.solver.methods.registry import installed_methods

# What is typed before Tab, and the words that it can become.
OFFERS = {
    "roundel rend": ["render"],
    "roundel check de": ["defocus", "demo", "detection"],
    "roundel check my": ["my.yaml"],
    "roundel solve ds out --meth": ["--method"],
    "roundel solve ds out --method guar": ["guaranteed"],
    "roundel marker dot_r": ["dot_ring"],
    "roundel verify d": ["ds/"],
    "roundel completion fi": ["fish"],
}
SECONDS = 30  # for one answer, on a machine that is busy


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "ds").mkdir()
    for name in ("my.yaml", "my.txt"):
        (tmp_path / name).touch()
    return tmp_path


def environment(folder: Path) -> dict[str, str]:
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    return {"PATH": path, "HOME": str(folder), "XDG_CONFIG_HOME": str(folder), "TERM": "dumb", "PS1": "> "}


def found(shell: str) -> str:
    path = shutil.which(shell)
    if path is None:
        pytest.skip(f"{shell} is not installed")
    return path


class Terminal:
    """A shell at a terminal of its own: type into it, and wait for what it shows."""

    def __init__(self, command: list[str], folder: Path) -> None:
        self.keys, theirs = pty.openpty()
        self.process = subprocess.Popen(
            command, stdin=theirs, stdout=theirs, stderr=theirs, cwd=folder, env=environment(folder)
        )
        os.close(theirs)

    def shows(self, typed: str, words: list[str]) -> bool:
        """Whether all words come after this was typed."""
        os.write(self.keys, typed.encode())
        shown, deadline = "", time.monotonic() + SECONDS
        while time.monotonic() < deadline and not all(word in shown for word in words):
            if select.select([self.keys], [], [], 0.1)[0]:
                shown += os.read(self.keys, 65536).decode(errors="replace")
        return all(word in shown for word in words)

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        os.close(self.keys)


@pytest.mark.parametrize(
    ("shell", "options", "setup"),
    [
        ("bash", ["--norc", "--noprofile", "-i"], 'eval "$(roundel completion bash)"'),
        ("zsh", ["-f", "-i"], 'autoload -U compinit; compinit -u -D; eval "$(roundel completion zsh)"'),
    ],
)
def test_a_shell_at_a_terminal_completes(shell: str, options: list[str], setup: str, folder: Path) -> None:
    terminal = Terminal([found(shell), *options], folder)
    try:
        # The echo of what is typed has no 42 in it.
        assert terminal.shows(f"{setup}; echo loaded-$((40+2))\n", ["loaded-42"])
        for typed, words in OFFERS.items():
            # Ctrl-U empties the line; the second Tab lists what is left if there are several words.
            assert terminal.shows(f"\x15{typed}\t\t", words), typed
    finally:
        terminal.close()


def test_fish_completes(folder: Path) -> None:
    lines = ["roundel completion fish | source", *(f"echo =; complete -C '{typed}'" for typed in OFFERS)]
    run = subprocess.run(
        [found("fish"), "--no-config", "-c", "\n".join(lines)],
        cwd=folder, env=environment(folder), capture_output=True, text=True, check=True, timeout=8 * SECONDS,
    )  # fmt: skip
    answers = [[line.split("\t")[0] for line in part.splitlines()] for part in run.stdout.split("=\n")[1:]]
    for (typed, words), answer in zip(OFFERS.items(), answers, strict=True):
        assert set(words) <= set(answer), typed
        assert "my.txt" not in answer


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_is_printed(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    assert "roundel" in capsys.readouterr().out


def test_words_on_offer_are_those_that_the_verbs_take() -> None:
    assert set(completion.KINDS) == set(KINDS)
    assert set(completion.PAPERS) == set(PAPERS_MM)
    assert set(completion.METHODS) == {method.name for method in installed_methods() if method.source == "roundel"}
    for text in completion.INTRINSICS:
        if not text.endswith(":"):
            parse_intrinsics(text)
    for text in completion.KNOWLEDGE:
        if not text.endswith(":"):
            parse_knowledge(text)
    parse_intrinsics("scaled:0.7")
    parse_intrinsics("focal:3100+-60")
    parse_intrinsics("focal35:26+-1")
    parse_knowledge("normal:0,0,-1:5+circle:0.5")
