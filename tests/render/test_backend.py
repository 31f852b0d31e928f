"""Finding LLVM: what is accepted, what is refused, and the messages."""

import subprocess
import sys
from pathlib import Path

import pytest

from roundel.render import backend


@pytest.mark.parametrize(
    ("name", "version"),
    [
        ("libLLVM-14.so.1", 14),
        ("libLLVM.so.23.1", 23),
        ("libLLVM-19.so", 19),
        ("libLLVM.so.19.1", 19),
        ("LLVM-C.dll", 0),
        ("libLLVM.dylib", 0),
        ("libLLVM-C.so.18", 18),
    ],
)
def test_version_is_read_from_the_name(tmp_path: Path, name: str, version: int) -> None:
    assert backend._version_of(tmp_path / name) == version


def test_version_is_read_through_a_link(tmp_path: Path) -> None:
    (tmp_path / "libLLVM.so.15.0").touch()
    (tmp_path / "libLLVM.so").symlink_to("libLLVM.so.15.0")
    assert backend._version_of(tmp_path / "libLLVM.so") == 15


def test_the_environments_own_goes_before_a_newer_one_of_the_system(monkeypatch, tmp_path: Path) -> None:
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    found = [(tmp_path / "libLLVM-19.so", "the environment"), (tmp_path / "libLLVM-22.so", "the system")]
    monkeypatch.setattr(backend, "_candidates", lambda: found)
    assert backend.find_llvm().version == 19


def test_llvm_15_is_never_taken(monkeypatch, tmp_path: Path) -> None:
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    found = [(tmp_path / "libLLVM-15.so.1", "the system"), (tmp_path / "libLLVM-14.so.1", "the system")]
    monkeypatch.setattr(backend, "_candidates", lambda: found)
    with pytest.raises(backend.BackendError, match="no usable LLVM found; install LLVM 16 or newer"):
        backend.find_llvm()


def test_the_users_own_choice_is_kept_or_refused(monkeypatch, tmp_path: Path) -> None:
    mine = tmp_path / "libLLVM-18.so"
    mine.touch()
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(mine))
    assert backend.find_llvm() == backend.Llvm(mine, 18, "DRJIT_LIBLLVM_PATH")
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(tmp_path / "none.so"))
    with pytest.raises(backend.BackendError, match="no such file"):
        backend.find_llvm()
    (tmp_path / "libLLVM-15.so").touch()
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(tmp_path / "libLLVM-15.so"))
    with pytest.raises(backend.BackendError, match="LLVM 15 does not work"):
        backend.find_llvm()


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_a_file_that_is_no_llvm_is_one_line_and_exit_code_4(tmp_path: Path, jobs: str) -> None:
    fake = tmp_path / "libLLVM-18.so"
    fake.write_bytes(b"not a library")
    (tmp_path / "study.yaml").write_text(
        "schema: 1\nname: x\ncamera: {width_px: 64, height_px: 64, focal_px: 100}\n"
        "marker: {kind: disc, diameter_m: 0.1}\npose: {distance_D: 5}\nframes: 1\n"
    )
    command = [sys.executable, "-m", "roundel.cli.main", "render", str(tmp_path / "study.yaml"), str(tmp_path / "ds")]
    command += ["--jobs", jobs]
    environment = {**__import__("os").environ, "DRJIT_LIBLLVM_PATH": str(fake)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False, timeout=120)
    assert done.returncode == 4
    assert "Traceback" not in done.stderr
    assert "install LLVM" in done.stderr


def test_an_unknown_variant_is_said() -> None:
    with pytest.raises(backend.BackendError, match="no variant 'llvm_nonsense'"):
        backend.start("llvm_nonsense")
