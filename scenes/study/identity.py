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

# How a study's numbers become frames: the order of grids, the low-discrepancy sequence, its scrambling, the seeds, how
# a pose is built, and the defaults of the schema. Raise it when any study draws other frames than before; then, and
# only then, make tests/golden anew (tests/helpers/make_golden.py). It is part of every dataset_id.
SAMPLING_VERSION = 1

# Digits that are compared: far above the last bits in which two builds of a mathematics library differ, and far below
# anything that moves a pixel (1e-9 m at 1 m).
_DIGITS = 9


def _sha256(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def study_digest(study: Study) -> str:
    """The dataset_id: sha256 of all that decides a study's frames.

    Keys that have their default value are left out, so that a new key does not change the id of a study that does not
    use it. How frames are solved and scored is left out, too.
    """
    groups = {
        name: group.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
        for name, group in study.groups.items()
    }
    # A list of pairs: groups follow one another in the order of the study, and frame ids with them.
    return _sha256(
        {"schema": SCHEMA_VERSION, "sampling": SAMPLING_VERSION, "seed": study.seed, "groups": list(groups.items())}
    )


def _rounded(values: Any) -> list[float]:
    # Adding zero turns -0.0 into 0.0.
    return [float(v) + 0.0 for v in np.round(np.asarray(values, dtype=np.float64).ravel(), _DIGITS)]


def frame_numbers(frame: Frame) -> dict[str, Any]:
    """The numbers a frame is made from: what was drawn, the level of the sweep, the seeds, the camera and the pose.

    Returns
    -------
    dict
        `drawn`: {dotted key: value}, to nine significant digits; `level`; `seeds`: noise, rays, sensor, sheet;
        `K`: 9 values, px; `camera_from_sheet`: 16 values, lengths in m, both to nine decimals.
        In a world also `up`, and `world`: a checksum of where everything stands.
    """
    around = frame.surroundings
    world = {} if around is None else {"up": _rounded(around.up), "world": _sha256(_placed(around))}
    return {
        **world,
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
    bodies = [[b.shape, b.material.kind, *np.round(b.camera_from_body[:3], 6).ravel().tolist()] for b in around.bodies]
    panels = [np.round(p.camera_from_panel[:3], 6).ravel().tolist() for p in around.panels]
    return [around.support, bodies, panels]


def frame_digest(frame: Frame) -> str:
    """sha256 of `frame_numbers`: what a frame's journal line records, and what `finish` and `verify` compare."""
    return _sha256(frame_numbers(frame))
