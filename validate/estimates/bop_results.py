"""Results in BOP's format as estimates: one pose in millimetres in each line.

Source: https://github.com/thodan/bop_toolkit, "Format of the BOP challenge results": the columns `scene_id, im_id,
obj_id, score, R, t, time`, R row by row. An export's `im_id` is the frame, and its scene and object follow from it;
whether a pose belongs to a marker is judged by where it is, as for every method.
"""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pyarrow as pa

from roundel.scenes.errors import NotComparableError, UsageError
from roundel.validate.estimates.schema import CENTRE, NORMAL

COLUMNS = ("scene_id", "im_id", "obj_id", "score", "R", "t", "time")

# How far R may be from a rotation: results are often written with few digits.
_ORTHONORMAL = 1e-2


def is_bop_results(names: list[str]) -> bool:
    """Whether a header is that of BOP's results."""
    return names == list(COLUMNS)


def read_bop_results(file: Path, text: str) -> pa.Table:
    """Estimates of a file of results; the method is what its name has before the first underscore.

    Raises
    ------
    UsageError
        If a line is not as the format has it.
    NotComparableError
        If there is no line.
    """
    rows: dict[str, list[object]] = {name: [] for name in ("frame_id", "detection_id", "confidence", *NORMAL, *CENTRE)}
    seen: dict[int, int] = {}
    for number, line in enumerate(csv.reader(text.splitlines()[1:]), start=2):
        if not line:
            continue
        frame_id, score, rotation, centre = _line(f"{file}:{number}", line)
        rows["frame_id"].append(frame_id)
        rows["detection_id"].append(seen.get(frame_id, 0))
        seen[frame_id] = seen.get(frame_id, 0) + 1
        rows["confidence"].append(score)
        # The marker's Z is its normal.
        for names, values in ((NORMAL, rotation[:, 2]), (CENTRE, centre / 1000)):
            for name, value in zip(names, values.tolist(), strict=True):
                rows[name].append(value)
    if not seen:
        raise NotComparableError(f"{file}: the file has no results, so there is nothing to score")
    table = pa.table(rows)
    return table.append_column("method", pa.array([file.stem.partition("_")[0]] * table.num_rows))


def _line(where: str, line: list[str]) -> tuple[int, float, np.ndarray, np.ndarray]:
    if len(line) != len(COLUMNS):
        raise UsageError(f"{where}: has {len(line)} columns, not {len(COLUMNS)}: {', '.join(COLUMNS)}")
    _, frame_id, _, score, r, t, _ = line
    try:
        rotation = np.array([float(word) for word in r.split()]).reshape(3, 3)
        centre = np.array([float(word) for word in t.split()]).reshape(3)
        number, value = int(frame_id), float(score)
    except ValueError:
        raise UsageError(f"{where}: im_id and score are numbers, R has nine and t three, separated by spaces") from None
    if not (np.isfinite(rotation).all() and np.isfinite(centre).all() and math.isfinite(value)):
        raise UsageError(f"{where}: has a number that is not finite")
    error = np.abs(rotation @ rotation.T - np.eye(3)).max()
    if error > _ORTHONORMAL or np.linalg.det(rotation) < 0:
        raise UsageError(f"{where}: R is no rotation; it is row by row, from the model to the camera")
    u, _, v = np.linalg.svd(rotation)
    return number, value, u @ v, centre
