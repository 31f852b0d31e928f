"""A runner of CI services on this machine: it takes the steps of a workflow as they are written, and runs them.

The runner has an empty home, a new virtual environment in place of the service's Python, and of this machine's
variables only those by which pip reaches its index. `uses:` steps of GitHub and the `cache:` of GitLab cannot be run:
those that Roundel's files use are carried out here as their documentation says, and any other is an error.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

_PIP = re.compile(r"PIP_\w+|SSL_CERT_\w+|REQUESTS_CA_BUNDLE|\w+_proxy", re.IGNORECASE)


@dataclass
class Job:
    """What became of a job: its output, and the step or command at which it failed, with its exit status."""

    output: str = ""
    failed: str | None = None
    status: int = 0
    skipped: list[str] = field(default_factory=list)


class Runner:
    """A folder with a checkout, a home, an environment, and what the service keeps between jobs."""

    def __init__(self, folder: Path) -> None:
        self.checkout, self.home, self.kept = folder / "checkout", folder / "home", folder / "kept"
        self.bin = folder / "python" / "bin"
        for made in (self.checkout, self.home, self.kept):
            made.mkdir(parents=True)
        subprocess.run([sys.executable, "-m", "venv", str(folder / "python")], check=True)
        self.environment = {name: value for name, value in os.environ.items() if _PIP.fullmatch(name)}
        # Downloads are shared with this machine's, or each runner would fetch 500 MB.
        self.environment.setdefault("PIP_CACHE_DIR", str(Path.home() / ".cache" / "pip"))
        self.environment["PIP_NO_COMPILE"] = "1"  # half a minute of each installation
        self.environment |= {
            "HOME": str(self.home),
            "PATH": f"{self.bin}:/usr/local/bin:/usr/bin:/bin",
            "LANG": "C.UTF-8",
            "CI": "true",
            "RUNNER_TEMP": str(folder / "temporary"),
        }
        (folder / "temporary").mkdir()

    @property
    def site_packages(self) -> Path:
        """Where pip installs."""
        (found,) = (self.bin.parent / "lib").glob("python*/site-packages")
        return found

    def bash(self, script: str, variables: Mapping[str, str], *options: str) -> subprocess.CompletedProcess[str]:
        """A script in the checkout; stdout and stderr together."""
        file = self.home.parent / "step.sh"
        file.write_text(script, encoding="utf-8")
        return subprocess.run(
            ["bash", *options, str(file)],
            cwd=self.checkout,
            env={**self.environment, **variables},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
            timeout=1800,
        )

    def restore(self, key: str, path: str) -> bool:
        """Copy what was kept under a key to its place; False if there is nothing."""
        kept = self.kept / key
        if kept.is_dir():
            shutil.copytree(kept, self.checkout / path, dirs_exist_ok=True)  # with the times of the files
        return kept.is_dir()

    def keep(self, key: str, path: str) -> None:
        """Keep a folder under a key."""
        shutil.rmtree(self.kept / key, ignore_errors=True)
        if (self.checkout / path).is_dir():
            shutil.copytree(self.checkout / path, self.kept / key)


def github(runner: Runner, text: str, job: str, given: Mapping[str, str]) -> Job:
    """Run a job of a GitHub workflow; `given` are the variables that the service sets, or that are the user's."""
    document = yaml.safe_load(text)
    variables = {**document.get("env", {}), **given}
    outputs: dict[str, str] = {}
    done = Job()
    files = {name: runner.home.parent / name for name in ("GITHUB_OUTPUT", "GITHUB_STEP_SUMMARY")}
    for file in files.values():
        file.write_text("", encoding="utf-8")
    variables |= {name: str(file) for name, file in files.items()}
    for step in document["jobs"][job]["steps"]:
        name = step.get("name") or step.get("run") or step["uses"]
        if not _runs(step.get("if"), outputs, failed=done.failed is not None):
            done.skipped.append(name)
        elif "run" in step:
            ended = runner.bash(step["run"], {**variables, **step.get("env", {})}, "-e")
            done.output += f"## {name}\n{ended.stdout}"
            if ended.returncode:
                done.failed, done.status = name, ended.returncode
            written = files["GITHUB_OUTPUT"].read_text(encoding="utf-8").splitlines()
            outputs |= {f"steps.{step.get('id')}.outputs.{k}": v for k, v in (line.split("=", 1) for line in written)}
            files["GITHUB_OUTPUT"].write_text("", encoding="utf-8")
        else:
            hit = _use(runner, step, outputs)
            outputs[f"steps.{step.get('id')}.outputs.cache-hit"] = "true" if hit else ""
    return done


def _runs(condition: str | None, outputs: Mapping[str, str], failed: bool) -> bool:
    if condition is None:
        return not failed
    if condition == "always()":
        return True
    unequal = re.fullmatch(r"(steps\.\w+\.outputs\.[\w-]+) != '(\w+)'", condition)
    assert unequal, f"the runner knows no condition {condition}"
    return not failed and outputs.get(unequal[1], "") != unequal[2]


def _use(runner: Runner, step: Mapping[str, Any], outputs: Mapping[str, str]) -> bool:
    """Carry out a `uses:` step; True if a cache was found."""
    action = step["uses"].split("@")[0]
    given = {
        name: re.sub(r"\$\{\{ *([\w.-]+) *\}\}", lambda match: outputs[match[1]], value)
        for name, value in step.get("with", {}).items()
    }
    if action == "actions/cache/restore":
        return runner.restore(given["key"], given["path"])
    if action == "actions/cache/save":
        runner.keep(given["key"], given["path"])
    elif action == "actions/upload-artifact":
        for path in given["path"].splitlines():
            assert (runner.checkout / path).exists(), f"no {path} to upload"
    else:  # the checkout and the Python are there
        assert action in ("actions/checkout", "actions/setup-python"), f"the runner knows no {action}"
    return False


def gitlab(runner: Runner, text: str, given: Mapping[str, str]) -> Job:
    """Run the one job of a GitLab file: its script in one shell, each command printed before it is run."""
    (job,) = yaml.safe_load(text).values()
    cache = job["cache"]
    for path in cache["paths"]:
        runner.restore(cache["key"], path)
    lines = [line for command in job["script"] for line in (f"echo {shlex.quote(f'$ {command}')}", command)]
    ended = runner.bash("\n".join(["set -eo pipefail", *lines]), {**job["variables"], **given})
    done = Job(ended.stdout, status=ended.returncode)
    if ended.returncode:
        done.failed = next(line[2:] for line in reversed(ended.stdout.splitlines()) if line.startswith("$ "))
    if not ended.returncode or cache["when"] == "always":
        for path in cache["paths"]:
            runner.keep(cache["key"], path)
    for path in [*job["artifacts"]["paths"], *job["artifacts"]["reports"].values()]:
        assert (runner.checkout / path).exists(), f"no {path} to upload"
    return done
