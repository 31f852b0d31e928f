"""An edge after the sRGB curve, one pixel at a time."""

from __future__ import annotations

from roundel.solver.kernels.compiled import compiled

# IEC 61966-2-1
_SLOPE, _ENCODED, _LINEAR, _OFFSET, _POWER = 12.92, 0.04045, 0.0031308, 0.055, 2.4


@compiled
def srgb_decoded(level: float) -> float:
    """Linear light of an sRGB level, both 0 to 1."""
    if level <= _ENCODED:
        return level / _SLOPE
    return float(((level + _OFFSET) / (1.0 + _OFFSET)) ** _POWER)


@compiled
def srgb_encoded(light: float) -> float:
    """SRGB level of linear light, both 0 to 1."""
    if light <= _LINEAR:
        return light * _SLOPE
    return float((1.0 + _OFFSET) * light ** (1.0 / _POWER) - _OFFSET)


@compiled
def encoded_step(low: float, high: float, t: float, full_scale_dn: float) -> tuple[float, float]:
    """Share of the outer level in a pixel, if the share in light is t and the levels are sRGB-encoded; by t its slope.

    Parameters
    ----------
    low, high : float
        Levels inside and outside, dn.
    t : float
        Share of the outer level in light, 0 to 1.
    full_scale_dn : float
        The level of light 1.
    """
    inside, outside = max(low / full_scale_dn, 0.0), max(high / full_scale_dn, 0.0)
    if abs(outside - inside) < 1e-6:
        return t, 1.0
    dark, light = srgb_decoded(inside), srgb_decoded(outside)
    level = dark + (light - dark) * t
    slope = _SLOPE if level <= _LINEAR else (1.0 + _OFFSET) / _POWER * level ** (1.0 / _POWER - 1.0)
    return (srgb_encoded(level) - inside) / (outside - inside), slope * (light - dark) / (outside - inside)
