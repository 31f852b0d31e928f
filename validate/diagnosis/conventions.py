"""Conventions that files of estimates have by mistake, each as the change of the table that undoes it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from roundel.datasets.dataset import Dataset
from roundel.validate.estimates.row_checks import floats
from roundel.validate.estimates.schema import CENTRE, CENTRE_IMAGE, ELLIPSE, INTRINSICS, NORMAL

Array = NDArray[np.float64]
Part = Literal["pose", "ellipse", "centre"]

PARTS: tuple[Part, ...] = ("pose", "ellipse", "centre")
COLUMNS: dict[Part, tuple[str, ...]] = {"pose": (*NORMAL, *CENTRE), "ellipse": ELLIPSE, "centre": CENTRE_IMAGE}


@dataclass(frozen=True)
class Convention:
    """A wrong convention.

    Attributes
    ----------
    name : str
        One word; both directions of a shift have the same.
    parts : tuple of str
        The parts of an estimate that have it.
    text : str
        What the file seems to do, as the end of a sentence that begins with "the file".
    remedy : str
        What to change, as an order.
    undo : callable
        (table, part, dataset) to the table as it should be.
    """

    name: str
    parts: tuple[Part, ...]
    text: str
    remedy: str
    undo: Callable[[pa.Table, Part, Dataset], pa.Table]


def _put(table: pa.Table, names: tuple[str, ...], values: Array) -> pa.Table:
    """The table with other numbers in some columns; NaN is null."""
    for name, column in zip(names, values.T, strict=True):
        at = table.column_names.index(name)
        table = table.set_column(at, name, pa.array(column, pa.float64(), mask=np.isnan(column)))
    return table


def _scaled(names: tuple[str, ...], factor: float) -> Callable[[pa.Table, Part, Dataset], pa.Table]:
    return lambda table, part, dataset: _put(table, names, factor * floats(table, names))


def _radians(table: pa.Table, part: Part, dataset: Dataset) -> pa.Table:
    angle = floats(table, ELLIPSE[4:])
    # Angles of more than a turn are degrees.
    turns = np.abs(angle[np.isfinite(angle)]).max(initial=0.0) / (2 * np.pi)
    return _put(table, ELLIPSE[4:], np.degrees(angle)) if turns <= 1 else table


def _shifted(by_px: float) -> Callable[[pa.Table, Part, Dataset], pa.Table]:
    def undo(table: pa.Table, part: Part, dataset: Dataset) -> pa.Table:
        if part != "pose":
            return _put(table, COLUMNS[part][:2], floats(table, COLUMNS[part][:2]) + by_px)
        centre, focal = floats(table, CENTRE), floats(table, (INTRINSICS[0], INTRINSICS[1]))
        # Where a row has no camera of its own, it is that of its frame.
        given = np.isfinite(focal)
        focal = np.where(given, focal, _of_frames(table, dataset, ("fx_px", "fy_px")))
        centre[:, :2] += by_px * centre[:, 2:] / focal
        return _put(table, CENTRE, centre)

    return undo


def _frames(by: int) -> Callable[[pa.Table, Part, Dataset], pa.Table]:
    def undo(table: pa.Table, part: Part, dataset: Dataset) -> pa.Table:
        at = table.column_names.index("frame_id")
        return table.set_column(at, "frame_id", pa.array(table["frame_id"].to_numpy() + by, pa.int64()))

    return undo


def _upwards(table: pa.Table, part: Part, dataset: Dataset) -> pa.Table:
    if part == "pose":
        return _mirrored(table, (1.0, -1.0, 1.0))
    values = floats(table, COLUMNS[part])
    values[:, 1] = _of_frames(table, dataset, ("height_px",))[:, 0] - 1 - values[:, 1]
    if part == "ellipse":
        values[:, 4] *= -1
    return _put(table, COLUMNS[part], values)


def _swapped(table: pa.Table, part: Part, dataset: Dataset) -> pa.Table:
    values = floats(table, COLUMNS[part])
    values[:, :2] = values[:, 1::-1]
    if part == "ellipse":
        values[:, 4] = 90 - values[:, 4]
    return _put(table, COLUMNS[part], values)


def _mirrored(table: pa.Table, signs: tuple[float, float, float]) -> pa.Table:
    for names in (NORMAL, CENTRE):
        table = _put(table, names, floats(table, names) * np.array(signs))
    return table


def _of_frames(table: pa.Table, dataset: Dataset, names: tuple[str, ...]) -> Array:
    """Numbers of each row's frame (rows, names); NaN for a frame that the dataset does not have."""
    index = {frame: i for i, frame in enumerate(dataset.images.frame_ids)}
    known: dict[int, tuple[float, ...]] = {}
    frames = table["frame_id"].to_pylist()
    for frame in set(frames) & index.keys():
        camera = dataset.images.camera(index[frame])
        its = {"fx_px": camera.K[0, 0], "fy_px": camera.K[1, 1], "height_px": camera.height_px}
        known[frame] = tuple(float(its[name]) for name in names)
    nothing = (float("nan"),) * len(names)
    return np.array([known.get(frame, nothing) for frame in frames], dtype=np.float64).reshape(-1, len(names))


CONVENTIONS: tuple[Convention, ...] = (
    Convention(
        "full_axes",
        ("ellipse",),
        "has the full axes of its ellipses, not the semi-axes",
        "halve ellipse_a_px and ellipse_b_px",
        _scaled(ELLIPSE[2:4], 0.5),
    ),
    Convention(
        "radians",
        ("ellipse",),
        "has the angles of its ellipses in radians",
        "write ellipse_angle_deg in degrees",
        _radians,
    ),
    Convention(
        "half_pixel",
        PARTS,
        "counts pixels from the corner of the top-left one, half a pixel off: (0, 0) is its centre",
        "subtract 0.5 from its pixel coordinates, and from the principal point that its poses are computed with",
        _shifted(-0.5),
    ),
    Convention(
        "half_pixel",
        PARTS,
        "has pixel coordinates that are half a pixel too small: (0, 0) is the centre of the top-left pixel",
        "add 0.5 to its pixel coordinates, and to the principal point that its poses are computed with",
        _shifted(0.5),
    ),
    Convention(
        "frame_numbers",
        PARTS,
        "numbers its frames from 1: the first frame_id of a dataset is 0",
        "subtract 1 from frame_id",
        _frames(-1),
    ),
    Convention("frame_numbers", PARTS, "has frame numbers that are too small by one", "add 1 to frame_id", _frames(1)),
    Convention(
        "y_upwards",
        PARTS,
        "has a y axis that points upwards: it points down, in the image and in the camera's frame",
        "write height - 1 - y for y and -angle for the angle in the image, and -y in the camera's frame",
        _upwards,
    ),
    Convention(
        "swapped_xy",
        ("ellipse", "centre"),
        "has x and y swapped: x is the column and y the row",
        "exchange x and y, and write 90 - angle for the angle",
        _swapped,
    ),
    Convention(
        "centimetres",
        ("pose",),
        "has lengths in centimetres",
        "divide centre_x_m, centre_y_m and centre_z_m by 100",
        _scaled(CENTRE, 0.01),
    ),
    Convention(
        "millimetres",
        ("pose",),
        "has lengths in millimetres",
        "divide centre_x_m, centre_y_m and centre_z_m by 1000",
        _scaled(CENTRE, 0.001),
    ),
    Convention(
        "opengl_axes",
        ("pose",),
        "has OpenGL's camera axes, y up and z backward: OpenCV's are y down and z forward",
        "change the signs of y and z of normal and centre",
        lambda table, part, dataset: _mirrored(table, (1.0, -1.0, -1.0)),
    ),
    Convention(
        "flipped_normals",
        ("pose",),
        "has normals that point into the printed face, away from the camera",
        "change the sign of normal_x, normal_y and normal_z",
        lambda table, part, dataset: _put(table, NORMAL, -floats(table, NORMAL)),
    ),
)
