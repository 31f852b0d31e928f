"""Copies of the gate's benchmark: the same radiance with fresh sensor noise, solved and scored like a user would.

A copy is a folder with its estimates and its scores (a baseline file, as the gate reads it). Existing results are kept:
an interrupted run resumes, and a new definition of a metric needs no solving.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from roundel.datasets.dataset import Dataset, open_dataset
from roundel.datasets.layout import files
from roundel.datasets.layout.images import Images, read_image
from roundel.datasets.layout.radiance import decode_radiance
from roundel.render.frame_files import image_file
from roundel.render.sensor.develop import develop
from roundel.scenes.errors import RoundelError
from roundel.scenes.study.study import load_study
from roundel.scenes.world.frame import Frame, frame_of
from roundel.solver.estimates import ESTIMATES
from roundel.solver.methods import solve
from roundel.validate.estimates.runs import read_runs
from roundel.validate.gate.baseline import (
    Baseline,
    baseline_of_false_positives,
    baseline_of_scores,
    read_baseline,
    write_baseline,
)
from roundel.validate.metrics.ground_truth import Targets, true_targets
from roundel.validate.metrics.metric import METRIC_VERSION
from roundel.validate.scores.scores import score

SCORES = "scores.parquet"
EXTENT_D = 3.0


@dataclass(frozen=True)
class Source:
    """A rendered dataset whose frames can be developed (re-exposed) again; its planes are read once and cached."""

    path: Path
    dataset: Dataset
    frames: list[Frame]
    _planes: dict[int, NDArray[np.float32]] = field(default_factory=dict, repr=False)

    def radiance(self, i: int) -> NDArray[np.float32]:
        """Linear radiance of the i-th frame."""
        if i not in self._planes:
            images = self.dataset.images
            part = images.contents.parts[images.contents.place_of(i)[0]]
            name = files.radiance_name(self.frames[i].frame_id)
            place = images.contents.folder.place(part.shard.name(name))
            self._planes[i] = decode_radiance(images.contents.read(part, name), place)["Y"]
        return self._planes[i]

    @cached_property
    def targets(self) -> Targets:
        """All true circles."""
        return true_targets(self.dataset, EXTENT_D)


def open_source(path: Path) -> Source:
    """Open a finished dataset that has its radiance."""
    dataset = open_dataset(path)
    study = load_study(path / files.STUDY)
    return Source(path, dataset, [frame_of(study, i) for i in dataset.images.frame_ids])


@dataclass(frozen=True)
class Renoised(Images):
    """Images of a dataset with different noise: developed from the radiance instead of read from files."""

    source: Source | None = None
    copy: int = 0
    read_noise_e: float | None = None  # instead of the study's

    def image(self, i: int) -> NDArray[Any]:
        assert self.source is not None
        frame = self.source.frames[i]
        seed = int(np.random.SeedSequence([frame.noise_seed, self.copy]).generate_state(1)[0])
        settings = frame.settings
        if self.read_noise_e is not None:
            sensor = settings.sensor.model_copy(update={"read_noise_e": self.read_noise_e})
            settings = settings.model_copy(update={"sensor": sensor})
        again = replace(frame, noise_seed=seed, settings=settings)
        developed = develop(again, self.source.radiance(i))
        if settings.sensor.jpeg_quality is None:
            return developed.image
        ((name, data),) = image_file(again, developed).items()
        height, width = developed.image.shape[:2]
        return read_image(data, name, (width, height))


def solve_copy(source: Source, folder: Path, images: Images) -> None:
    """Estimates of a dataset's frames with other images, by the solver's public API; existing ones are kept."""
    if not (folder / ESTIMATES).is_file():
        with mock.patch.object(solve, "open_images", return_value=images):
            solve.solve_dataset(source.path, folder)


def score_copy(source: Source, folder: Path, images: str) -> Baseline:
    """Scores of the estimates in a folder, as the gate compares them; recomputed if the metric version changed.

    `images` identifies their pixels: two copies are compared by statistics only if their pixels differ.
    """
    try:
        kept = read_baseline(folder / SCORES)
        if kept.metric_version == METRIC_VERSION and kept.images == images:
            return kept
    except RoundelError:
        pass  # none yet, or another version
    scores = score(source.dataset, source.targets, read_runs([folder / ESTIMATES], source.dataset))
    identity = str(source.dataset.manifest["dataset_id"]), images, "benchmark"
    false = baseline_of_false_positives(pa.concat_tables([found.table for found in scores.false_detections]))
    made = Baseline(baseline_of_scores(scores.table), *identity, METRIC_VERSION, [], false)
    write_baseline(made, folder / SCORES)
    return read_baseline(folder / SCORES)


def copies(
    source: Source,
    folder: Path,
    numbers: Sequence[int],
    read_noise_e: float | None = None,
    say: Callable[[str], None] = print,
) -> list[Baseline]:
    """Scored copies with these indices; the same index has the same noise pattern at any strength.

    Parameters
    ----------
    source : Source
    folder : path
        Each copy gets its own folder here.
    numbers : sequence of int
    read_noise_e : float, optional
        Read noise of the sensor; default: the study's.
    """
    out = []
    for number in numbers:
        name = f"copy-{number:04d}" + ("" if read_noise_e is None else f"-read-{read_noise_e:g}")
        if not (folder / name / SCORES).is_file():
            say(name)
        plain = source.dataset.images
        solve_copy(source, folder / name, Renoised(plain.records, plain.contents, source, number, read_noise_e))
        out.append(score_copy(source, folder / name, name))
    return out
