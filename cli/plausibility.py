"""Arguments that are legal, but look as if they were given in another unit."""

from __future__ import annotations

import argparse


def implausible_arguments(arguments: argparse.Namespace) -> list[str]:
    """One line for each size and each focal length that is probably in another unit than its option's.

    Raises
    ------
    UsageError
        If an `--intrinsics` cannot be parsed.
    """
    from roundel.scenes.markers.plausible_size import describe_implausible_size
    from roundel.solver.intrinsics.plausibility import describe_implausible_focal
    from roundel.solver.intrinsics.specification import parse_intrinsics

    lines = []
    for name in ("diameter_m", "spacing_m"):
        size_m = getattr(arguments, name, None)
        what = "" if size_m is None else describe_implausible_size(size_m)
        if what:
            lines.append(f"--{name.replace('_', '-')} {size_m:g}: {what}")
    specs = map(parse_intrinsics, getattr(arguments, "intrinsics", None) or [])
    return [*lines, *filter(None, map(describe_implausible_focal, specs))]
