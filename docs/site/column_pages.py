"""Columns of scores.parquet and of a file of estimates, from the lists in the code that write and read them."""

from __future__ import annotations


def columns_page() -> str:
    """The page as Markdown."""
    from roundel.validate.estimates.schema import columns_markdown
    from roundel.validate.metrics.metric import METRICS, SHIFT_X, SHIFT_Y

    lines = [
        "# Metrics and columns", "",
        "A *metric* of a pose has two columns in `scores.parquet`: that of the candidate that the solver chose, under",
        "its own name, and that of the candidate nearer to the truth, with the prefix `oracle_`.",
        "A metric of the ellipse has one.", "",
        "| column | title | unit | frame | definition | bound |", "|---|---|---|---|---|---|",
    ]  # fmt: skip
    for metric in (*METRICS, SHIFT_X, SHIFT_Y):
        bound = f"`{metric.bound}`" if metric.bound else ""
        definition = metric.definition.replace("|", "\\|").replace("*", "\\*")
        lines.append(
            f"| `{metric.column}` | {metric.title} | {metric.unit} | {metric.frame} | {definition} | {bound} |"
        )
    lines += ["", "## A file of estimates", "", columns_markdown(), ""]
    return "\n".join(lines)
