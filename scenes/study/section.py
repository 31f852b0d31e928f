"""Base class of all sections of a study: strict, frozen, finite."""

from __future__ import annotations

from typing import ClassVar

from pydantic import BaseModel, ConfigDict


class Section(BaseModel):
    """A mapping of known keys.

    `drawn_apart` names those whose distributions are not drawn once for a frame.
    """

    drawn_apart: ClassVar[frozenset[str]] = frozenset()

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
