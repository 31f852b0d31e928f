"""The likely cause of a difference between an export and its dataset, in words: empty, or how large it is, if unknown.

What goes wrong in practice: half a pixel, another unit, axes or rows and columns exchanged, a matrix transposed.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Of poses, relative to their distance, and of rotations; of image coordinates: the digits that formats keep.
POSE_TOLERANCE, PX_TOLERANCE = 1e-6, 1e-5


def why_px(offset: Array) -> str:
    """Of image coordinates: half a pixel, if that is it."""
    if np.allclose(np.abs(offset), 0.5, atol=1e-3):
        return f"off by ({offset[0]:+.3g}, {offset[1]:+.3g}) px: half a pixel, the corner of the first or its centre"
    return ""


def why_k(got: Array, ours: Array) -> str:
    """Of camera matrices: transposed, x and y exchanged, or by how many pixels."""
    if np.allclose(got, ours.T, atol=PX_TOLERANCE):
        return "its matrix is transposed"
    if np.allclose(got[:2, 2][::-1], ours[:2, 2], atol=PX_TOLERANCE):
        return "x and y are exchanged"
    return f"by up to {np.abs(got - ours).max():.3g} px"


def why_unit(got: Array, ours: Array) -> str:
    """Of lengths: a factor common to all values."""
    some = np.abs(ours) > 0
    if not some.any():
        return ""
    ratio = float(np.median(got[some] / ours[some]))
    if not np.isfinite(ratio) or ratio == 0 or not np.allclose(got, ratio * ours, rtol=1e-3, atol=1e-9):
        return ""
    return f" by a factor of {ratio:.4g}: another unit" if abs(ratio - 1) > 1e-6 else ""


def _other_axes() -> Iterator[Array]:
    """Matrices that exchange and reverse axes."""
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            yield np.eye(3)[list(order)] * np.array(signs)


def why_axes(got: Array, ours: Array) -> str:
    """Of rotations: the inverse, other axes, or by how many degrees."""
    if np.allclose(got, ours.T, atol=POSE_TOLERANCE):
        return ": it is the inverse"
    if any(np.allclose(m, got, atol=POSE_TOLERANCE) for axes in _other_axes() for m in (axes @ ours, ours @ axes)):
        return ": axes are exchanged or reversed"
    return f" by {np.degrees(np.arccos(np.clip((np.trace(got.T @ ours) - 1) / 2, -1, 1))):.3g} degrees"


def why_order(got: Array, ours: Array) -> str:
    """Of positions: other axes, or by how many metres."""
    if any(np.allclose(axes @ ours, got, atol=POSE_TOLERANCE) for axes in _other_axes()):
        return ": axes are exchanged or reversed"
    return f" by {np.linalg.norm(got - ours):.3g} m"


def why_mask(got: NDArray[np.bool_], ours: NDArray[np.bool_]) -> str:
    """Of masks: rows and columns exchanged, or how far the centre is off."""
    if got.shape == ours.shape[::-1] and np.array_equal(got.T, ours):
        return ": rows and columns are exchanged"
    if not got.any() or not ours.any():
        return ""
    offset = np.array([np.mean(np.nonzero(m), axis=1) for m in (got, ours)])
    shift = (offset[0] - offset[1])[::-1]
    return f": its centre is off by ({shift[0]:+.2f}, {shift[1]:+.2f}) px" if np.abs(shift).max() > 0.1 else ""
