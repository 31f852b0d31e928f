"""Plausibility of a given focal length: numbers that look as if they were in another unit."""

from __future__ import annotations

from roundel.solver.intrinsics.exif import FOCAL_35MM_RANGE
from roundel.solver.intrinsics.specification import Intrinsics

# 100 px would be a field of view of more than 90 degrees for every image wider than 200 px; lenses have 1 to 100 mm.
_SMALLEST_FOCAL_PX = 100.0


def describe_implausible_focal(spec: Intrinsics) -> str:
    """What is odd about the focal length of `focal:PX` or `focal35:MM`, in one line; empty if it is plausible.

    Examples
    --------
    >>> from roundel.solver.intrinsics.specification import parse_intrinsics
    >>> describe_implausible_focal(parse_intrinsics("focal:26"))
    '--intrinsics focal:26: a focal length of 26 px is very short; if it is 26 mm (35-mm equivalent), give focal35:26'
    """
    if spec.kind == "focal" and spec.focal < _SMALLEST_FOCAL_PX:
        meant = f"if it is {spec.focal:g} mm (35-mm equivalent), give focal35:{spec.focal:g}"
        return f"--intrinsics {spec.label}: a focal length of {spec.focal:g} px is very short; {meant}"
    low, high = FOCAL_35MM_RANGE
    if spec.kind == "focal35" and spec.focal < low:
        meant = f"if it is {spec.focal:g} m, give focal35:{1000 * spec.focal:g}"
        return f"--intrinsics {spec.label}: no lens has a 35-mm equivalent of {spec.focal:g} mm; {meant}"
    if spec.kind == "focal35" and spec.focal > high:
        meant = f"if it is {spec.focal:g} px, give focal:{spec.focal:g}"
        return f"--intrinsics {spec.label}: no lens has a 35-mm equivalent of {spec.focal:g} mm; {meant}"
    return ""
