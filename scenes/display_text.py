"""Texts of users as pages and tables show them."""

from __future__ import annotations

import unicodedata

# Lengths at which names and other texts are truncated.
NAME_LIMIT, TEXT_LIMIT = 80, 2000


def clean(text: str, limit: int | None = None) -> str:
    """A user's text on one line, without control and reordering characters, truncated to `limit`."""
    visible = "".join("\N{REPLACEMENT CHARACTER}" if _controls(c) else c for c in " ".join(text.split()))
    return visible if limit is None or len(visible) <= limit else visible[: limit - 1] + "\N{HORIZONTAL ELLIPSIS}"


def _controls(character: str) -> bool:
    # Cc and Cf: control, bidirectional, zero width; Cs: lone surrogates, which cannot be encoded.
    return unicodedata.category(character) in ("Cc", "Cf", "Cs")
