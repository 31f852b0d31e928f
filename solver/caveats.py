"""Caveats of an estimate in plain English: what its model did not hold for, and what was done about it.

The validator counts them, so this module imports nothing of the solver.
"""

from __future__ import annotations

from collections.abc import Iterable

BORDER = "cut by the image's border"
SHARPENED_RECORD = "the camera sharpened the image: the edge may be displaced"
SHARPENED_PIXELS = "the image looks sharpened, its edge overshoots: the edge may be displaced"
TONED = "the camera changed the tone of the image, which is not undone"
CURVE_UNKNOWN = "the response curve is unknown, linear or sRGB: the covariance includes both"
CURVE_UNKNOWN_IGNORED = "the response curve is unknown, linear or sRGB: the covariance does not include it"

# The words by which each kind of caveat is recognised, and its heading in a count; the most serious first.
_KINDS = (
    ("fitted to edge points", "fitted to edge points instead of pixels"),
    ("edge's pixels are clipped", "clipped pixels along the edge"),
    ("of the contour is left out", "parts of the contour left out"),
    ("deviate from the model", "pixels that deviate from the model"),
    ("border", "cut by the image's border"),
    ("response curve is unknown", "unknown response curve"),
    ("response curve was estimated", "estimated response curve"),
    ("sharpened", "sharpened image"),
    ("tone", "changed tone"),
)
OTHER = "other"

_LEAST_CLIPPED = 0.005  # fractions below which nothing is said: single hot pixels, and sectors lost to chance
_LEAST_REJECTED = 0.03


def clipped_words(fraction: float) -> str:
    """The caveat of a fraction of clipped pixels; empty if it is negligible."""
    return f"{_percent(fraction)} of the edge's pixels are clipped" if fraction >= _LEAST_CLIPPED else ""


def rejected_words(fraction: float) -> str:
    """The caveat of a fraction of the contour that was left out; empty if it is negligible."""
    if fraction < _LEAST_REJECTED:
        return ""
    return f"{_percent(fraction)} of the contour is left out: hidden, or off the model"


def misfit_words(misfit: float) -> str:
    """The caveat of a reduced chi-square that is more than chance."""
    return f"the edge's pixels deviate from the model {misfit**0.5:.1f} times their noise: the covariance was widened"


def fallback_words(reason: str) -> str:
    """The caveat of a fit to edge points instead of pixels."""
    return f"fitted to edge points: {reason}"


def curve_words(curve: str) -> str:
    """The caveat of an estimated response curve."""
    return f"the response curve was estimated: {'sRGB' if curve == 'srgb' else curve}"


def heading_of(caveat: str) -> str:
    """The kind of a caveat, as a heading without numbers; `other` if it is a third party's."""
    return next((heading for word, heading in _KINDS if word in caveat), OTHER)


def count_caveats(caveats: Iterable[Iterable[str]]) -> dict[str, int]:
    """Number of estimates with each kind of caveat, in the order of the kinds."""
    counts = dict.fromkeys([*(heading for _, heading in _KINDS), OTHER], 0)
    for one in caveats:
        for heading in {heading_of(caveat) for caveat in one}:
            counts[heading] += 1
    return {heading: number for heading, number in counts.items() if number}


def _percent(fraction: float) -> str:
    percent = 100 * fraction
    return f"{percent:.0f} %" if percent >= 1 else f"{percent:.1f} %"
