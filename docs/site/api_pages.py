"""The API reference: every public name of `roundel`, by what it is for."""

from __future__ import annotations

import inspect

import roundel

GROUPS = {
    "Studies and datasets": ("load_study", "Study", "render_study", "open_dataset", "Dataset", "open_images"),
    "Solving": ("locate", "solve_dataset", "Estimate"),
    "Scoring": ("validate_dataset", "read_estimates", "read_scores", "normal_error_deg"),
    "Geometry": ("Camera", "conic_of_circle", "poses_from_conic", "poses_from_ellipse", "CirclePoses"),
    "Errors": ("RoundelError", "StudyError", "UsageError", "DataError", "NotComparableError"),
}


def api_page() -> str:
    """The page as reStructuredText. Public names that no group has come last."""
    grouped = {name for names in GROUPS.values() for name in names}
    others = tuple(n for n in roundel.__all__ if n not in grouped and n != "__version__")
    lines = [
        "Python interface", "================", "",
        "``import roundel`` loads each name when it is first used.",
        "What is listed here is public; deeper paths may move.",
        "``roundel.__version__`` is the version.", "",
    ]  # fmt: skip
    for title, names in (*GROUPS.items(), ("More", others)):
        names = tuple(name for name in names if name in roundel.__all__)
        if names:
            lines += [title, "-" * len(title), ""]
        for name in names:
            value = getattr(roundel, name)
            kind = "autoclass" if inspect.isclass(value) else "autofunction"
            lines += [f".. {kind}:: roundel.{name}"]
            if inspect.isclass(value) and not issubclass(value, Exception):
                lines += ["   :members:"]
            lines.append("")
    return "\n".join(lines)
