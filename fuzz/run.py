"""All fuzzers, one after another, in FUZZ_SECONDS. Ends with 1 at the first find.

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
    parser = argparse.ArgumentParser(description="Fuzz the entrances to images and photographs.")
    parser.add_argument("--seconds", type=float, default=300.0, help="in all")
    parser.add_argument("--seed", type=int, default=int(time.time()), help="another each time, unless it is said")
    asked = parser.parse_args()
    has_atheris = importlib.util.find_spec("atheris") is not None
    if not has_atheris:
        print("photos: without atheris, so without its eyes; `make fuzz-env` installs it", flush=True)
    shares = [("images.py", 0.5, []), ("photos.py", 0.5, [] if has_atheris else ["--blind"])]
    print(f"seed {asked.seed}", flush=True)
    for script, share, options in shares:
        command = [sys.executable, str(HERE / script), "--seconds", str(share * asked.seconds)]
        command += ["--seed", str(asked.seed % 2**31), *options]
        done = subprocess.run(command, check=False, cwd=HERE.parent, env={**os.environ, "OMP_NUM_THREADS": "1"})
        if done.returncode:
            print(f"{script}: a find, or it could not run (exit code {done.returncode}); see above", file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
