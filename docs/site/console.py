"""Directives for pages whose commands the build runs: `console` runs a block, `made` shows a file that it wrote.

All blocks of a page run in one folder, which is empty before the first. A block is a bash script; it stops at the first
command that fails, and the build fails unless the block's exit status is the one that the page declares:

    ```{console}
    :status: 1
    :last: 12
    roundel gate out/report --baseline baseline.parquet
    ```

`last` shows no more than the last lines of the output. Commands are shown without prompts, so that they can be copied.
docs/decisions/030-tutorials-that-run.md has the reasons.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from session import Session, code_digest
from sphinx.util.docutils import SphinxDirective

if TYPE_CHECKING:
    from sphinx.application import Sphinx
    from sphinx.environment import BuildEnvironment

_PICTURES = (".png", ".jpg", ".svg")
_MADE = "reference/made"  # pictures, in the folder of generated pages
LINKED = "reference/linked"  # in `html_extra_path`: what is inside is copied to the site as it is
_RUN_PAGES = ("tutorials/", "notebooks/")


def _session(env: BuildEnvironment) -> Session:
    if "console" not in env.temp_data:
        # Beside the built site, not inside: nobody publishes it by mistake.
        env.temp_data["console"] = Session(env.docname, Path(env.app.outdir).parent / "docs-run")
    session: Session = env.temp_data["console"]
    return session


class Console(SphinxDirective):
    """Run the block, show its commands and its output."""

    has_content = True
    option_spec: ClassVar[dict[str, Any]] = {
        "status": directives.nonnegative_int,
        "last": directives.positive_int,
    }

    def run(self) -> list[nodes.Node]:
        """The block as nodes."""
        commands, wanted = "\n".join(self.content), self.options.get("status", 0)
        result = _session(self.env).run(commands, wanted)
        if result is None:
            raise self.error("not run: a block above has failed")
        if result.status != wanted:
            raise self.error(f"the block exits with status {result.status}, not {wanted}:\n{commands}\n{result.output}")
        block = nodes.container(classes=["console", f"status-{wanted}"])
        block += nodes.literal_block(commands, commands, language="bash", classes=["commands"])
        lines = result.output.splitlines()
        last = self.options.get("last", len(lines))
        if len(lines) > last:
            lines = ["[...]", *lines[-last:]]
        if lines:
            text = "\n".join(lines)
            block += nodes.literal_block(text, text, language="text", classes=["output"])
        if wanted:
            block += nodes.paragraph("", f"Exit status {wanted}.", classes=["exit-status"])
        return [block]


class Made(SphinxDirective):
    """Show a picture that a block wrote, or link to a page that it wrote; the content is the caption."""

    required_arguments = 1
    has_content = True
    option_spec: ClassVar[dict[str, Any]] = {"alt": directives.unchanged, "width": directives.unchanged}

    def run(self) -> list[nodes.Node]:
        """A figure, or a paragraph with a link."""
        session, name = _session(self.env), self.arguments[0]
        source = session.folder / name
        if not source.is_file():
            raise self.error(f"{name}: the blocks above wrote no such file")
        place, caption = f"{session.page}/{name.replace('/', '-')}", " ".join(self.content)
        shown, _ = self.parse_inline(caption)
        if source.suffix in _PICTURES:
            _copy(source, Path(self.env.srcdir) / _MADE / place)
            image = nodes.image(uri=f"/{_MADE}/{place}", alt=self.options.get("alt", caption))
            if "width" in self.options:
                image["width"] = self.options["width"]
            return [nodes.figure("", image, nodes.caption("", "", *shown))]
        _copy(source, Path(self.env.srcdir) / LINKED / "made" / place)
        target = f"{'../' * session.page.count('/')}made/{place}"
        return [nodes.paragraph("", "", nodes.reference("", "", *shown, refuri=target, internal=False))]


def _copy(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    if not target.is_file() or target.read_bytes() != source.read_bytes():
        shutil.copyfile(source, target)


def _outdated(app: Sphinx, env: BuildEnvironment, added: set[str], changed: set[str], removed: set[str]) -> list[str]:
    """Pages that run code are read again when Roundel has changed, though their text has not."""
    if getattr(env, "roundel_code_digest", None) == code_digest():
        return []
    env.roundel_code_digest = code_digest()  # type: ignore[attr-defined]
    return [name for name in env.found_docs if name.startswith(_RUN_PAGES)]


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directives."""
    (Path(app.srcdir) / LINKED).mkdir(parents=True, exist_ok=True)
    app.add_directive("console", Console)
    app.add_directive("made", Made)
    app.connect("env-get-outdated", _outdated)
    return {"parallel_read_safe": True}
