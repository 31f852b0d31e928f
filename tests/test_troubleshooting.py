"""Troubleshooting: every message that the page quotes is still one that the code has."""

import ast
import re

from helpers_pages import DOCS, HOUSE

PACKAGES = ("scenes", "render", "datasets", "solver", "validate", "cli")
GAP = "\N{HORIZONTAL ELLIPSIS}"
# A message begins its item. Words in italics beside it are ours.
QUOTED = re.compile(r"^- (?:\*[^*]*\* |`[^`]*` \*[^*]*\* )?`([^`]+)`$", flags=re.M)


def texts_of(tree: ast.AST) -> list[str]:
    """The strings of a module; what an f-string puts in is a gap, and strings that are added are joined."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, (ast.Constant, ast.JoinedStr, ast.BinOp)) and (text := text_of(node)):
            found.append(text)
    return found


def text_of(node: ast.AST) -> str | None:
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else None
    if isinstance(node, ast.JoinedStr):
        return "".join(text_of(part) or GAP for part in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        left, right = text_of(node.left), text_of(node.right)
        return None if left is None and right is None else f"{left or GAP}{right or GAP}"
    return None


def quoted_messages() -> list[str]:
    return QUOTED.findall((DOCS / "troubleshooting.md").read_text(encoding="utf-8"))


def fits(message: str, text: str) -> bool:
    """Whether a message, of which gaps may be anything, is a message of the code with gaps of its own."""
    parts = [part for part in re.split(GAP, message) if part.strip(": ;.,")]
    place = 0
    for part in parts:
        place = text.find(part, place)
        if place < 0:
            return False
        place += len(part)
    return bool(parts)


def test_every_quoted_message_is_in_the_code() -> None:
    messages = quoted_messages()
    assert len(messages) >= 40
    left = set(messages)
    for path in sorted(path for package in PACKAGES for path in (HOUSE / package).rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        # Parsing all files takes seconds; a message's words stand in its file, on however many lines.
        near = {message for message in left if all(word in source for word in re.findall(r"\w{4,}", message))}
        if near:
            texts = texts_of(ast.parse(source))
            left -= {message for message in near if any(fits(message, text) for text in texts)}
    assert left == set()


def test_the_page_quotes_no_message_that_would_fit_anything() -> None:
    short = [message for message in quoted_messages() if len(message.replace(GAP, "").strip()) < 12]
    assert short == []


def test_a_message_that_changed_would_be_found() -> None:
    assert fits(f"{GAP}: has no column {GAP}", f"{GAP}: has no column {GAP}; print the columns")
    assert not fits(f"{GAP}: has no column {GAP}", f"{GAP}: lacks column {GAP}")
