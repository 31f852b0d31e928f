"""Keys of the world around the sheet: a place of ours, or the user's own scene or pictures."""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from roundel.scenes.assets.anchor import scene_from_sheet
from roundel.scenes.assets.files import any_of
from roundel.scenes.assets.meshes import MESHES
from roundel.scenes.study.section import Section
from roundel.scenes.study.values import AnyValue, Positive

WorldKind = Literal["plain", "tabletop", "room", "shelf", "workshop", "outdoor", "scene"]
# Those that need no further key.
WORLDS = ("plain", "tabletop", "room", "shelf", "workshop", "outdoor")

Place = Annotated[list[AnyValue], Field(min_length=3, max_length=3)]
Direction = Annotated[list[float], Field(min_length=3, max_length=3)]

_OBJECTS = 12
_OF_A_SCENE = ("anchor", "unit_m", "vertical", "checksums")
_OF_PICTURES = ("picture_m", "pictures_sha256", "pictures_count")


class AnchorSection(Section):
    """Where the sheet lies in the user's scene; directions are those of the file."""

    position_m: Place = Field(
        description="point of the scene on which the back of the sheet lies, behind the first marker's centre, m"
    )
    normal: Direction | None = Field(
        default=None, description="direction out of the surface, of any length; default: the scene's vertical"
    )
    up: Direction | None = Field(
        default=None,
        description="direction of the print's upper edge; its part along the normal is dropped; default: -z in a "
        "scene whose y is up, +y in one whose z is up",
    )


class WorldSection(Section):
    """What stands around the sheet; `world: tabletop` is short for `world: {kind: tabletop}`."""

    kind: WorldKind = Field(
        default="plain",
        description="plain: a sheet on an infinite wall; scene: a file of your own, see scene; the others are places "
        "with objects and lights, drawn anew for each frame",
    )
    objects: int = Field(default=_OBJECTS, ge=0, le=60, description="number of objects around the sheet")
    sheet_thickness_m: float = Field(
        default=0.0003, gt=0.0, le=0.05, description="thickness of the sheet, m; not in a plain world"
    )
    scene: str | None = Field(
        default=None,
        min_length=1,
        description="file of your own scene, relative to the study: glTF (.glb, .gltf), .obj, .ply, or Mitsuba's .xml; "
        "`world: {scene: FILE}` is enough",
    )
    anchor: AnchorSection | None = Field(
        default=None,
        description="where the sheet lies in the scene; default: face up on the highest point on the vertical through "
        "its middle",
    )
    unit_m: float | None = Field(default=None, gt=0.0, description="metres in a unit of the scene's file; default: 1")
    vertical: Literal["y", "z"] | None = Field(
        default=None, description="axis of the file that points up; default: y, as in glTF"
    )
    checksums: dict[str, str] | None = Field(
        default=None,
        description="sha256 of the scene's file and of every file it refers to; filled in when the study is read",
    )
    pictures: str | None = Field(
        default=None,
        min_length=1,
        description="folder of pictures (PNG, JPEG), relative to the study; in a plain world, each frame has one of "
        "them on the wall behind the sheet",
    )
    picture_m: Positive | None = Field(default=None, description="width of a picture on the wall, m; default: 1")
    pictures_sha256: str | None = Field(
        default=None,
        pattern="^[0-9a-f]{64}$",
        description="checksum of all pictures of the folder; filled in when the study is read",
    )
    pictures_count: int | None = Field(
        default=None, ge=1, description="number of pictures in the folder; filled in when the study is read"
    )

    @model_validator(mode="before")
    @classmethod
    def _short_form(cls, raw: Any) -> Any:
        if isinstance(raw, str):
            return {"kind": raw}
        return {"kind": "scene", **raw} if isinstance(raw, dict) and raw.get("scene") is not None else raw

    @model_validator(mode="after")
    def _keys_of_its_kind(self) -> WorldSection:
        if self.kind == "scene":
            self._check_scene()
        elif self.scene is not None:
            raise ValueError(f"kind {self.kind} has no scene; remove kind, or scene")
        for key in _OF_A_SCENE if self.kind != "scene" else ():
            if getattr(self, key) is not None:
                raise ValueError(f"{key} belongs to a scene of your own; add scene, or remove {key}")
        if self.pictures is not None and self.kind != "plain":
            raise ValueError("pictures hang on the wall of a plain world; remove pictures, or make it kind: plain")
        for key in _OF_PICTURES if self.pictures is None else ():
            if getattr(self, key) is not None:
                raise ValueError(f"{key} belongs to pictures; add pictures, or remove {key}")
        return self

    def _check_scene(self) -> None:
        if self.scene is None:
            raise ValueError("scene: required key is missing; name the file of your scene")
        ending = PurePosixPath(self.scene).suffix.lower()
        if ending not in (*MESHES, ".xml"):
            raise ValueError(f"scene: {self.scene} is none of {any_of((*MESHES, '.xml'))}")
        if self.objects != _OBJECTS:
            raise ValueError("objects are placed in our own worlds only; remove objects")
        if ending == ".xml" and self.anchor is None:
            raise ValueError("anchor: required key is missing; an XML scene does not say where the sheet may lie")
        if self.anchor is not None:
            try:
                scene_from_sheet([0.0, 0.0, 0.0], *self.directions(), self.sheet_thickness_m)
            except ValueError as error:
                raise ValueError(f"anchor.{error}") from error

    @property
    def is_xml(self) -> bool:
        """Whether the scene is Mitsuba's own format."""
        return self.scene is not None and self.scene.lower().endswith(".xml")

    def directions(self) -> tuple[list[float], list[float]]:
        """The sheet's normal and upper edge, in the scene's axes."""
        z_is_up = self.vertical == "z"
        vertical = [0.0, 0.0, 1.0] if z_is_up else [0.0, 1.0, 0.0]
        upper = [0.0, 1.0, 0.0] if z_is_up else [0.0, 0.0, -1.0]
        normal = None if self.anchor is None else self.anchor.normal
        up = None if self.anchor is None else self.anchor.up
        return normal if normal is not None else vertical, up if up is not None else upper
