"""The circles of a dataset as the solver observes them, with their true poses, for `ambiguity.py`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.datasets.dataset import Dataset
from roundel.datasets.layout.images import open_images
from roundel.scenes.geometry.pose import angle_deg
from roundel.solver.ambiguity.observation import Observation, Verdict
from roundel.solver.estimates import Estimate
from roundel.solver.intrinsics.specification import parse_intrinsics, uncertain_camera_for
from roundel.solver.methods.registry import load_methods
from roundel.solver.methods.roundel_fits import DEFAULT_METHOD
from roundel.solver.methods.solve_image import SolverInput, solve_image
from roundel.solver.photometry.frame_levels import frame_levels

Array = NDArray[np.float64]

INTRINSICS = ("true", "default")
NEAR_PX = 3.0  # of the true ellipse's centre, for a detection to be of that marker
COPLANAR = ("two_discs", "dot_ring")  # groups whose circles are solved together


@dataclass(frozen=True, eq=False)
class Circle:
    """One circle of a frame under one kind of intrinsics, or a missed one.

    Attributes
    ----------
    frame_id : int
    group : str
    intrinsics : str
    camera_from_marker : (4, 4) array
        The true pose.
    radius_m : float
    distance_D, line_of_sight_tilt_deg, offset_px : float
        True distance in diameters, tilt from the line of sight, and distance of the centre's image from the principal
        point.
    seen : Observation or None
        What priors and cues get; None if the circle was not found.
    estimate : Estimate or None
        With `coplanar` declared if its group is one of `COPLANAR`.
    """

    frame_id: int
    group: str
    intrinsics: str
    camera_from_marker: Array
    radius_m: float
    distance_D: float
    line_of_sight_tilt_deg: float
    offset_px: float
    seen: Observation | None
    estimate: Estimate | None

    @property
    def normal(self) -> Array:
        """The true normal (3,)."""
        return np.asarray(self.camera_from_marker[:3, 2])

    @property
    def true_candidate(self) -> int:
        """The index of the candidate whose normal is nearer to the true one."""
        assert self.seen is not None
        return int(np.argmin(angle_deg(self.seen.normal, self.normal)))


class _Recorder:
    """A piece of knowledge that decides nothing and keeps what it was shown."""

    def __init__(self) -> None:
        self.shown: list[Observation] = []

    def problem(self) -> str:
        return ""

    def verdict(self, observation: Observation) -> Verdict:
        self.shown.append(observation)
        return Verdict(0.0, "")


def circles(dataset: Dataset) -> Iterator[Circle]:
    """Every circle of a dataset under every kind of intrinsics, frame by frame."""
    images = open_images(dataset.path)
    truth: dict[int, list[dict[str, Any]]] = {}
    for row in dataset.truth.to_pylist():
        truth.setdefault(row["frame_id"], []).append(row)
    methods = load_methods([DEFAULT_METHOD])
    specs = {label: parse_intrinsics(label) for label in INTRINSICS}
    for i, frame_id in enumerate(images.frame_ids):
        group, camera = images.groups[i], images.camera(i)
        size = camera.width_px, camera.height_px
        levels = frame_levels(images, i, images.image(i))
        cameras = {label: uncertain_camera_for(spec, camera, *size) for label, spec in specs.items()}
        for label, assumed in cameras.items():
            recorder = _Recorder()
            given = SolverInput(
                2 * truth[frame_id][0]["radius_m"],
                {label: assumed},
                levels.grey,
                levels.full_scale_dn,
                levels.photometry,
                levels.linearise,
                frame_id=frame_id,
            )
            together = ("coplanar",) if group in COPLANAR else ()
            estimates = [e for e in solve_image(given, methods, (recorder, *together)).estimates if e]
            for row in truth[frame_id]:
                yield _circle(row, label, camera.K, list(zip(recorder.shown, estimates, strict=True)))


def _circle(row: dict[str, Any], label: str, k: Array, found: list[tuple[Observation, Estimate]]) -> Circle:
    pose = np.array([[row[f"camera_from_marker_{i}{j}"] for j in range(4)] for i in range(4)])
    middle = np.array([row["ellipse_x_px"], row["ellipse_y_px"]])
    near = [(float(np.hypot(*(seen.ellipse[:2] - middle))), n) for n, (seen, _) in enumerate(found)]
    distance, n = min(near, default=(np.inf, -1))
    seen, estimate = found[n] if distance < NEAR_PX else (None, None)
    centre = pose[:3, 3]
    image = (k @ centre)[:2] / centre[2]
    return Circle(
        int(row["frame_id"]),
        str(row["group"]),
        label,
        pose,
        float(row["radius_m"]),
        float(row["distance_D"]),
        float(angle_deg(pose[:3, 2], -centre)),
        float(np.hypot(*(image - k[:2, 2]))),
        seen,
        estimate,
    )
