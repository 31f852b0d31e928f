"""Run all fuzzers one after another, within FUZZ_SECONDS; exits with status 1 at the first failure.

python fuzz/run.py --seconds 300 [--seed N]
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import subprocess
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent


def main() -> int:
    parser = argparse.ArgumentParser(description="Fuzz the reading of images, photographs and datasets.")
    parser.add_argument("--seconds", type=float, default=300.0, help="total time")
    parser.add_argument("--seed", type=int, default=int(time.time()), help="seed; default: the current time")
    asked = parser.parse_args()
    has_atheris = importlib.util.find_spec("atheris") is not None
    if not has_atheris:
        print("photos: without atheris, so not coverage-guided; `make fuzz-env` installs it", flush=True)
    shares = [
        ("images.py", 0.4, []),
        ("photos.py", 0.3, [] if has_atheris else ["--blind"]),
        ("store.py", 0.3, []),
    ]
    print(f"seed {asked.seed}", flush=True)
    for script, share, options in shares:
        command = [sys.executable, str(HERE / script), "--seconds", str(share * asked.seconds)]
        command += ["--seed", str(asked.seed % 2**31), *options]
        done = subprocess.run(command, check=False, cwd=HERE.parent, env={**os.environ, "OMP_NUM_THREADS": "1"})
        if done.returncode:
            print(f"{script}: failed, or could not run (exit status {done.returncode}); see above", file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
