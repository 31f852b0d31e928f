"""Check that a dataset's frames were rendered with the values that its study draws."""

from __future__ import annotations

from roundel.datasets.layout import journal
from roundel.scenes.errors import DataError, RoundelError
from roundel.scenes.study.identity import frame_digest
from roundel.scenes.study.study import Study
from roundel.scenes.world.frame import Frame, frame_of, total_frames

# Journal lines of datasets from 0.1.0 and earlier do not have it.
KEY = "numbers_sha256"

# Frames that stand for all when a shard is continued; each is compared when it is finished.
_SOME = 9


def check_numbers(dataset: str, frame: Frame, entry: journal.Entry | None) -> None:
    """Refuse a frame that was rendered with other values; a line without a checksum, or a missing line, passes.

    Raises
    ------
    DataError
        If the values differ; the message says what to do.
    """
    if entry is not None and KEY in entry and entry[KEY] != frame_digest(frame):
        raise DataError(
            f"{dataset}: frame {frame.frame_id} was rendered with other values than this version of Roundel draws; "
            "continue with the version that started the dataset, or render into another folder"
        )


def check_resumable(dataset: str, study: Study, entries: dict[int, journal.Entry]) -> None:
    """Refuse to add frames to existing ones, unless some of them, evenly spread, were drawn alike.

    Raises
    ------
    DataError
        If a frame was drawn differently, or its line has no checksum to compare.
    """
    ids = sorted(entries)
    if not ids:
        return
    for frame_id in sorted({ids[i * (len(ids) - 1) // (_SOME - 1)] for i in range(_SOME)}):
        if KEY not in entries[frame_id]:
            raise DataError(
                f"{dataset}: was started by a version of Roundel that did not record the values of its frames; "
                "finish it with that version, or render into another folder"
            )
        check_numbers(dataset, frame_of(study, frame_id), entries[frame_id])


def other_numbers(study: Study, entries: dict[int, journal.Entry]) -> list[str]:
    """Problems with the values of finished frames, one sentence each; empty if there are none."""
    checked = [i for i in sorted(entries) if KEY in entries[i]]
    try:
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
