"""A summary as text for the terminal."""

from __future__ import annotations

from roundel.validate.metrics.metric import HEADLINE
from roundel.validate.scores.stated_uncertainty import ASKED, region_text
from roundel.validate.scores.summary import Summary, detected_without_pose, number


def terminal_table(summary: Summary) -> str:
    """The table that the command prints: median and 95th percentile of the oracle candidate's errors."""
    head = ("method", "intrinsics", "reference", "solved", *(m.short_label for m in HEADLINE), "false")
    lines = [head]
    for run in summary.runs:
        pairs = [f"{number(s['median'])} / {number(s['p95'])}" for s in (run["oracle"][m.column] for m in HEADLINE)]
        solved, false = f"{run['solved']}/{run['n']}", run["false_detections"]
        ends = (solved, *pairs, "" if false is None else str(false))
        lines.append((run["method"], run["intrinsics"], run["reference"], *ends))
    widths = [max(len(line[i]) for line in lines) for i in range(len(head))]

    def aligned(line: tuple[str, ...]) -> str:
        cells = (c.ljust(w) if i < 3 else c.rjust(w) for i, (c, w) in enumerate(zip(line, widths, strict=True)))
        return "  ".join(cells).rstrip()

    extent = summary.settings["reprojection_extent_D"]
    note = f"median / 95th percentile; oracle: the candidate nearer to the truth; reprojection +-{extent:g} D"
    return "\n".join([*map(aligned, lines), note, *_without_poses(summary), *_regions(summary)])


def _regions(summary: Summary) -> list[str]:
    """Whether the regions of 95 % hold the truth, one line for each run that states any."""
    stated = [(run, (run.get("coverage") or {}).get("oracle")) for run in summary.runs]
    lines = [
        f"  {run['method']}, {run['intrinsics']}: {found['verdict']}; {region_text(found)}"
        for run, found in stated
        if found
    ]
    return [f"95 % regions hold the truth ({ASKED} asked for):", *lines] if lines else []


def _without_poses(summary: Summary) -> list[str]:
    """One line with the centre errors for each run that found circles without a pose."""
    out = []
    for run in summary.runs:
        bare = detected_without_pose(run)
        if bare > 0:
            image, ellipse = run["oracle"]["centre_image_error_px"], run["ellipse"]["ellipse_centre_error_px"]
            out.append(
                f"{run['method']}, {run['intrinsics']}: {bare} of {run['n']} found without a pose; centre errors "
                f"{number(image['median'])} / {number(image['p95'])} px to the image of the circle's centre, "
                f"{number(ellipse['median'])} / {number(ellipse['p95'])} px to the ellipse's centre"
            )
    return out
