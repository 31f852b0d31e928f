"""Identity of studies and frames as checksums."""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING, Any

import numpy as np

from roundel.scenes.study.schema import SCHEMA_VERSION

if TYPE_CHECKING:
    from roundel.scenes.study.study import Study
    from roundel.scenes.surroundings.bodies import Surroundings
    from roundel.scenes.world.frame import Frame

# Version of the sampling: the order of grids, the low-discrepancy sequence, its scrambling, the seeds, the construction
# of poses, and the defaults of the schema. Increment it when any study draws different frames; then, and only then,
# regenerate tests/golden (tests/helpers/make_golden.py). It is part of every dataset_id.
SAMPLING_VERSION = 1

# Digits that are compared: far coarser than the last bits in which two builds of a mathematics library differ, and far
# finer than anything that moves a pixel (1e-9 m at 1 m).
_DIGITS = 9


def _sha256(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def study_digest(study: Study) -> str:
    """The dataset_id: sha256 of everything that determines a study's frames.

    Keys with their default value are left out, so that a new key does not change the id of a study that does not use
    it. Settings of the solver and the validator are left out, too.
    """
    groups = {
        name: group.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
        for name, group in study.groups.items()
    }
    # A list of pairs, because the order of groups in the study determines the frame ids.
    return _sha256(
        {"schema": SCHEMA_VERSION, "sampling": SAMPLING_VERSION, "seed": study.seed, "groups": list(groups.items())}
    )


def _rounded(values: Any) -> list[float]:
    # Adding zero converts -0.0 to 0.0.
    return [float(v) + 0.0 for v in np.round(np.asarray(values, dtype=np.float64).ravel(), _DIGITS)]


def frame_numbers(frame: Frame) -> dict[str, Any]:
    """The values that define a frame: drawn values, level of the sweep, seeds, camera and pose.

    Returns
    -------
    dict
        `drawn`: {dotted key: value}, to nine significant digits; `level`; `seeds`: noise, rays, sensor, sheet;
        `K`: 9 values, px; `camera_from_sheet`: 16 values, lengths in m, both to nine decimals.
        In a world also `up`, and `world`: a checksum of where everything stands; with further sheets `others`: kind,
        border and pose of each.
    """
    others = [
        [o.marker.kind, _rounded([*o.sheet.low_m, *o.sheet.high_m]), _rounded(o.camera_from_sheet)]
        for o in frame.others
    ]
    around = frame.surroundings
    world = {} if around is None else {"up": _rounded(around.up), "world": _sha256(_placed(around))}
    return {
        **world,
        **({"others": others} if others else {}),
        "group": frame.group,
        "index": frame.index,
        "level": frame.level,
        "drawn": {key: float(f"{value:.{_DIGITS}g}") + 0.0 for key, value in frame.drawn.items()},
        "seeds": [frame.noise_seed, frame.ray_seed, frame.sensor_seed, frame.sheet_seed],
        "K": _rounded(frame.camera.K),
        "camera_from_sheet": _rounded(frame.camera_from_sheet),
    }


def _placed(around: Surroundings) -> list[Any]:
    """Where everything of a world stands; places to a micrometre."""

    def place(pose: Any) -> list[float]:
        # Adding zero converts -0.0, which depends on the machine, to 0.0.
        return [float(v) + 0.0 for v in np.round(pose[:3], 6).ravel()]

    bodies = [[b.shape, b.material.kind, *place(b.camera_from_body)] for b in around.bodies]
    panels = [place(p.camera_from_panel) for p in around.panels]
    found: list[Any] = [around.support, bodies, panels]
    if around.scene is not None:
        found += [around.scene.digest, around.scene.unit_m, place(around.scene.camera_from_scene)]
    if around.picture is not None:
        hung = around.picture
        found += [hung.digest, hung.index, round(hung.width_m, 6), place(hung.camera_from_picture)]
    return found


def frame_digest(frame: Frame) -> str:
    """sha256 of `frame_numbers`, recorded in a frame's journal line and compared by `finish` and `verify`."""
    return _sha256(frame_numbers(frame))
