"""Keys of a study as strict pydantic models.

A group's section consists of the keys shared by all groups, overridden by its own; `scenes.study` merges them.
"""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from roundel.scenes.camera.intrinsics_label import IntrinsicsLabel
from roundel.scenes.study.camera_section import CameraSection, MotionSection
from roundel.scenes.study.layers import preset_names
from roundel.scenes.study.light_section import LightSection, OccluderSection
from roundel.scenes.study.marker_section import CIRCULAR, Marker
from roundel.scenes.study.pose_section import MarkersSection, PoseSection
from roundel.scenes.study.section import Section
from roundel.scenes.study.sensor_section import ISP_PRESETS, SensorSection
from roundel.scenes.study.values import Level, NonNegative, Positive, Spread
from roundel.scenes.study.world_section import WORLDS, WorldSection

SCHEMA_VERSION = 1

# With fewer views, OpenCV's planar calibration is underdetermined.
MIN_CALIBRATION_VIEWS = 3

Key = tuple[str | int, ...]


class RenderSection(Section):
    """Rays: `samples` per pixel where the image is smooth, up to `band_samples` where it has structure."""

    samples: int = Field(
        default=8, ge=8, le=65_536, multiple_of=8, description="rays per pixel where the image is smooth"
    )
    target_error: NonNegative = Field(
        default=0.01,
        description="standard error wanted of a pixel, as a fraction of the white sheet's radiance; it "
        "decides the number of rays. 0: band_samples everywhere near an edge",
    )
    background_error: Positive = Field(
        default=0.05,
        description="standard error wanted of a pixel away from the print's edges, as a fraction of white; in a world",
    )
    band_samples: int = Field(
        default=4096, ge=8, le=65_536, multiple_of=8, description="most rays per pixel where the image has structure"
    )
    band_px: float = Field(default=2.0, ge=1.0, le=64.0, description="half width of the band around an edge, px")
    bounces: int = Field(default=1, ge=1, le=16, description="reflections between light and camera; 1 is direct light")
    radiance: bool = Field(default=True, description="whether to keep radiance/*.exr")
    masks: bool = Field(
        default=False,
        description="whether to keep depth and coverage of each marker where the radiance is not kept: masks/*.exr",
    )

    @property
    def keeps_depth(self) -> bool:
        """Whether depth and coverage are kept, beside the radiance or without it."""
        return self.radiance or self.masks


class PointsSection(Section):
    """Points mode: noisy points on the true contour instead of images."""

    count: Literal["perimeter"] | Annotated[int, Field(ge=6, le=100_000)] = Field(
        default="perimeter", description="number of points, or one for each pixel of the contour's perimeter"
    )
    sigma_px: NonNegative = Field(default=1.0, description="standard deviation of the noise on each coordinate, px")


def put_level(section: Any, path: Key, level: float | str) -> None:
    """Set one key of a section's plain values to a level of a sweep, in place.

    Raises
    ------
    KeyError, IndexError, TypeError
        If the section has no such place.
    """
    node = section
    for part in path[:-1]:
        node = node[part]
    # A key of whole numbers, such as sensor.bits, takes no 8.0.
    node[path[-1]] = int(level) if isinstance(level, float) and level.is_integer() else level


class SweepSection(Section):
    """Repeats the same frames at each level of one key, such as `sensor.read_noise_e`."""

    key: str = Field(description="key that is swept, such as sensor.read_noise_e")
    levels: list[Level] = Field(
        min_length=1,
        max_length=1000,
        description="values of the key, numbers or words; every frame is repeated at each",
    )

    @property
    def path(self) -> Key:
        """The swept key's place in a group's section."""
        return tuple(int(part) if part.isdigit() else part for part in self.key.split("."))

    @property
    def shown_levels(self) -> str:
        """The levels as text."""
        return ", ".join(level if isinstance(level, str) else f"{level:g}" for level in self.levels)

    @model_validator(mode="after")
    def _of_one_kind(self) -> SweepSection:
        if len({isinstance(level, str) for level in self.levels}) > 1:
            raise ValueError("levels are numbers or words, not both")
        return self


class GroupSection(Section):
    """One group of frames: the shared keys, overridden by the group's own."""

    mode: Literal["images", "points"] = Field(
        default="images", description="rendered images, or noisy points of the true contour"
    )
    frames: int | None = Field(
        default=None, ge=1, le=10_000_000, description="number of frames; a multiple of the number of grid cells"
    )
    frames_per_cell: int | None = Field(
        default=None, ge=1, le=1_000_000, description="number of frames in each grid cell; instead of frames"
    )
    camera: CameraSection = Field(description="camera and lens")
    marker: Marker = Field(description="what is printed")
    pose: PoseSection = Field(description="where the marker is")
    motion: MotionSection = Field(default=MotionSection(), description="exposure, shutter, and motion meanwhile")
    light: LightSection = Field(default=LightSection(), description="surroundings and lamps")
    occluders: list[OccluderSection] = Field(
        default=[], max_length=8, description="flat objects in front of the print, at most 8"
    )
    sensor: SensorSection = Field(default=SensorSection(), description="sensor and image file")
    render: RenderSection = Field(default=RenderSection(), description="number of rays, and what is kept")
    points: PointsSection = Field(default=PointsSection(), description="noise of points mode")
    world: WorldSection = Field(default=WorldSection(), description="what stands around the sheet")
    markers: MarkersSection = Field(
        default=MarkersSection(), description="further markers, each on a sheet of its own: a list, or a count"
    )
    paired_with: str | None = Field(
        default=None, description="an earlier group, whose drawn values and seeds the frames of this one share"
    )
    sweep: SweepSection | None = Field(default=None, description="repeat the same frames at several values of one key")

    @cached_property
    def spreads(self) -> list[tuple[Key, Spread]]:
        """Every distribution with its location, in the order of the schema; cached, because each frame needs it."""
        found: list[tuple[Key, Spread]] = []

        def walk(node: Any, where: Key) -> None:
            if isinstance(node, Spread):
                found.append((where, node))
            elif isinstance(node, list | tuple):
                for i, item in enumerate(node):
                    walk(item, (*where, i))
            elif isinstance(node, Section):
                for name in type(node).model_fields:
                    if name not in type(node).drawn_apart:
                        walk(getattr(node, name), (*where, name))

        walk(self, ())
        return found

    @model_validator(mode="after")
    def _world_has_its_own(self) -> GroupSection:
        world = f"world {self.world.kind}"
        if self.world.kind not in ("plain", "scene") and self.light != LightSection():
            raise ValueError(f"light: {world} has its own lights; leave out light, or set world: plain")
        if self.world.kind != "plain" or self.world.pictures is not None:
            if getattr(self.marker, "clutter", None) is not None:
                raise ValueError(f"marker.clutter: {world} has no bare wall; use world.objects")
            if self.motion.marker != MotionSection().marker:
                raise ValueError(f"motion.marker: in {world} the sheet is at rest; move the camera")
        return self

    @model_validator(mode="after")
    def _sheets_apart(self) -> GroupSection:
        bent = self.marker.surface.shape != "flat"
        if not bent and not self.markers.any:
            return self
        what = "markers" if self.markers.any else "marker.surface.shape"
        if self.marker.clutter is not None:
            raise ValueError(
                f"marker.clutter: shapes on the wall need a single flat sheet; leave out clutter, or {what}"
            )
        if self.markers.any and self.motion.marker != MotionSection().marker:
            raise ValueError("motion.marker: one of several markers cannot move by itself; move the camera")
        if bent and self.mode == "points" and self.motion.readout_s != 0:
            raise ValueError("motion.readout_s: points of a bent sheet need a global shutter; leave it out")
        return self

    @model_validator(mode="after")
    def _one_count(self) -> GroupSection:
        if (self.frames is None) == (self.frames_per_cell is None):
            raise ValueError("give either frames or frames_per_cell")
        if self.mode == "points" and self.marker.kind not in CIRCULAR:
            raise ValueError(f"points mode needs a circle: one of {', '.join(CIRCULAR)}")
        return self


class SolveSection(Section):
    """Settings of the solver for `roundel run`."""

    groups: list[str] | None = Field(default=None, description="groups to solve; default: all with circular markers")
    methods: list[str] = Field(default=["pixels"], min_length=1, description="methods, as `roundel solve --method`")
    intrinsics: list[str] = Field(
        default=["true"],
        min_length=1,
        description="cameras given to the solver, as `roundel solve --intrinsics`; `calibrated` from all "
        "views of calibrate_from, `calibrated:5` from the first five",
    )
    calibrate_from: str | None = Field(
        default=None, description="group of views of a chessboard or a circle_grid, for `calibrated`"
    )
    knowledge: str = Field(
        default="none",
        description="prior knowledge of the pose, as `roundel solve --knowledge`: same_side, floor, circle:0.5",
    )

    @field_validator("intrinsics")
    @classmethod
    def _enough_views(cls, labels: list[str]) -> list[str]:
        for label in labels:
            views = IntrinsicsLabel.of(label).views
            if views is not None and views < MIN_CALIBRATION_VIEWS:
                raise ValueError(f"{label}: a calibration needs {MIN_CALIBRATION_VIEWS} views or more")
        return labels


class ValidateSection(Section):
    """Settings of the validator for `roundel run`."""

    reprojection_extent_D: Positive = Field(
        default=3.0, description="half side of the reprojection grid, in marker diameters"
    )


class Head(Section):
    """The keys that occur once in a study."""

    schema_: int = Field(
        alias="schema", ge=SCHEMA_VERSION, le=SCHEMA_VERSION, description="version of the study format, 1"
    )
    name: str = Field(min_length=1, max_length=200, description="name of the study, shown in reports")
    seed: int = Field(default=0, ge=0, le=2**63 - 1, description="seed of everything that is drawn")
    licence: str = Field(default="CC0-1.0", description="licence of the rendered dataset (SPDX)")
    solve: SolveSection = Field(default=SolveSection(), description="what `roundel run` asks of the solver")
    validate_: ValidateSection = Field(
        default=ValidateSection(), alias="validate", description="what `roundel run` asks of the validator"
    )


def json_schema() -> dict[str, Any]:
    """The JSON Schema of a study file (a group's keys may be at the top level, in a group, or in both)."""
    group = GroupSection.model_json_schema(ref_template="#/$defs/{model}")
    head = Head.model_json_schema(by_alias=True, ref_template="#/$defs/{model}")
    definitions = {**group.pop("$defs", {}), **head.pop("$defs", {})}
    properties = group["properties"]

    # Keys that the merged section requires may be missing at either of the two levels.
    def relaxed(schema: dict[str, Any]) -> dict[str, Any]:
        return {k: v for k, v in schema.items() if k != "required"}

    for name in ("CameraSection", "PoseSection"):
        definitions[name] = relaxed(definitions[name])
    properties["world"] = {
        "anyOf": [{"enum": list(WORLDS)}, {"$ref": "#/$defs/WorldSection"}],
        "description": "what stands around the sheet: a kind, or its keys",
    }
    properties["markers"] = {
        "anyOf": [
            {"type": "array", "items": {"$ref": "#/$defs/FurtherMarkerSection"}},
            {"$ref": "#/$defs/MarkersSection"},
        ],
        "description": "further markers, each on a sheet of its own: a list, or a count",
    }
    definitions["SensorSection"]["properties"]["isp"] = {
        "anyOf": [{"enum": list(ISP_PRESETS)}, {"$ref": "#/$defs/IspSection"}],
        "description": "processing of the developed image: a preset, or its keys",
    }
    properties["preset"] = {"enum": preset_names(), "description": "preset whose keys the study's own override"}
    overrides = {"type": "object", "properties": properties, "additionalProperties": False}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Roundel study",
        "type": "object",
        "properties": {
            **head["properties"],
            **properties,
            "groups": {
                "type": "object",
                "additionalProperties": overrides,
                "minProperties": 1,
                "description": "groups of frames by name, each with keys that replace the shared ones",
            },
            "variants": {
                "type": "object",
                "additionalProperties": overrides,
                "minProperties": 1,
                "description": "repeats every group with the keys of each variant, on the same draws: GROUP.VARIANT",
            },
        },
        "required": ["schema", "name"],
        "additionalProperties": False,
        "$defs": definitions,
    }
