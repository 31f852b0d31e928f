"""The same frames on the processor and on a GPU: do the images agree, and how many frames a second does each trace?

    python benchmarks/render/gpu.py [--quick] [--control] [--json FILE]

Both backends trace each frame with random numbers of their own, so that their images differ by their Monte-Carlo noise
alone, whose variance is rendered with them. `--control` has the processor take the GPU's place: what the comparison
says where nothing differs. Exits with status 0 if all frames agree, 1 if one does not, 3 if nothing was measured
because there is no usable GPU.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import table
from numpy.typing import NDArray
from scipy.stats import norm

from roundel.render.backend import environment, start, variant_of
from roundel.render.cuda import INSTEAD, find_gpu
from roundel.render.radiance import Radiance, render_radiance
from roundel.render.shard_work import render_frames
from roundel.scenes.errors import BackendError
from roundel.scenes.study.study import Study, load_study
from roundel.scenes.world.frame import Frame, frame_of, group_ranges

STUDY = Path(__file__).resolve().parent / "gpu.yaml"
AGREE, DIFFER, NOT_MEASURED = 0, 1, 3

# Sums over 32 x 32 pixels are close enough to Gaussian for a z-test: single pixels of a world have heavy tails.
BLOCK_PX = 32
# Probability that a frame of equal images is called different, over all its blocks and its mean.
FALSE_ALARM = 1e-3
# Where nothing is random (a plain sheet under a constant sky), float32 on two machines agrees to this share of white.
ROUNDING = 1e-5
_OTHER_RAYS = 0x2545F491


def traced(frame: Frame, backend: str) -> Radiance:
    return render_radiance(start(variant_of(frame, backend)), frame)


def blocks(image: NDArray[Any]) -> NDArray[np.float64]:
    """Sums over blocks; what is left at the right and lower border counts in no block."""
    height, width = (side - side % BLOCK_PX for side in image.shape)
    whole = image[:height, :width].astype(np.float64)
    return whole.reshape(height // BLOCK_PX, BLOCK_PX, width // BLOCK_PX, BLOCK_PX).sum(axis=(1, 3))


def compare(a: Radiance, b: Radiance) -> dict[str, Any]:
    """A z-test of two images of one frame with independent rays, in blocks and over the whole frame.

    The limit is that of the normal distribution with Sidak's correction for the number of tests.
    """
    white = float(np.quantile(a.mean, 0.98))
    difference = b.mean.astype(np.float64) - a.mean
    variance = b.variance.astype(np.float64) + a.variance
    floor = ROUNDING * white
    summed, noise = blocks(difference), blocks(variance)
    # Rounding is common to the pixels of a block: its deviations add up, they do not average.
    z = summed / np.sqrt(noise + (BLOCK_PX**2 * floor) ** 2)
    mean_se = np.sqrt(variance.sum()) / variance.size
    mean_z = difference.mean() / np.hypot(mean_se, floor)
    limit = float(norm.isf((1 - (1 - FALSE_ALARM) ** (1 / (z.size + 1))) / 2))
    worst = float(np.abs(z).max())
    return {
        "mean_offset": float(difference.mean() / white),
        "mean_offset_se": float(mean_se / white),
        "noise": float(np.sqrt(variance.mean()) / white),
        "block_z_rms": float(np.sqrt(np.mean(z**2))),
        "block_z_worst": worst,
        "z_limit": limit,
        "agree": bool(worst < limit and abs(mean_z) < limit),
    }


def seconds_a_frame(frames: list[Frame], backend: str) -> dict[str, float]:
    """Mean seconds of a frame's radiance, and of a labelled frame on disk; kernels and caches are warm."""
    began = time.perf_counter()
    for frame in frames:
        traced(frame, backend)
    radiance = time.perf_counter() - began

    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        for _ in render_frames(iter(frames), Path(folder), backend):
            pass
        labelled = time.perf_counter() - began
    return {"radiance_s": radiance / len(frames), "labelled_s": labelled / len(frames)}


def measured(study: Study, group: str, ids: range, other: str) -> dict[str, Any]:
    """A group on both backends: `other` is the one that is compared with the processor."""
    frames = [frame_of(study, i) for i in ids]
    pairs = []
    for frame in frames:
        with_own_rays = replace(frame, ray_seed=frame.ray_seed ^ _OTHER_RAYS)
        pairs.append(compare(traced(frame, "llvm"), traced(with_own_rays, other)))
    once, again = (traced(frames[0], other).mean for _ in range(2))
    return {
        "group": group,
        "pairs": pairs,
        "repeats": bool(np.array_equal(once, again)),
        "llvm": seconds_a_frame(frames, "llvm"),
        other: seconds_a_frame(frames, other),
    }


def lines(results: list[dict[str, Any]], other: str) -> Iterator[str]:
    yield (
        f"| frames | agree | mean offset, 1e-6 of white | z of blocks: RMS, worst (limit) | llvm, frames/s | {other}, "
        "frames/s | times faster: radiance, labelled frame | same bytes twice |"
    )
    yield "|---|---|---|---|---:|---:|---|---|"
    for found in results:
        pairs, a, b = found["pairs"], found["llvm"], found[other]
        offset = np.mean([p["mean_offset"] for p in pairs]) * 1e6
        error = np.sqrt(np.sum([p["mean_offset_se"] ** 2 for p in pairs])) / len(pairs) * 1e6
        rms = np.sqrt(np.mean([p["block_z_rms"] ** 2 for p in pairs]))
        worst = max(p["block_z_worst"] for p in pairs)
        yield (
            f"| {found['group']} | {sum(p['agree'] for p in pairs)} of {len(pairs)} | {offset:+.1f} +- {error:.1f} | "
            f"{rms:.2f}, {worst:.1f} ({pairs[0]['z_limit']:.1f}) | {1 / a['radiance_s']:.2f} | "
            f"{1 / b['radiance_s']:.2f} | {a['radiance_s'] / b['radiance_s']:.1f}, "
            f"{a['labelled_s'] / b['labelled_s']:.1f} | {'yes' if found['repeats'] else 'no'} |"
        )


def main() -> int:
    parser = argparse.ArgumentParser(description="Compare the backends llvm and cuda.")
    parser.add_argument("--quick", action="store_true", help="one frame of each group")
    parser.add_argument("--control", action="store_true", help="compare llvm with llvm, with other rays; needs no GPU")
    parser.add_argument("--json", type=Path, help="also write the figures here")
    asked = parser.parse_args()
    other = "llvm" if asked.control else "cuda"
    if not asked.control:
        try:
            find_gpu()
        except BackendError as error:
            print(f"gpu: not measured: {str(error).removesuffix(f', {INSTEAD}')}", file=sys.stderr)
            return NOT_MEASURED
    study = load_study(STUDY)
    results = []
    for group, ids in group_ranges(study).items():
        print(f"{group} ...", file=sys.stderr)
        results.append(measured(study, group, ids[:1] if asked.quick else ids, other))
    machine = table.machine() | {"backend": environment(other)}
    print("\n".join(lines(results, other)))
    print("\n" + ", ".join(f"{key} {value}" for key, value in machine.items()))
    if asked.json:
        asked.json.write_text(json.dumps({"machine": machine, "groups": results}, indent=1) + "\n", encoding="utf-8")
    agree = all(pair["agree"] for found in results for pair in found["pairs"])
    return AGREE if agree else DIFFER


if __name__ == "__main__":
    sys.exit(main())
