"""Sphinx configuration. `make docs` builds the site into out/docs, offline, with warnings as errors."""

from __future__ import annotations

import logging
import os
import re
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sphinx.application import Sphinx

sys.path.insert(0, str(Path(__file__).parent / "site"))

from generate import write_pages

import roundel

project = "Roundel"
author = "The Roundel authors"
release = roundel.__version__
copyright = author

# No page loads anything from elsewhere. `console` is ours: docs/site/console.py.
extensions = [
    "myst_nb", "sphinx.ext.autodoc", "numpydoc", "sphinx-mathjax-offline", "sphinx_copybutton", "console",
]  # fmt: skip
exclude_patterns = ["decisions/README.md", "roundel_simittag/**", "site/**"]
root_doc = "index"
html_theme = "furo"
html_title = f"Roundel {release}"
html_copy_source = False
html_show_sphinx = False
html_static_path = ["site/static"]
html_css_files = ["wide.css", "console.css"]
html_extra_path = ["reference/linked"]  # pages that commands of the tutorials wrote, as they are
copybutton_selector = "div.commands pre, div.highlight-python pre, div.highlight-yaml pre"

myst_enable_extensions = ["dollarmath", "fieldlist"]
myst_heading_anchors = 4
myst_fence_as_directive = ["math"]
nb_execution_mode = "force"  # each time the page is read, which is when it or Roundel has changed
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 300
nb_execution_show_tb = True
numpydoc_show_class_members = False
autodoc_typehints = "none"  # numpydoc's sections say it with shapes and units
autodoc_member_order = "bysource"

# Notebooks run without the settings of whoever builds the site, and without IPython's notices on stderr.
_IPYTHON = tempfile.TemporaryDirectory(prefix="roundel-ipython-")
_PROFILE = Path(_IPYTHON.name) / "profile_default"
_PROFILE.mkdir()
(_PROFILE / "ipython_kernel_config.py").write_text("c.IPKernelApp.log_level = 40\n", encoding="utf-8")
os.environ["IPYTHONDIR"] = _IPYTHON.name
logging.getLogger("traitlets").setLevel(logging.WARNING)

_LINK = re.compile(r"\[([^\]]*)\]\((?!https?:|#|mailto:)([^)#\s]+)(#[^)\s]*)?\)")


def _name_files_outside(app: Sphinx, name: str, source: list[str]) -> None:
    """Turn links to files that are no pages of the site into their names: the site stands without the repository."""
    folder = (Path(app.srcdir) / name).parent

    def replaced(match: re.Match[str]) -> str:
        target = (folder / match[2]).resolve()
        inside = target.is_relative_to(Path(app.srcdir)) and not target.is_dir()
        if inside and target.suffix in (".md", ".svg", ".png", ".jpg", ".rst", ".yml"):
            return match[0]
        shown = target.relative_to(Path(app.srcdir).parent).as_posix()
        text = match[1].strip("`")
        return f"`{shown}`" if text in (shown, match[2], target.name) else f"{match[1]} (`{shown}`)"

    source[0] = _LINK.sub(replaced, source[0])


def setup(app: Sphinx) -> None:
    """Write the generated pages before the build reads any."""
    write_pages(Path(app.srcdir) / "reference")
    app.connect("source-read", _name_files_outside)
