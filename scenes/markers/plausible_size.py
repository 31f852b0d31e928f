"""Whether the size of a print is plausible in metres: sizes in millimetres are the most common mistake."""

from __future__ import annotations

# Larger prints exist (landing pads), and are rare. Millimetres given as metres are above it: nobody prints 2 mm.
LARGEST_PRINT_M = 2.0


def describe_implausible_size(size_m: float) -> str:
    """What is odd about the size of a print in metres, as one clause; empty if it is plausible.

    Examples
    --------
    >>> describe_implausible_size(80.0)
    'a print of 80 m; lengths are in metres: 80 mm are 0.08'
    >>> describe_implausible_size(0.08)
    ''
    """
    if size_m <= LARGEST_PRINT_M:
        return ""
    return f"a print of {size_m:g} m; lengths are in metres: {size_m:g} mm are {size_m / 1000:g}"
