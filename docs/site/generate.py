"""Pages of the reference that are made from the code: the command, the keys of a study, columns, API, import graph."""

from __future__ import annotations

import argparse
from pathlib import Path

from api_pages import api_page
from column_pages import columns_page
from import_graph import draw_graph
from study_pages import study_page


def command_page() -> str:
    """The command's reference, from its parser."""
    from roundel.cli.main import build_parser

    parser = build_parser()
    lines = ["# The command", "", parser.description or "", "", f"{(parser.epilog or '').capitalize()}.", ""]
    verbs = next(a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    for name, verb in verbs.choices.items():
        lines += [f"## roundel {name}", "", verb.description or "", "", "```text"]
        lines += [verb.format_usage().removeprefix("usage: ").strip(), "```", ""]
        rows = [action for action in verb._actions if action.help is not argparse.SUPPRESS and action.dest != "help"]
        if rows:
            lines += ["| argument | meaning |", "|---|---|"]
            lines += [f"| `{_spelling(a)}` | {_cell(a)} |" for a in rows]
            lines.append("")
    return "\n".join(lines)


def _spelling(action: argparse.Action) -> str:
    value = action.metavar if isinstance(action.metavar, str) else (action.dest.upper() if action.nargs != 0 else "")
    if not action.option_strings:
        return str(value)
    takes = action.nargs != 0
    return f"{action.option_strings[-1]} {value}".strip() if takes else action.option_strings[-1]


def _cell(action: argparse.Action) -> str:
    text = (action.help or "").replace("|", "\\|").replace("%%", "%")
    if action.choices:
        text = f"{text} ({', '.join(map(str, action.choices))})".strip()
    return text + (" (required)" if action.required and action.option_strings else "")


def write_pages(folder: Path) -> None:
    """Write every generated page; a file whose text is the same is left alone."""
    folder.mkdir(exist_ok=True)
    pages = {
        "command.md": command_page(),
        "study.md": study_page(),
        "columns.md": columns_page(),
        "api.rst": api_page(),
        "imports.svg": draw_graph(Path(__file__).resolve().parents[2]),
    }
    for name, text in pages.items():
        path = folder / name
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
