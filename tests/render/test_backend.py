"""Backends: which LLVM and which GPU are accepted, what is refused, and the messages."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from helpers_studies import finished_frames, small_study

from roundel.cli import parser
from roundel.datasets import resume
from roundel.render import backend, cuda, llvm
from roundel.render.run import render_study
from roundel.scenes.errors import BackendError, UsageError


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
    assert llvm._version_of(tmp_path / name) == version


def test_version_is_read_through_a_link(tmp_path: Path) -> None:
    (tmp_path / "libLLVM.so.15.0").touch()
    (tmp_path / "libLLVM.so").symlink_to("libLLVM.so.15.0")
    assert llvm._version_of(tmp_path / "libLLVM.so") == 15


def test_the_environments_own_goes_before_a_newer_one_of_the_system(monkeypatch, tmp_path: Path) -> None:
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    found = [(tmp_path / "libLLVM-19.so", "the environment"), (tmp_path / "libLLVM-22.so", "the system")]
    monkeypatch.setattr(llvm, "_candidates", lambda: found)
    assert llvm.find_llvm().version == 19


def test_llvm_15_is_never_taken(monkeypatch, tmp_path: Path) -> None:
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    found = [(tmp_path / "libLLVM-15.so.1", "the system"), (tmp_path / "libLLVM-14.so.1", "the system")]
    monkeypatch.setattr(llvm, "_candidates", lambda: found)
    with pytest.raises(BackendError, match="no usable LLVM found; install LLVM 16 or newer"):
        llvm.find_llvm()


def test_the_users_own_choice_is_kept_or_refused(monkeypatch, tmp_path: Path) -> None:
    mine = tmp_path / "libLLVM-18.so"
    mine.touch()
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(mine))
    assert llvm.find_llvm() == llvm.Llvm(mine, 18, "DRJIT_LIBLLVM_PATH")
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(tmp_path / "none.so"))
    with pytest.raises(BackendError, match="no such file"):
        llvm.find_llvm()
    (tmp_path / "libLLVM-15.so").touch()
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(tmp_path / "libLLVM-15.so"))
    with pytest.raises(BackendError, match="LLVM 15 does not work"):
        llvm.find_llvm()


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
    environment = {**os.environ, "DRJIT_LIBLLVM_PATH": str(fake)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False, timeout=120)
    assert done.returncode == 4
    assert "Traceback" not in done.stderr
    assert "install LLVM" in done.stderr


def test_a_package_that_is_not_finished_is_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    # pip run by root, Roundel by somebody else: the library is put in place by the first start of Python.
    package = tmp_path / "lib" / "python3.12" / "site-packages" / "karellen_llvm_core-23.1.4.dist-info"
    package.mkdir(parents=True)
    monkeypatch.setattr(llvm, "_candidates", list)
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    with pytest.raises(BackendError, match="start its Python once"):
        llvm.find_llvm()
    (package / "axle.done").touch()
    with pytest.raises(BackendError, match="pip install karellen-llvm-core"):
        llvm.find_llvm()


def test_a_library_that_the_system_lacks_is_one_line_and_exit_code_4(tmp_path: Path) -> None:
    # Dr.Jit on Debian's slim image: an ImportError, and a NameError of Dr.Jit's own while it reports that.
    (tmp_path / "drjit").mkdir()
    (tmp_path / "drjit" / "__init__.py").write_text(
        "try:\n    raise ImportError('libatomic.so.1: cannot open shared object file: No such file or directory')\n"
        "except ImportError:\n    _drjit_ext.__file__\n"
    )
    command = [sys.executable, "-m", "roundel.cli.main", "doctor"]
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False, timeout=120)
    assert done.returncode == 4
    problems = [line for line in done.stdout.splitlines() if line.startswith("problem")]
    assert len(problems) == 1
    assert "libatomic.so.1: cannot open shared object file" in problems[0]
    assert "apt-get install libatomic1" in problems[0]
    assert done.stderr == ""


def test_an_unknown_variant_is_said() -> None:
    with pytest.raises(BackendError, match="no variant 'llvm_nonsense'"):
        backend.start("llvm_nonsense")


class Driver:
    """What `find_gpu` asks of libcuda: a device count, a version of the interface, a name."""

    def __init__(self, devices: int, version: int) -> None:
        self.devices, self.version = devices, version

    def cuInit(self, flags: int) -> int:
        return 0 if self.devices else 100

    def cuDeviceGetCount(self, count) -> int:
        count._obj.value = self.devices
        return 0

    def cuDriverGetVersion(self, version) -> int:
        version._obj.value = self.version
        return 0

    def cuDeviceGet(self, device, index: int) -> int:
        return 0

    def cuDeviceGetName(self, buffer, size: int, device) -> int:
        buffer.value = b"A GPU"
        return 0


def install(monkeypatch, driver: Driver, optix: bool = True) -> None:
    """A driver whose libraries load, with or without its ray tracer."""

    def load(name: str) -> Driver:
        if "nvoptix" in name and not optix:
            raise OSError(f"{name}: cannot open shared object file")
        return driver

    monkeypatch.setattr(cuda.sys, "platform", "linux")
    monkeypatch.setattr(cuda.ctypes, "CDLL", load)
    for variable in ("DRJIT_LIBCUDA_PATH", "DRJIT_LIBOPTIX_PATH"):
        # Set first, so that it is restored to what it was.
        monkeypatch.setenv(variable, "")


def test_a_gpu_is_found_and_chosen(monkeypatch) -> None:
    install(monkeypatch, Driver(1, 12040))
    assert cuda.find_gpu() == cuda.Gpu("A GPU", (12, 4))
    assert backend.choose_backend("auto") == "cuda"
    assert backend.choose_backend("cuda") == "cuda"
    assert backend.choose_backend("llvm") == "llvm"
    # Dr.Jit loads what was found.
    assert os.environ["DRJIT_LIBCUDA_PATH"] == "libcuda.so.1"
    assert os.environ["DRJIT_LIBOPTIX_PATH"] == "libnvoptix.so.1"


@pytest.mark.parametrize(
    ("driver", "optix", "sentence"),
    [
        (Driver(0, 12040), True, "finds no usable GPU .status 100.; check `nvidia-smi`"),
        (Driver(1, 12010), True, "offers CUDA 12.1, 12.2 is needed; install release 535"),
        (Driver(1, 12040), False, "libnvoptix.so.1: .*NVIDIA_DRIVER_CAPABILITIES"),
    ],
)
def test_what_a_gpu_lacks_is_said(monkeypatch, driver: Driver, optix: bool, sentence: str) -> None:
    install(monkeypatch, driver, optix)
    with pytest.raises(BackendError, match=sentence) as caught:
        backend.choose_backend("cuda")
    assert str(caught.value).endswith(cuda.INSTEAD)
    assert "\n" not in str(caught.value)
    assert backend.choose_backend("auto") == "llvm"


def test_an_unknown_backend_is_said() -> None:
    with pytest.raises(UsageError, match="backend 'gpu': use llvm, cuda or auto"):
        backend.choose_backend("gpu")


def test_the_command_offers_all_backends() -> None:
    assert parser.BACKENDS == backend.BACKENDS
    assert parser.BACKENDS[0] == backend.DEFAULT_BACKEND


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_no_driver_is_one_line_and_exit_code_4(tmp_path: Path, jobs: str) -> None:
    study = small_study(tmp_path)
    command = [sys.executable, "-m", "roundel.cli.main", "render", str(study.path), str(tmp_path / "ds")]
    command += ["--jobs", jobs, "--backend", "cuda"]
    environment = {**os.environ, "DRJIT_LIBCUDA_PATH": str(tmp_path / "libcuda.so.1")}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False, timeout=120)
    assert done.returncode == 4
    lines = [line for line in done.stderr.splitlines() if line.startswith("roundel: ")]
    assert len(lines) == 1
    assert "libcuda.so.1: cannot open" in lines[0]
    assert "install the NVIDIA driver" in lines[0]
    assert "Traceback" not in done.stderr
    # Nothing is begun that could not be finished.
    assert not (tmp_path / "ds").exists()


def test_a_dataset_is_continued_with_the_backend_that_began_it(monkeypatch, tmp_path: Path) -> None:
    study = small_study(tmp_path)
    render_study(study, tmp_path / "ds", frames=range(1))
    assert [entry["backend"] for entry in finished_frames(tmp_path / "ds", study).values()] == ["llvm"]
    install(monkeypatch, Driver(1, 12040))
    with pytest.raises(UsageError, match="rendered with --backend llvm; continue with that, or render with --backend"):
        render_study(study, tmp_path / "ds", backend="cuda")
    # `auto` goes on as the dataset was begun, though a GPU is there.
    assert render_study(study, tmp_path / "ds", backend="auto") is not None
    assert {entry["backend"] for entry in finished_frames(tmp_path / "ds", study).values()} == {"llvm"}
    assert resume.backend_to_resume(tmp_path, [{"frame_id": 0}], "auto") == "llvm"
