"""Whose radiance the frames of a developed (re-exposed) dataset have."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from pydantic import BaseModel, ConfigDict, Field


class Repeated(BaseModel):
    """A group whose frames have the radiance of others, in the same order, over and over.

    Attributes
    ----------
    first_frame : int
        First frame of the group.
    source_first_frame, source_frames : int
        First frame and number of those whose radiance it has.
    """

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)
    first_frame: int = Field(ge=0)
    source_first_frame: int = Field(ge=0)
    source_frames: int = Field(ge=1)

    def source_of(self, frame_id: int) -> int:
        """The frame whose radiance a frame of the group has."""
        return self.source_first_frame + (frame_id - self.first_frame) % self.source_frames


@dataclass(frozen=True)
class Developed:
    """Origin of a developed dataset.

    Attributes
    ----------
    dataset_id : str
        Of the dataset that was developed.
    rendered_id : str
        Of the dataset whose rays were traced: the same, unless that one was developed itself.
    groups : dict
        Groups whose frames are not numbered as those that were rendered.
    """

    dataset_id: str
    rendered_id: str
    groups: Mapping[str, Repeated] = field(default_factory=dict)

    def source_of(self, group: str, frame_id: int) -> int:
        """The rendered frame whose radiance a frame has."""
        return self.groups[group].source_of(frame_id) if group in self.groups else frame_id

    def record(self) -> dict[str, Any]:
        """The keys `developed_from` and, where it says more, `radiance_of` of a manifest and of a shard's record."""
        found: dict[str, Any] = {"developed_from": self.dataset_id}
        if self.groups or self.rendered_id != self.dataset_id:
            groups = {name: group.model_dump() for name, group in sorted(self.groups.items())}
            found["radiance_of"] = {"dataset_id": self.rendered_id, "groups": groups}
        return found


def developed_of(record: Mapping[str, Any]) -> Developed | None:
    """The origin in a manifest or a shard's record; None if the frames were rendered."""
    parent = record.get("developed_from")
    if parent is None:
        return None
    radiance = record.get("radiance_of") or {"dataset_id": parent, "groups": {}}
    groups = {name: Repeated(**group) for name, group in radiance["groups"].items()}
    return Developed(str(parent), str(radiance["dataset_id"]), groups)
