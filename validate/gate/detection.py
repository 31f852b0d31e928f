"""Questions of detection: missed circles, false positives, and whether confidences hold over both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from roundel.validate.gate.checks import Check, Tested, growth_verdicts, rate
from roundel.validate.gate.quantities import (
    ALPHA,
    BRIER_FLOOR,
    CONFIDENCE,
    DETECTED,
    MIN_CIRCLES,
    RATE_FLOOR,
    Array,
    flags,
    floats,
    there,
)
from roundel.validate.statistics.paired_tests import mean_ratio_test, sign_test

# Confidences vary if no value is that of more than this share of the detections.
_ALIKE = 0.5


@dataclass(frozen=True)
class _Side:
    """Detections of one side: frame and stated confidence (NaN if none) of the right ones, and of the wrong ones."""

    right_frame: NDArray[np.int64]
    right: Array
    wrong_frame: NDArray[np.int64]
    wrong: Array

    @property
    def stated(self) -> Array:
        """All stated confidences."""
        every: Array = np.concatenate([self.right, self.wrong])
        return np.asarray(every[np.isfinite(every)])

    def brier(self, frames: NDArray[np.int64]) -> tuple[Array, Array]:
        """By frame: the sum of squared differences between confidence and outcome, and the number of confidences."""
        total, count = np.zeros(len(frames)), np.zeros(len(frames))
        for frame, confidence, outcome in ((self.right_frame, self.right, 1.0), (self.wrong_frame, self.wrong, 0.0)):
            known = np.isfinite(confidence)
            at = np.searchsorted(frames, frame[known])
            np.add.at(total, at, (confidence[known] - outcome) ** 2)
            np.add.at(count, at, 1.0)
        return total, count

    def words(self) -> str:
        """The mean confidence, and the share of detections that are right."""
        right = int(np.isfinite(self.right).sum())
        stated = self.stated
        return f"{100 * stated.mean():.1f} % stated, {100 * right / len(stated):.1f} % right"


def detection_questions(
    run: str, new: pa.Table, old: pa.Table, false_new: pa.Table | None, false_old: pa.Table | None
) -> tuple[list[Tested], list[Check]]:
    """Tests of detections, and a check of confidences that no longer vary; none that an older baseline cannot answer.

    Parameters
    ----------
    run : str
    new, old : pyarrow.Table
        Scores of the same circles, row by row.
    false_new, false_old : pyarrow.Table or None
        False positives of the run; None if a side is of an older version.
    """
    out: list[Tested] = []
    if there(DETECTED, new, old):
        found = [flags(t, DETECTED) for t in (new, old)]
        # Of a method with a pose for each detection this is the question whether circles are solved.
        if any(not np.array_equal(f, flags(t, "solved")) for f, t in zip(found, (new, old), strict=True)):
            out.append(rate(run, "detected", found[0], found[1]))
    if false_new is None or false_old is None:
        return out, []
    numbers = [old["frame_id"], false_new["frame_id"], false_old["frame_id"]]
    frames = np.unique(np.concatenate([column.to_numpy() for column in numbers])).astype(np.int64)
    out.append(_false_positives(run, frames, false_new, false_old))
    if not there(CONFIDENCE, new, old):
        return out, []
    sides = [_side(t, false) for t, false in ((new, false_new), (old, false_old))]
    more, check = _confidence(run, frames, *sides)
    return [*out, *more], check


def _false_positives(run: str, frames: NDArray[np.int64], new: pa.Table, old: pa.Table) -> Tested:
    count = [np.bincount(np.searchsorted(frames, t["frame_id"].to_numpy()), minlength=len(frames)) for t in (new, old)]
    test = sign_test(*count, alpha=ALPHA)
    sentence = f"{new.num_rows} in {test.n} frames, {old.num_rows} before"
    verdicts = growth_verdicts(test.effect, test.standard_error, RATE_FLOOR)
    return Tested(run, "false positives", test, sentence, *verdicts)


def _side(rows: pa.Table, false: pa.Table) -> _Side:
    found = flags(rows, DETECTED) if there(DETECTED, rows) else flags(rows, "solved")
    right = floats(rows, CONFIDENCE)[found]
    return _Side(rows["frame_id"].to_numpy()[found], right, false["frame_id"].to_numpy(), floats(false, CONFIDENCE))


def _confidence(run: str, frames: NDArray[np.int64], new: _Side, old: _Side) -> tuple[list[Tested], list[Check]]:
    if len(old.stated) < MIN_CIRCLES:
        return [], []
    if len(new.stated) < MIN_CIRCLES:
        sentence = f"confidence given: stated for {len(old.stated)} detections before, now for {len(new.stated)}"
        return [], [Check(run, "confidence given", "worse", sentence)]
    test = mean_ratio_test(new.brier(frames), old.brier(frames), alpha=ALPHA)
    means = [float(total.sum() / count.sum()) for total, count in (side.brier(frames) for side in (old, new))]
    sentence = (
        f"Brier score {means[0]:.4f} -> {means[1]:.4f} of {len(new.stated)} detections; {old.words()} -> {new.words()}"
    )
    verdicts = growth_verdicts(test.effect, test.standard_error, BRIER_FLOOR)
    return [Tested(run, "confidence", test, sentence, *verdicts)], _constant(run, new.stated, old.stated)


def _constant(run: str, new: Array, old: Array) -> list[Check]:
    """A confidence that is the same for every detection says nothing of any, however often they are right."""
    most = int(np.unique(old, return_counts=True)[1].max())
    if np.ptp(new) > 0 or most > _ALIKE * len(old):
        return []
    sentence = f"one confidence for all: {new[0]:g} for all {len(new)} detections; it told them apart before"
    return [Check(run, "one confidence for all", "worse", sentence)]
