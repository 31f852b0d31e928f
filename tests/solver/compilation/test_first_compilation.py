"""The first compilation: one line on a terminal, and no failure of other processes reaches the user."""

from __future__ import annotations

import io
import logging
import subprocess
import sys

import pytest

from roundel.solver.compilation import first_compilation
from roundel.solver.compilation.first_compilation import NOTICE, compiled_elsewhere, start_compilation


class Terminal(io.StringIO):
    """What a person sees."""

    def isatty(self) -> bool:
        return True


@pytest.fixture(autouse=True)
def state(monkeypatch):
    # As in a process that has compiled nothing yet.
    fresh = first_compilation._State()
    monkeypatch.setattr(first_compilation, "_state", fresh)
    return fresh


def test_a_terminal_shows_one_line(monkeypatch):
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    start_compilation(much=False)
    start_compilation(much=False)
    assert terminal.getvalue() == NOTICE + "\n"


def test_elsewhere_it_is_a_log_record(monkeypatch, caplog):
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    with caplog.at_level(logging.INFO, "roundel"):
        start_compilation(much=False)
    assert [record.getMessage() for record in caplog.records] == [NOTICE]
    assert not stream.getvalue()


def test_an_application_is_never_started(monkeypatch, state):
    monkeypatch.setattr(sys, "executable", "/usr/bin/blender")
    monkeypatch.setattr(subprocess, "Popen", lambda *_, **__: pytest.fail("started"))
    start_compilation(much=True)
    assert not state.others


def test_a_process_that_does_not_start_is_no_failure(monkeypatch, state):
    def refuse(*_, **__):
        raise OSError("no more processes")

    monkeypatch.setattr(subprocess, "Popen", refuse)
    start_compilation(much=True)
    assert not state.others
    assert not compiled_elsewhere("roundel.solver.kernels.trace_contour")


def test_waits_only_for_kernels_of_others_and_only_while_they_run(monkeypatch, state):
    monkeypatch.setattr(first_compilation, "_PROGRAM", "import sys; sys.stdin.read(); import time; time.sleep(60)")
    start_compilation(much=True)
    try:
        assert len(state.others) >= 2
        assert compiled_elsewhere("roundel.solver.kernels.trace_contour")
        assert not compiled_elsewhere("roundel.solver.detect.candidates")
    finally:
        for other in state.others:
            other.kill()
            other.wait()
    assert not compiled_elsewhere("roundel.solver.kernels.trace_contour")


def test_a_failing_process_is_no_failure(monkeypatch, state):
    monkeypatch.setattr(first_compilation, "_PROGRAM", "import roundel_that_is_not_installed")
    start_compilation(much=True)
    assert {other.wait(60) for other in state.others} == {1}
    assert not compiled_elsewhere("roundel.solver.kernels.trace_contour")
