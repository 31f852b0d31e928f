"""Keys of lights and occluders."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from roundel.scenes.study.section import Section
from roundel.scenes.study.values import AnyValue, Elevation, Fraction, NonNegative, Positive, Turbidity, Turn

# Relative red, green and blue of a light; only a sensor with a mosaic distinguishes them.
Colour = Annotated[list[NonNegative], Field(min_length=3, max_length=3)]
Place = Annotated[list[AnyValue], Field(min_length=3, max_length=3)]
_WHITE = [1.0, 1.0, 1.0]


class AreaLampSection(Section):
    """A square area light that faces the marker."""

    kind: Literal["area"] = Field(default="area", description="a square area light that faces the marker")
    position_m: Place = Field(description="position in the camera frame, m")
    size_m: Positive = Field(description="side of the square, m")
    radiance: NonNegative = Field(description="radiance, in the study's common unit")
    colour: Colour = Field(
        default=_WHITE, description="relative red, green and blue; only a sensor with a mosaic distinguishes them"
    )


class PointLampSection(Section):
    """A point light: irradiance at distance d is intensity cos / d^2."""

    kind: Literal["point"] = Field(description="a point light")
    position_m: Place = Field(description="position in the camera frame, m")
    intensity: NonNegative = Field(description="intensity: irradiance at distance d is intensity cos / d^2")
    colour: Colour = Field(
        default=_WHITE, description="relative red, green and blue; only a sensor with a mosaic distinguishes them"
    )


class SpotLampSection(Section):
    """A spotlight that faces the marker; its intensity falls off from `beam_deg` to `cutoff_deg`."""

    kind: Literal["spot"] = Field(description="a spotlight: a point light limited to a cone")
    position_m: Place = Field(description="position in the camera frame, m")
    intensity: NonNegative = Field(description="intensity on the axis: irradiance at distance d is intensity cos / d^2")
    cutoff_deg: Annotated[Positive, Field(description="half angle beyond which there is no light, degrees")] = 20.0
    beam_deg: Annotated[Positive, Field(description="half angle of full intensity, degrees")] = 15.0
    aim_x_m: AnyValue = Field(default=0.0, description="x of the point it is aimed at, in the marker's plane, m")
    aim_y_m: AnyValue = Field(default=0.0, description="y of the point it is aimed at, in the marker's plane, m")
    colour: Colour = Field(
        default=_WHITE, description="relative red, green and blue; only a sensor with a mosaic distinguishes them"
    )

    @model_validator(mode="after")
    def _beam_within_cutoff(self) -> SpotLampSection:
        # Distributions are checked when their values are drawn.
        cutoff, beam = self.cutoff_deg, self.beam_deg
        if isinstance(cutoff, float) and cutoff > 90:
            raise ValueError("cutoff_deg is a half angle and must be at most 90")
        if isinstance(cutoff, float) and isinstance(beam, float) and beam >= cutoff:
            raise ValueError("beam_deg must be smaller than cutoff_deg")
        return self


def _kind(raw: Any) -> str:
    """The kind of a lamp; the default is an area light."""
    return str(raw.get("kind", "area") if isinstance(raw, dict) else getattr(raw, "kind", "area"))


Lamp = Annotated[
    Annotated[AreaLampSection, Tag("area")]
    | Annotated[PointLampSection, Tag("point")]
    | Annotated[SpotLampSection, Tag("spot")],
    Discriminator(_kind),
]
LAMPS: dict[str, type[Section]] = {"area": AreaLampSection, "point": PointLampSection, "spot": SpotLampSection}


class MapSection(Section):
    """An environment map: an equirectangular (latitude-longitude) OpenEXR or Radiance HDR file.

    Up is -y of the camera frame, or of the scene's own in `world: {scene: FILE}`.
    """

    file: str = Field(
        min_length=1, description="path of the OpenEXR (.exr) or Radiance (.hdr) file, relative to the study"
    )
    sha256: str | None = Field(
        default=None, pattern="^[0-9a-f]{64}$", description="checksum of the file; filled in when the study is read"
    )
    scale: NonNegative = Field(default=1.0, description="factor on the radiance of the map")
    turn_deg: Turn = Field(
        default=0.0,
        description="rotation about the vertical, degrees from +z toward +x; at 0 the camera faces the map's centre",
    )


class SkySection(Section):
    """A clear sky and its sun (Hosek and Wilkie 2012, 2013; Mitsuba's `sunsky`); up is -y of the camera frame."""

    sun_elevation_deg: Elevation = Field(default=45.0, description="elevation of the sun above the horizon, degrees")
    sun_azimuth_deg: Turn = Field(
        default=160.0,
        description="azimuth of the sun, degrees from +z (the viewing direction) toward +x; 180 is behind the camera",
    )
    turbidity: Turbidity = Field(default=3.0, description="turbidity of the air, 1 (clear) to 10 (haze)")
    sun: NonNegative = Field(default=1.0, description="factor on the sun's radiance; 0: no direct sunlight")
    scale: NonNegative = Field(
        default=2.0,
        description="factor on sun and sky; at 2 a sunlit sheet is as bright as under an environment of 1",
    )


class LightSection(Section):
    """An environment (constant, a map, or sun and sky) and lamps; radiance in arbitrary but common units."""

    environment: NonNegative = Field(
        default=1.0, description="radiance of the uniform surroundings, in the study's common unit"
    )
    environment_colour: Colour = Field(default=_WHITE, description="relative red, green and blue of the surroundings")
    map: MapSection | None = Field(default=None, description="an environment map instead of the uniform surroundings")
    sky: SkySection | None = Field(default=None, description="sun and sky instead of the uniform surroundings")
    lamps: list[Lamp] = Field(default=[], max_length=8, description="lamps, at most 8")

    @model_validator(mode="after")
    def _one_environment(self) -> LightSection:
        if self.map is not None and self.sky is not None:
            raise ValueError("give a map or a sky, not both; either replaces the constant environment")
        return self


class OccluderSection(Section):
    """A flat object in front of the print, parallel to it: it hides the marker from the camera, or shades it."""

    shape: Literal["disc", "rectangle"] = Field(default="rectangle", description="outline of the occluder")
    x_m: AnyValue = Field(default=0.0, description="x of its centre, in the marker's frame, m")
    y_m: AnyValue = Field(default=0.0, description="y of its centre, in the marker's frame, m")
    z_m: Positive = Field(description="height above the print, m")
    width_m: Positive = Field(description="width, or diameter of a disc, m")
    height_m: Positive | None = Field(default=None, description="height of a rectangle, m; default: its width")
    turn_deg: Turn = Field(default=0.0, description="rotation in its plane, degrees")
    reflectance: Fraction = Field(default=0.3, description="diffuse reflectance")
