"""The keys of a study, as strict pydantic models: no unknown key, no infinite number, no surprise.

A group's section is what all groups share, with the group's own keys laid over it; `scenes.study` does the merging.
"""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from roundel.scenes.values import AnyValue, Fraction, NonNegative, Positive, Spread, Tilt, Turn

SCHEMA_VERSION = 1

Key = tuple[str | int, ...]


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class CameraSection(_Model):
    """A camera: its focal length in pixels, or a lens in millimetres with the sensor's pixel pitch."""

    width_px: int = Field(ge=16, le=20_000)
    height_px: int = Field(ge=16, le=20_000)
    focal_px: Positive | None = None
    focal_mm: Positive | None = None
    pixel_pitch_um: Positive | None = None
    principal_point_x_px: AnyValue | None = None
    principal_point_y_px: AnyValue | None = None
    distortion: list[AnyValue] = Field(default=[], description="k1, k2, p1, p2 and perhaps k3, as OpenCV")
    f_number: Positive | None = None
    aperture_mm: NonNegative | None = None
    focus_m: Positive | None = None
    focal_35mm_mm: Positive | None = None

    @model_validator(mode="after")
    def _consistent(self) -> CameraSection:
        if (self.focal_px is None) == (self.focal_mm is None):
            raise ValueError("give either focal_px or focal_mm (with pixel_pitch_um)")
        if self.focal_mm is not None and self.pixel_pitch_um is None:
            raise ValueError("focal_mm needs pixel_pitch_um")
        if len(self.distortion) not in (0, 4, 5):
            raise ValueError(f"distortion has {len(self.distortion)} coefficients; give k1, k2, p1, p2 and perhaps k3")
        if self.f_number is not None and (self.aperture_mm is not None or self.focal_mm is None):
            raise ValueError("f_number goes with focal_mm; with focal_px give aperture_mm")
        if (self.f_number is not None or self.aperture_mm is not None) and self.focus_m is None:
            raise ValueError("an aperture needs focus_m, the distance in focus")
        return self


class _Print(_Model):
    ink: Fraction = 0.05
    paper: Fraction = 0.80
    wall: Fraction = Field(default=0.35, description="reflectance of the plane behind the sheet")
    inverted: bool = Field(default=False, description="a light marker on dark paper")
    margin_m: NonNegative | None = Field(default=None, description="paper around the print; default a third of it")


class DiscSection(_Print):
    """A filled disc."""

    kind: Literal["disc"]
    diameter_m: Positive


class RingSection(_Print):
    """A ring: its outer circle is the circle of record."""

    kind: Literal["ring"]
    diameter_m: Positive
    inner_diameter_m: Positive


class BoardKeys(_Model):
    """A chessboard by its inner corners; one count odd, one even, so that it has no symmetry."""

    columns: int = Field(ge=3, le=60)
    rows: int = Field(ge=3, le=60)
    square_m: Positive

    @model_validator(mode="after")
    def _no_symmetry(self) -> BoardKeys:
        if (self.columns + self.rows) % 2 == 0:
            raise ValueError(
                f"{self.columns} by {self.rows} inner corners look the same upside down; make one count odd, one even"
            )
        return self


class ChessboardSection(_Print, BoardKeys):
    """A chessboard alone."""

    kind: Literal["chessboard"]


class DiscWithChessboardSection(_Print):
    """A disc with a chessboard beside it on the same sheet."""

    kind: Literal["disc_with_chessboard"]
    diameter_m: Positive
    gap_m: Positive = Field(description="from the disc's edge to the board's")
    chessboard: BoardKeys


Marker = Annotated[
    DiscSection | RingSection | ChessboardSection | DiscWithChessboardSection, Field(discriminator="kind")
]


class PoseSection(_Model):
    """Where the marker stands; exactly one of the two distances."""

    distance_D: Positive | None = Field(default=None, description="camera centre to circle centre, in diameters")
    distance_m: Positive | None = None
    tilt_deg: Tilt = 0.0
    azimuth_deg: Turn = 0.0
    roll_deg: Turn = 0.0
    offset_x_px: AnyValue = Field(default=0.0, description="image of the centre, from the principal point")
    offset_y_px: AnyValue = 0.0

    @model_validator(mode="after")
    def _one_distance(self) -> PoseSection:
        if (self.distance_D is None) == (self.distance_m is None):
            raise ValueError("give either distance_D or distance_m")
        return self


class LampSection(_Model):
    """A square area light; it faces the marker."""

    position_m: list[AnyValue] = Field(min_length=3, max_length=3, description="in the camera frame")
    size_m: Positive
    radiance: NonNegative


class LightSection(_Model):
    """A constant environment and area lights; radiance in arbitrary but common units."""

    environment: NonNegative = 1.0
    lamps: list[LampSection] = Field(default=[], max_length=8)


class SensorSection(_Model):
    """Electrons and digital numbers (EMVA 1288 terms)."""

    white_level: Positive = Field(
        default=0.8, description="auto exposure: where in the full well the white of the sheet lands"
    )
    exposure_e: Positive | None = Field(default=None, description="fixed exposure: electrons for a radiance of 1")
    full_well_e: Positive = 10_000.0
    read_noise_e: NonNegative = 5.0
    shot_noise: bool = True
    bits: Literal[8, 16] = 8


class RenderSection(_Model):
    """Samples: `samples` a pixel everywhere, `band_samples` within `band_px` of an edge; both multiples of 8."""

    samples: int = Field(default=8, ge=8, le=65_536, multiple_of=8)
    band_samples: int = Field(default=1024, ge=8, le=65_536, multiple_of=8)
    band_px: float = Field(default=2.0, ge=1.0, le=64.0)
    radiance: bool = Field(default=True, description="keep radiance/*.exr")


class PointsSection(_Model):
    """Points mode: noisy points of the true contour instead of images."""

    count: Literal["perimeter"] | Annotated[int, Field(ge=6, le=100_000)] = "perimeter"
    sigma_px: NonNegative = 1.0


class SweepSection(_Model):
    """The same frames again at each level of one key, such as `sensor.read_noise_e`."""

    key: str
    levels: list[float] = Field(min_length=1, max_length=1000)


class GroupSection(_Model):
    """One group of frames: what all groups share with the group's own keys laid over it."""

    mode: Literal["images", "points"] = "images"
    frames: int | None = Field(default=None, ge=1, le=10_000_000)
    frames_per_cell: int | None = Field(default=None, ge=1, le=1_000_000)
    camera: CameraSection
    marker: Marker
    pose: PoseSection
    light: LightSection = LightSection()
    sensor: SensorSection = SensorSection()
    render: RenderSection = RenderSection()
    points: PointsSection = PointsSection()
    sweep: SweepSection | None = None

    @cached_property
    def spreads(self) -> list[tuple[Key, Spread]]:
        """Every spread with its place, in the order of the schema; kept, as each frame asks for it."""
        found: list[tuple[Key, Spread]] = []

        def walk(node: Any, where: Key) -> None:
            if isinstance(node, Spread):
                found.append((where, node))
            elif isinstance(node, list | tuple):
                for i, item in enumerate(node):
                    walk(item, (*where, i))
            elif isinstance(node, BaseModel):
                for name in type(node).model_fields:
                    walk(getattr(node, name), (*where, name))

        walk(self, ())
        return found

    @model_validator(mode="after")
    def _one_count(self) -> GroupSection:
        if (self.frames is None) == (self.frames_per_cell is None):
            raise ValueError("give either frames or frames_per_cell")
        if self.mode == "points" and self.marker.kind not in ("disc", "ring"):
            raise ValueError("points mode needs a disc or a ring")
        return self


class SolveSection(_Model):
    """What `roundel run` asks of the solver."""

    groups: list[str] | None = None
    methods: list[str] = Field(default=["ml"], min_length=1)
    intrinsics: list[str] = Field(default=["true"], min_length=1)
    calibrate_from: str | None = Field(default=None, description="a group of chessboards, for `calibrated`")
    knowledge: Literal["none", "same_side", "opposite_side"] = "none"


class ValidateSection(_Model):
    """What `roundel run` asks of the validator."""

    reprojection_extent_D: Positive = 3.0


class Head(_Model):
    """The keys that stand once in a study."""

    schema_: int = Field(alias="schema", ge=SCHEMA_VERSION, le=SCHEMA_VERSION)
    name: str = Field(min_length=1, max_length=200)
    seed: int = Field(default=0, ge=0, le=2**63 - 1)
    licence: str = "CC0-1.0"
    solve: SolveSection = SolveSection()
    validate_: ValidateSection = Field(default=ValidateSection(), alias="validate")


def json_schema() -> dict[str, Any]:
    """The JSON Schema of a study file (a group's keys may stand at the top, in a group, or be shared by both)."""
    group = GroupSection.model_json_schema(ref_template="#/$defs/{model}")
    head = Head.model_json_schema(by_alias=True, ref_template="#/$defs/{model}")
    definitions = {**group.pop("$defs", {}), **head.pop("$defs", {})}
    properties = group["properties"]

    # What is required of the merged section may be missing in each of the two places it is merged from.
    def relaxed(schema: dict[str, Any]) -> dict[str, Any]:
        return {k: v for k, v in schema.items() if k != "required"}

    for name in ("CameraSection", "PoseSection"):
        definitions[name] = relaxed(definitions[name])
    overrides = {"type": "object", "properties": properties, "additionalProperties": False}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Roundel study",
        "type": "object",
        "properties": {
            **head["properties"],
            **properties,
            "groups": {"type": "object", "additionalProperties": overrides, "minProperties": 1},
        },
        "required": ["schema", "name"],
        "additionalProperties": False,
        "$defs": definitions,
    }
