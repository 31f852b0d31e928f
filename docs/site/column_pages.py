"""Columns of scores, truth and a file of estimates, from the lists in the code that write and read them."""

from __future__ import annotations


def columns_page() -> str:
    """The page as Markdown."""
    from roundel.datasets.layout.truth_table import TRUTH_COLUMNS
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
    lines += [
        "", "## truth.parquet", "",
        "The key is `(frame_id, marker_id)`, and rows are in that order. Matrices have one column for each element,",
        "suffix row then column, counted from 0.", "",
        "| column | type | unit | meaning | boards |", "|---|---|---|---|---|",
    ]  # fmt: skip
    for columns in TRUTH_COLUMNS:
        names = [f"`{name}`" for name in columns.names]
        shown = ", ".join(names) if len(names) <= 6 else f"{names[0]} .. {names[-1]}"
        boards = "" if columns.boards else "null"
        lines.append(f"| {shown} | {columns.type} | {columns.unit} | {columns.meaning} | {boards} |")
    lines += ["", "## A file of estimates", "", columns_markdown(), ""]
    return "\n".join(lines)
