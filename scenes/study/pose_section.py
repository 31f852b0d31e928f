"""Keys of poses: of the marker, and of further markers beside it."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

from pydantic import Field, model_validator

from roundel.scenes.study.marker_section import Marker
from roundel.scenes.study.section import Section
from roundel.scenes.study.values import AnyValue, NonNegative, Positive, Spread, Tilt, Turn


class PoseSection(Section):
    """Pose of the marker; exactly one of the two distances is given."""

    distance_D: Positive | None = Field(
        default=None,
        description="distance from the camera centre to the circle's centre, in marker diameters; instead of "
        "distance_m",
    )
    distance_m: Positive | None = Field(
        default=None, description="distance from the camera centre to the marker's centre, m"
    )
    tilt_deg: Tilt = Field(
        default=0.0, description="angle between the marker's plane normal and the optical axis, degrees"
    )
    azimuth_deg: Turn = Field(
        default=0.0, description="direction in which the marker is tilted, degrees from +x toward +y"
    )
    tilt_from: Literal["line_of_sight"] | None = Field(
        default=None, description="measure tilt and azimuth from the line of sight; default: from the optical axis"
    )
    roll_deg: Turn = Field(default=0.0, description="rotation of the marker in its own plane, degrees")
    offset_x_px: AnyValue = Field(
        default=0.0, description="image of the marker's centre relative to the principal point, px"
    )
    offset_y_px: AnyValue = Field(
        default=0.0, description="image of the marker's centre relative to the principal point, px"
    )

    @model_validator(mode="after")
    def _one_distance(self) -> PoseSection:
        if (self.distance_D is None) == (self.distance_m is None):
            raise ValueError("give either distance_D or distance_m")
        return self


class FurtherMarkerSection(Section):
    """A further marker on a sheet of its own."""

    marker: Marker | None = Field(default=None, description="what is printed; default: as the study's marker")
    pose: PoseSection = Field(description="where the marker is")


class MarkersSection(Section):
    """Further markers: a list, or a count of them at random places where none hides another.

    A list of markers is short for `{others: [...]}`.
    """

    # Each random marker draws for itself, and again where it would hide another.
    drawn_apart: ClassVar[frozenset[str]] = frozenset(
        ("distance_D", "distance_m", "tilt_deg", "azimuth_deg", "roll_deg", "kinds")
    )

    others: list[FurtherMarkerSection] = Field(
        default=[], max_length=100, description="markers with poses of their own, at most 100"
    )
    count: int = Field(default=0, ge=0, le=100, description="number of markers at random places in the image")
    kinds: list[Marker] = Field(
        default=[], max_length=100, description="what they are, one after the other; default: as the study's marker"
    )
    distance_D: Positive | None = Field(
        default=None, description="their distance in diameters of each; default: as the study's pose"
    )
    distance_m: Positive | None = Field(default=None, description="their distance, m; instead of distance_D")
    tilt_deg: Tilt | None = Field(default=None, description="their tilt, degrees; default: as the study's pose")
    azimuth_deg: Turn | None = Field(default=None, description="their azimuth, degrees; default: as the study's pose")
    roll_deg: Turn | None = Field(default=None, description="their roll, degrees; default: as the study's pose")
    gap_px: NonNegative = Field(default=4.0, description="least distance between two sheets in the image, px")

    @property
    def any(self) -> bool:
        """Whether there is a further marker."""
        return bool(self.others) or self.count > 0

    @model_validator(mode="before")
    @classmethod
    def _short_form(cls, raw: Any) -> Any:
        return {"others": raw} if isinstance(raw, list) else raw

    @model_validator(mode="after")
    def _drawn_at_random(self) -> MarkersSection:
        if self.distance_D is not None and self.distance_m is not None:
            raise ValueError("give distance_D or distance_m, not both")
        for name in self.drawn_apart - {"kinds"}:
            value = getattr(self, name)
            if isinstance(value, Spread) and value.kind == "grid":
                raise ValueError(f"{name}: a grid has one value for a frame; give choice, uniform or a number")
        return self
