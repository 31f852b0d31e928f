"""The response curve that an image file declares: its ICC profile, or a PNG's gAMA and sRGB chunks."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.response_curve import LINEAR, SRGB, ResponseCurve, gamma_curve

Array = NDArray[np.float64]

_TAGS = (b"gTRC", b"kTRC")  # the curve of green, or of grey
_GRID = 65
_SAME = 0.01  # of the range: the rounding of 8-bit tables
_SRGB_GAMMA = 1 / 2.2  # what a PNG with the sRGB curve has in its gAMA chunk
# Number of parameters of the ICC types of parametric curves 0 to 4.
_PARAMETERS = (1, 3, 4, 5, 7)


def declared_curve(info: Mapping[Any, Any]) -> ResponseCurve | None:
    """The curve that a file declares, from the `info` of Pillow's image; None if it declares none that is known here.

    An ICC profile has priority over a PNG's chunks, as the PNG standard requires.
    """
    profile = info.get("icc_profile")
    if isinstance(profile, bytes) and profile:
        decode = _profile_curve(profile)
        if decode is not None:
            return _named(decode, "the file's ICC profile")
    if "srgb" in info:
        return SRGB.because("the file's sRGB chunk")
    gamma = info.get("gamma")
    if isinstance(gamma, int | float) and 0.05 < gamma < 20:
        basis = "the file's gAMA chunk"
        if abs(gamma - _SRGB_GAMMA) < 0.005:
            return SRGB.because(basis)
        return gamma_curve(round(1 / gamma, 3), basis)
    return None


def _named(decode: Array, basis: str) -> ResponseCurve | None:
    """The curve whose light is `decode`, at levels evenly spaced from 0 to 1."""
    level = np.linspace(0.0, 1.0, len(decode))
    inner = slice(1, -1)
    if not np.all(np.diff(decode) >= 0) or decode[-1] <= 0 or np.any(decode[inner] <= 0):
        return None
    # Least squares of log light over log level, weighted by light: dark levels are steps of a table.
    x, y, w = np.log(level[inner]), np.log(decode[inner] / decode[-1]), decode[inner]
    gamma = round(float(np.sum(w * x * y) / np.sum(w * x * x)), 3)
    curves = (LINEAR, SRGB, gamma_curve(gamma))
    apart = [float(np.max(np.abs(curve.light(level) - decode / decode[-1]))) for curve in curves]
    nearest = min(range(len(curves)), key=apart.__getitem__)
    return curves[nearest].because(basis) if apart[nearest] < _SAME else None


def _profile_curve(profile: bytes) -> Array | None:
    """Light at evenly spaced levels, from the tone curve of an ICC profile; None if it is damaged or has none."""
    try:
        (count,) = struct.unpack_from(">I", profile, 128)
        tags = {}
        for i in range(min(count, 100)):
            name, offset, size = struct.unpack_from(">4sII", profile, 132 + 12 * i)
            tags[name] = profile[offset : offset + size]
        data = next((tags[name] for name in _TAGS if name in tags), b"")
        if data[:4] == b"curv":
            return _table_curve(data)
        return _parametric_curve(data) if data[:4] == b"para" else None
    except (struct.error, ValueError, FloatingPointError):
        return None


def _table_curve(data: bytes) -> Array:
    (count,) = struct.unpack_from(">I", data, 8)
    level = np.linspace(0.0, 1.0, _GRID)
    if count == 0:
        return level
    values = np.array(struct.unpack_from(f">{count}H", data, 12), dtype=np.float64)
    if count == 1:
        return np.asarray(level ** (values[0] / 256))
    return np.interp(level, np.linspace(0.0, 1.0, count), values / 65535)


def _parametric_curve(data: bytes) -> Array:
    """Light of the five ICC types: (a x + b)^g + c above d, linear below."""
    (kind,) = struct.unpack_from(">H", data, 8)
    if kind >= len(_PARAMETERS):
        raise ValueError("unknown type of curve")
    number = _PARAMETERS[kind]
    p = [v / 65536 for v in struct.unpack_from(f">{number}i", data, 12)]
    level = np.linspace(0.0, 1.0, _GRID)
    a, b = (p[1], p[2]) if kind else (1.0, 0.0)
    power = np.maximum(a * level + b, 0.0) ** p[0]
    if kind < 3:
        return np.asarray(power + (p[3] if kind == 2 else 0.0))
    up, low = (p[5], p[6]) if kind == 4 else (0.0, 0.0)
    return np.asarray(np.where(level >= p[4], power + up, p[3] * level + low))
