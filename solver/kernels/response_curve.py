"""The sRGB curve, one level at a time."""

from __future__ import annotations

from roundel.solver.kernels.compiled import compiled

# IEC 61966-2-1
_SLOPE, _LINEAR, _OFFSET, _POWER = 12.92, 0.0031308, 0.055, 2.4


@compiled
def srgb_encoded(light: float) -> float:
    """SRGB level of linear light, both 0 to 1."""
    if light <= _LINEAR:
        return light * _SLOPE
    return float((1.0 + _OFFSET) * light ** (1.0 / _POWER) - _OFFSET)
