"""The tracker on rendered sequences of 300 frames with two markers: the right branch, identities, frames a second.

    python benchmarks/solver/tracking.py [--folder out/tracking] [--motion carried] [--frames 300] [--out FILE]

Each frame is rendered by Roundel with the poses of two smooth trajectories; a sequence is kept in FOLDER and made once.
The motions differ in what they tell about the branch:

- carried: markers that are moved by hand and turned a little; they cross, one in front of the other.
- shaken camera: markers at rest, seen by a camera that moves and turns.
- swinging: markers that turn through the line of sight, faster than they move.
- turning: markers that turn in place; the mirrored candidate turns as smoothly.
- still: nothing moves.

"Right" and "wrong" are fractions of the markers' frames after the first second in which the tracker chose the candidate
nearer to the truth, or the other; in the rest it chose none. Speed is that of one core, by processor time: frames a
second of `Tracker.update` after the first frame, which loads the compiled kernels.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

import roundel
from roundel.render.backend import DEFAULT_BACKEND, start, variant_of
from roundel.render.radiance import render_radiance
from roundel.render.sensor.develop import develop
from roundel.scenes.camera.model import Camera, project
from roundel.scenes.geometry.pose import camera_from_marker_of
from roundel.scenes.study.study import load_study
from roundel.scenes.world.frame import Frame, frame_of

Array = NDArray[np.float64]

STUDY = Path(__file__).with_name("tracking.yaml")
RATE_HZ = 30.0
DIAMETER_M = 0.08
NEAR_PX = 4.0  # of a true centre, for an estimate to be of that marker

# A motion gives the pose (4, 4) of marker k at a time.
Motion = Callable[[int, float], Array]


def facing(tilt_deg: float, azimuth_deg: float) -> Array:
    """The normal of a marker that is tilted from facing along the optical axis."""
    tilt, azimuth = np.radians(tilt_deg), np.radians(azimuth_deg)
    return np.array([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), -np.cos(tilt)])


def carried(k: int, t: float) -> Array:
    if k == 0:
        centre = [0.19 * np.sin(1.3 * t), 0.08 * np.cos(1.0 * t), 0.62 + 0.06 * np.sin(0.7 * t)]
        return camera_from_marker_of(facing(35 + 8 * np.sin(0.9 * t), 40 + 15 * np.sin(0.7 * t)), centre)
    centre = [-0.24 * np.sin(1.1 * t + 0.2), -0.05 * np.cos(0.9 * t), 0.95 + 0.06 * np.sin(0.5 * t)]
    return camera_from_marker_of(facing(45 + 6 * np.sin(0.7 * t), 200 + 12 * np.sin(0.8 * t)), centre)


def shaken_camera(k: int, t: float) -> Array:
    at_rest = still(k, 0.0)
    centre = [0.14 * np.sin(1.2 * t), 0.07 * np.sin(0.9 * t + 0.5), 0.08 * np.sin(0.6 * t)]
    turn, _ = cv2.Rodrigues(np.radians([4 * np.sin(1.7 * t), -8 * np.sin(1.2 * t + 0.2), 3 * np.sin(1.1 * t)]))
    world_from_camera = np.eye(4)
    world_from_camera[:3, :3], world_from_camera[:3, 3] = turn, centre
    return np.asarray(np.linalg.inv(world_from_camera) @ at_rest)


def swinging(k: int, t: float) -> Array:
    side = 1.0 if k == 0 else -1.0
    centre = [side * (0.14 + 0.05 * np.sin(0.8 * t)), 0.05 * np.sin(0.6 * t + k), 0.8]
    return camera_from_marker_of(facing(40 * np.cos(0.9 * t + k), 30 + 90 * k), centre)


def turning(k: int, t: float) -> Array:
    return camera_from_marker_of(facing(35 + 10 * k, 40 + 160 * k + 40 * t), [-0.14 + 0.28 * k, 0.03, 0.8])


def still(k: int, t: float) -> Array:
    return camera_from_marker_of(facing(35 + 10 * k, 40 + 160 * k), [-0.14 + 0.28 * k, 0.03, 0.8])


MOTIONS: dict[str, Motion] = {
    "carried": carried,
    "shaken camera": shaken_camera,
    "swinging": swinging,
    "turning": turning,
    "still": still,
}


def frames_of_motion(motion: Motion, count: int) -> list[Frame]:
    """The study's frame with other poses, and other noise, at each time."""
    base = frame_of(load_study(STUDY), 0)
    out = []
    for i in range(count):
        first, second = (motion(k, i / RATE_HZ) for k in (0, 1))
        others = (replace(base.others[0], camera_from_sheet=second),)
        seeds = {"noise_seed": base.noise_seed + i, "ray_seed": base.ray_seed + i}
        out.append(replace(base, frame_id=i, camera_from_sheet=first, others=others, **seeds))
    return out


@dataclass(frozen=True)
class Sequence:
    """Images (N, H, W), and the true poses (N, 2, 4, 4) of both markers."""

    images: NDArray[np.uint8]
    poses: Array
    camera: Camera


def sequence(name: str, folder: Path, count: int) -> Sequence:
    """A rendered sequence; frames that exist are kept."""
    frames = frames_of_motion(MOTIONS[name], count)
    mi = start(variant_of(frames[0], DEFAULT_BACKEND))
    images = []
    for frame in frames:
        file = folder / name.replace(" ", "_") / f"{frame.frame_id:04d}.png"
        if not file.is_file():
            file.parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(file), develop(frame, render_radiance(mi, frame).mean).image)
        images.append(cv2.imread(str(file), cv2.IMREAD_UNCHANGED))
    poses = np.stack([[f.camera_from_sheet, f.others[0].camera_from_sheet] for f in frames])
    return Sequence(np.stack(images), poses, frames[0].camera)


@dataclass
class Tally:
    """What the tracker answered after the first second."""

    measured: int = 0
    right: int = 0
    wrong: int = 0
    total: int = 0
    identities: int = 0
    swaps: int = 0
    strays: int = 0
    rate_hz: float = 0.0
    normal_deg: float = 0.0


def track(seen: Sequence) -> Tally:
    """Run the tracker over a sequence and compare it with the truth."""
    tracker = roundel.Tracker(DIAMETER_M, seen.camera)
    tally, owner, errors, seconds = Tally(), {}, [], 0.0
    for i, image in enumerate(seen.images):
        began = time.process_time()
        markers = tracker.update(image, i / RATE_HZ)
        seconds += time.process_time() - began if i else 0.0
        centres = project(seen.camera, seen.poses[i, :, :3, 3])
        for marker in markers:
            estimate = marker.estimate
            if estimate is None or estimate.normal is None:
                continue
            apart = np.linalg.norm(project(seen.camera, estimate.centre_m[0]) - centres, axis=1)
            k = int(np.argmin(apart))
            if apart[k] > NEAR_PX:
                tally.strays += 1
                continue
            tally.swaps += owner.setdefault(marker.identity, k) != k
            if i < RATE_HZ:
                continue
            angle = roundel.normal_error_deg(estimate.normal, seen.poses[i, k, :3, 2])
            tally.measured += 1
            tally.right += estimate.chosen == int(np.argmin(angle))
            tally.wrong += estimate.chosen == int(np.argmax(angle))
            errors.append(float(np.min(angle)))
    tally.total = 2 * max(len(seen.images) - round(RATE_HZ), 0)
    tally.identities, tally.rate_hz = len(owner), (len(seen.images) - 1) / seconds
    tally.normal_deg = float(np.sqrt(np.mean(np.square(errors))))
    return tally


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=Path("out/tracking"))
    parser.add_argument("--motion", action="append", choices=list(MOTIONS))
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    lines = [
        "| motion | measured | right | wrong | none | identities | swaps | strays | normal, RMS deg | frames/s |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name in arguments.motion or MOTIONS:
        t = track(sequence(name, arguments.folder, arguments.frames))
        right, wrong = t.right / max(t.measured, 1), t.wrong / max(t.measured, 1)
        lines.append(
            f"| {name} | {t.measured} of {t.total} | {100 * right:.1f} % | {100 * wrong:.1f} % | "
            f"{100 * (1 - right - wrong):.1f} % | {t.identities} | {t.swaps} | {t.strays} | {t.normal_deg:.2f} | "
            f"{t.rate_hz:.0f} |"
        )
        print(lines[-1], file=sys.stderr)
    text = "\n".join(lines) + "\n"
    print(text, end="")
    if arguments.out:
        arguments.out.write_text(text)


if __name__ == "__main__":
    main()
