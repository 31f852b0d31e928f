"""Keys of the world around the sheet."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, model_validator

from roundel.scenes.study.section import Section

WorldKind = Literal["plain", "tabletop", "room", "shelf", "workshop", "outdoor"]
WORLDS = ("plain", "tabletop", "room", "shelf", "workshop", "outdoor")


class WorldSection(Section):
    """What stands around the sheet; `world: tabletop` is short for `world: {kind: tabletop}`."""

    kind: WorldKind = Field(
        default="plain",
        description="plain: a sheet on an infinite wall; the others are places with objects and lights, drawn anew for "
        "each frame",
    )
    objects: int = Field(default=12, ge=0, le=60, description="number of objects around the sheet")
    sheet_thickness_m: float = Field(
        default=0.0003, gt=0.0, le=0.05, description="thickness of the sheet, m; not in a plain world"
    )

    @model_validator(mode="before")
    @classmethod
    def _short_form(cls, raw: Any) -> Any:
        return {"kind": raw} if isinstance(raw, str) else raw
