"""Pages of the documentation, as sources and as the HTML that a reader copies from."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from html.parser import HTMLParser
from pathlib import Path

HOUSE = Path(__file__).resolve().parents[3]
DOCS = HOUSE / "docs"
TUTORIALS = sorted(p for p in (DOCS / "tutorials").glob("*.md") if p.stem != "index")
_BLOCK = re.compile(r"^```\{console\}\n((?::\w+:[^\n]*\n)*)(.*?)\n```$", flags=re.S | re.M)


@dataclass(frozen=True)
class Block:
    """A block of commands, and how it ends: the status, and the shown lines of output."""

    commands: str
    status: int
    output: str = ""


def blocks_of_source(page: Path) -> list[Block]:
    """The console blocks of a Markdown page, in order."""
    found = []
    for options, commands in _BLOCK.findall(page.read_text(encoding="utf-8")):
        status = re.search(r":status: (\d+)", options)
        found.append(Block(commands, int(status[1]) if status else 0))
    return found


class _Consoles(HTMLParser):
    """Collects the text of `pre` elements inside `div.console`, and whether it is commands or output."""

    def __init__(self) -> None:
        super().__init__()
        self.blocks: list[Block] = []
        self._stack: list[set[str]] = []
        self._text: list[str] | None = None

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        classes = set((dict(attrs).get("class") or "").split())
        if tag == "div":
            self._stack.append(classes)
            if "console" in classes:
                (status,) = (c.removeprefix("status-") for c in classes if c.startswith("status-"))
                self.blocks.append(Block("", int(status)))
        elif tag == "pre" and any("console" in c for c in self._stack):
            self._text = []

    def handle_endtag(self, tag: str) -> None:
        if tag == "div":
            self._stack.pop()
        elif tag == "pre" and self._text is not None:
            text, self._text = "".join(self._text).strip("\n"), None
            last = self.blocks[-1]
            if any("commands" in c for c in self._stack):
                self.blocks[-1] = Block(text, last.status, last.output)
            else:
                self.blocks[-1] = Block(last.commands, last.status, text)

    def handle_data(self, data: str) -> None:
        if self._text is not None:
            self._text.append(data)


def blocks_of_html(page: Path) -> list[Block]:
    """The console blocks of a built page: the text that a reader copies, and what the page says came of it."""
    parser = _Consoles()
    parser.feed(page.read_text(encoding="utf-8"))
    return parser.blocks


def without_documents(commands: str) -> list[str]:
    """The command lines of a block: here-documents are left out, continued lines are joined."""
    lines: list[str] = []
    end: str | None = None
    for line in commands.replace("\\\n", " ").splitlines():
        if end is not None:
            end = None if line == end else end
            continue
        lines.append(line)
        opened = re.search(r"<<'(\w+)'", line)
        end = opened[1] if opened else None
    return lines


def documents_of(commands: str) -> dict[str, str]:
    """The files that a block writes with here-documents, by name."""
    return dict(re.findall(r"^cat > (\S+) <<'\w+'\n(.*?)\n^EOF_\w+$", commands, flags=re.S | re.M))


def roundel_calls(lines: list[str]) -> list[list[str]]:
    """The arguments of each call of `roundel` in shell lines."""
    calls = []
    for line in lines:
        for part in re.split(r"&&|\|\||;|\|", line.strip().strip("()")):
            words = shlex.split(part, comments=True)
            if words[:1] == ["roundel"]:
                redirected = next((i for i, word in enumerate(words) if word.startswith(">")), len(words))
                calls.append(words[1:redirected])
    return calls
