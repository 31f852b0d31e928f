"""Check that a dataset's frames were rendered with the values that its study draws."""

from __future__ import annotations

from pathlib import Path

from roundel.datasets.layout import files, journal
from roundel.datasets.layout.manifest import read_manifest
from roundel.scenes.errors import DataError, RoundelError
from roundel.scenes.study.identity import SAMPLING_VERSION, frame_digest
from roundel.scenes.study.study import load_study
from roundel.scenes.world.frame import Frame, frame_of, total_frames

# Journal lines of datasets from 0.1.0 and earlier do not have it.
KEY = "numbers_sha256"


def check_numbers(dataset: Path, frame: Frame, entry: journal.Entry | None) -> None:
    """Refuse a frame that was rendered with other values; a line without a checksum, or a missing line, passes.

    Raises
    ------
    DataError
        If the values differ; the message says what to do.
    """
    if entry is not None and KEY in entry and entry[KEY] != frame_digest(frame):
        raise _other(dataset, frame.frame_id)


def _other(dataset: Path, frame_id: int) -> DataError:
    return DataError(
        f"{dataset}: frame {frame_id} was rendered with other values than this version of Roundel draws; "
        "continue with the version that started the dataset, or render into another folder"
    )


def check_resumable(dataset: Path, entries: dict[int, journal.Entry], digests: dict[int, str]) -> None:
    """Refuse to add frames to existing ones, unless all were drawn alike.

    Parameters
    ----------
    dataset : path
    entries : dict
        Journal lines by frame id.
    digests : dict
        `frame_digest` of the frames as the study draws them today, by frame id.

    Raises
    ------
    DataError
        If a frame was drawn differently, or its line has no checksum to compare.
    """
    for frame_id, entry in sorted(entries.items()):
        if KEY not in entry:
            raise DataError(
                f"{dataset}: was started by a version of Roundel that did not record the values of its frames; "
                "finish it with that version, or render into another folder"
            )
        if entry[KEY] != digests.get(frame_id):
            raise _other(dataset, frame_id)


def other_numbers(dataset: Path, entries: dict[int, journal.Entry]) -> list[str]:
    """Problems with the values of a finished dataset's frames, one sentence each; empty if there are none.

    A dataset of another sampling version, or without checksums, is not compared: this version cannot draw its frames.
    """
    manifest = read_manifest(dataset)
    checked = [i for i in sorted(entries) if KEY in entries[i]]
    if manifest.get("sampling_version") != SAMPLING_VERSION or not checked:
        return []
    try:
        study = load_study(dataset / files.STUDY)
        count = total_frames(study)
        wrong = [i for i in checked if i >= count or entries[i][KEY] != frame_digest(frame_of(study, i))]
    except RoundelError as error:
        return [f"the values of its frames cannot be drawn again ({error})"]
    if not wrong:
        return []
    return [
        f"{len(wrong)} frames (the first is {wrong[0]}) were rendered with other values than their study draws; their "
        "truth may be wrong: render into another folder"
    ]
