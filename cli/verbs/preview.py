"""`roundel preview`: a few frames of a study on a page, before it is rendered."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from roundel.cli.progress import progress
from roundel.scenes.errors import UsageError

if TYPE_CHECKING:
    from roundel.scenes.study.study import Study


def preview(study: Study, arguments: argparse.Namespace) -> int:
    """Write the contact sheet and the page of a study; one line for each group on the terminal."""
    from roundel.render.preview.preview import CONTACT_SHEET, PAGE, preview_study

    out = Path(arguments.out or f"{Path(arguments.study).stem}-preview")
    if out.exists() and not out.is_dir():
        raise UsageError(f"{out}: is a file; give a folder to write to")
    with progress("preview") as show:
        lines = preview_study(study, out, show)
    print("\n".join(lines))
    print(f"{out}: see {PAGE}, or {CONTACT_SHEET}")
    return 0
