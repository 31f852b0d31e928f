"""Keys of a marker: the print, its paper, and the wall behind it."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from roundel.scenes.study.section import Section
from roundel.scenes.study.values import Fraction, Identity, Index, NonNegative, Positive, Roughness, Turn

# Every dot is a shape of its own to the renderer.
MOST_DOTS = 400

TagFamily = Literal["aruco_4x4_50", "aruco_5x5_100", "aruco_6x6_250", "apriltag_36h11"]


class SurfaceSection(Section):
    """Reflection of print and paper, and the surface that the paper is bent to."""

    kind: Literal["matte", "plastic", "laminate"] = Field(
        default="matte",
        description="matte; plastic: rough dielectric coat (GGX); laminate: principled, with a clear coat",
    )
    roughness: Roughness = Field(default=0.1, description="GGX alpha of the gloss")
    ior: Index = Field(default=1.5, description="refractive index of the gloss")
    shape: Literal["flat", "cylinder", "bent"] = Field(
        default="flat",
        description="flat; cylinder: as glued round a can; bent: a wave of paper, most curved at the marker's centre",
    )
    radius_m: Positive | None = Field(
        default=None, description="radius of curvature at the marker's centre, m; of a cylinder or bent paper"
    )
    axis_deg: Turn = Field(
        default=90.0, description="direction in the sheet that stays straight, degrees from +X toward +Y"
    )
    wave_m: Positive | None = Field(default=None, description="length of a wave along the paper, m; of bent paper")

    @model_validator(mode="after")
    def _bent_as_said(self) -> SurfaceSection:
        if self.shape == "flat" and (self.radius_m is not None or self.wave_m is not None):
            raise ValueError("radius_m and wave_m need shape: cylinder or bent")
        if self.shape != "flat" and self.radius_m is None:
            raise ValueError(f"shape {self.shape} needs radius_m")
        if (self.wave_m is not None) != (self.shape == "bent"):
            raise ValueError("wave_m belongs to shape bent, which needs it")
        return self


class ClutterSection(Section):
    """Random discs and squares on the wall, one per cell, redrawn for each frame."""

    cell_m: Positive = Field(description="side of a wall cell, m; each cell has one shape")
    contrast: Fraction = Field(
        default=0.5, description="largest difference between the reflectances of a shape and the wall"
    )


class _Print(Section):
    ink: Fraction = Field(default=0.05, description="reflectance of the ink")
    paper: Fraction = Field(default=0.80, description="reflectance of the paper")
    wall: Fraction = Field(default=0.35, description="reflectance of the plane behind the sheet")
    inverted: bool = Field(default=False, description="whether to print a light marker on dark paper")
    margin_m: NonNegative | None = Field(
        default=None, description="width of the paper around the print, m; default: a third of the print"
    )
    edge_softness_m: NonNegative = Field(default=0.0, description="width of the linear ramp between ink and paper, m")
    grain: Fraction = Field(default=0.0, description="RMS variation of the paper's reflectance, as a fraction of it")
    grain_m: Positive = Field(default=0.0005, description="size of a grain, m")
    surface: SurfaceSection = Field(default=SurfaceSection(), description="gloss of print and paper")
    clutter: ClutterSection | None = Field(default=None, description="random shapes on the wall; default: none")


class DiscSection(_Print):
    """A filled disc."""

    kind: Literal["disc"] = Field(description="a filled disc")
    diameter_m: Positive = Field(description="diameter, m")


class DiscWithTickSection(_Print):
    """A disc with an orientation tick: a bar of paper from half the radius to 0.9 of it, along +X."""

    kind: Literal["disc_with_tick"] = Field(description="a disc with an orientation tick")
    diameter_m: Positive = Field(description="diameter, m")


class RingSection(_Print):
    """A ring; its outer circle is the circle of record."""

    kind: Literal["ring"] = Field(description="a ring")
    diameter_m: Positive = Field(description="outer diameter, m")
    inner_diameter_m: Positive = Field(description="inner diameter, m")


class RingsSection(_Print):
    """Concentric circles of decreasing diameter, alternately ink and paper; the outermost is the circle of record."""

    kind: Literal["rings"] = Field(description="concentric rings")
    diameters_m: list[Positive] = Field(
        min_length=2, max_length=16, description="diameters from the outermost inward, m"
    )


class CodedRingsSection(_Print):
    """A disc in a ring, with rings of code cells between them; the outer circle is the circle of record.

    The layout of simittag, whose fractions are the defaults, and, with a hole in the disc, that of ringgrid; `code` has
    a string of 0 and 1 (ink) for each ring of cells, from the inside, clockwise from +X as seen by a reader of the
    print.
    """

    kind: Literal["coded_rings"] = Field(description="a disc in a ring, with rings of code cells between them")
    diameter_m: Positive = Field(description="outer diameter, m")
    code: list[Annotated[str, Field(pattern="^[01]{4,128}$")]] = Field(
        min_length=1,
        max_length=16,
        description="a string of 0 and 1 (ink) for each ring of cells, from the inside, clockwise from +X",
    )
    disc: Fraction = Field(default=0.22, description="radius of the disc, in outer radii")
    hole: Fraction = Field(default=0.0, description="radius of a hole of paper in the disc, in outer radii; 0 for none")
    code_from: Fraction = Field(default=0.30, description="inner radius of the code cells, in outer radii")
    code_to: Fraction = Field(default=0.78, description="outer radius of the code cells, in outer radii")
    ring_from: Fraction = Field(default=0.86, description="inner radius of the outer ring, in outer radii")
    id: Identity | None = Field(
        default=None, description="identity that a reader of the code reports, if it is to be scored"
    )


class RingCodeSection(_Print):
    """Three crowns whose widths hold an identity; the outer circle is the circle of record.

    The bank of identities is that of `roundel.scenes.markers.ring_codes`.
    """

    kind: Literal["ring_code"] = Field(description="three concentric crowns whose widths hold an identity")
    diameter_m: Positive = Field(description="outer diameter, m")
    id: Identity = Field(default=0, description="identity, 0 to 40")


class DotCodeSection(_Print):
    """Dots on two rings, present or absent by a cyclic code; the circle that encloses them is the circle of record.

    That circle is not printed: the outer dots touch it from the inside. The words are those of
    `roundel.scenes.markers.dot_codes`.
    """

    kind: Literal["dot_code"] = Field(description="dots on two rings with a cyclic code")
    diameter_m: Positive = Field(description="diameter of the circle that encloses the dots, m")
    id: Identity = Field(default=0, description="identity, 0 to 39")


class TwoDiscsSection(_Print):
    """Two coplanar discs beside each other; each has its own row in the truth."""

    kind: Literal["two_discs"] = Field(description="two coplanar discs")
    diameter_m: Positive = Field(description="diameter of the first disc, m")
    second_diameter_m: Positive = Field(description="diameter of the second disc, m")
    spacing_m: Positive = Field(description="distance between the two centres along X, m")


class DotRingSection(_Print):
    """Dots evenly spaced on a circle; each has its own row in the truth, and the first is on +X."""

    kind: Literal["dot_ring"] = Field(description="dots on a circle")
    diameter_m: Positive = Field(description="diameter of a dot, m")
    ring_diameter_m: Positive = Field(description="diameter of the circle through the dots' centres, m")
    dots: int = Field(ge=3, le=32, description="number of dots")
    turn_deg: Turn = Field(default=0.0, description="direction of the first dot, degrees from +X")


class CircleGridSection(_Print):
    """OpenCV's grid of circles (`findCirclesGrid`), the board of a calibration.

    `columns` dots in each of `rows` rows. In a symmetric grid neighbours are `spacing_m` apart along X and Y. In an
    asymmetric one rows are `spacing_m` apart, the dots of a row twice that, and every second row is shifted by
    `spacing_m` to the right: with an odd number of rows it has no symmetry.
    """

    kind: Literal["circle_grid"] = Field(description="OpenCV's grid of circles")
    columns: int = Field(ge=2, le=30, description="dots in a row")
    rows: int = Field(ge=2, le=30, description="rows of dots; an odd number makes an asymmetric grid unambiguous")
    spacing_m: Positive = Field(
        description="distance between neighbouring rows, m; between the dots of a row, too, or in an asymmetric grid "
        "half of it"
    )
    diameter_m: Positive = Field(description="diameter of a dot, m")
    layout: Literal["symmetric", "asymmetric"] = Field(
        default="symmetric", description="symmetric: a square grid; asymmetric: every second row is shifted"
    )

    @model_validator(mode="after")
    def _printable(self) -> CircleGridSection:
        if self.columns * self.rows > MOST_DOTS:
            raise ValueError(f"{self.columns} by {self.rows} dots are more than {MOST_DOTS}; leave some out")
        return self


class BoardKeys(Section):
    """A chessboard given by its inner corners; one count is odd and one even, so that it has no symmetry."""

    columns: int = Field(ge=3, le=60, description="inner corners along X")
    rows: int = Field(ge=3, le=60, description="inner corners along Y; one of columns and rows is odd, the other even")
    square_m: Positive = Field(description="side of a square, m")

    @model_validator(mode="after")
    def _no_symmetry(self) -> BoardKeys:
        if (self.columns + self.rows) % 2 == 0:
            raise ValueError(
                f"{self.columns} by {self.rows} inner corners look the same upside down; make one count odd, one even"
            )
        return self


class ChessboardSection(_Print, BoardKeys):
    """A chessboard alone."""

    kind: Literal["chessboard"] = Field(description="a chessboard")


class DiscWithChessboardSection(_Print):
    """A disc with a chessboard beside it on the same sheet."""

    kind: Literal["disc_with_chessboard"] = Field(description="a disc with a chessboard beside it")
    diameter_m: Positive = Field(description="diameter of the disc, m")
    gap_m: Positive = Field(description="distance from the edge of the disc to that of the board, m")
    chessboard: BoardKeys = Field(description="the chessboard")


class CharucoKeys(Section):
    """OpenCV's ChArUco board: `columns` by `rows` squares, with a tag in each white square."""

    columns: int = Field(ge=2, le=60, description="squares along X")
    rows: int = Field(ge=2, le=60, description="squares along Y")
    square_m: Positive = Field(description="side of a square, m")
    tag_m: Positive = Field(description="side of a tag, m")
    family: TagFamily = Field(default="aruco_4x4_50", description="dictionary of the tags")
    first_id: int = Field(default=0, ge=0, description="identifier of the first tag")


class CharucoSection(_Print, CharucoKeys):
    """A ChArUco board alone."""

    kind: Literal["charuco"] = Field(description="OpenCV's ChArUco board")


class DiscWithCharucoSection(_Print):
    """A disc with a ChArUco board beside it on the same sheet."""

    kind: Literal["disc_with_charuco"] = Field(description="a disc with a ChArUco board beside it")
    diameter_m: Positive = Field(description="diameter of the disc, m")
    gap_m: Positive = Field(description="distance from the edge of the disc to that of the board, m")
    charuco: CharucoKeys = Field(description="the ChArUco board")


class TagBoardSection(_Print):
    """A grid of square tags (OpenCV's GridBoard): ArUco or AprilTag by its family; 1 by 1 is a single tag."""

    kind: Literal["tags"] = Field(description="a grid of square tags")
    columns: int = Field(default=1, ge=1, le=60, description="tags along X")
    rows: int = Field(default=1, ge=1, le=60, description="tags along Y")
    tag_m: Positive = Field(description="side of a tag with its black border, m")
    gap_m: NonNegative = Field(default=0.0, description="distance between two tags, m")
    family: TagFamily = Field(default="apriltag_36h11", description="dictionary of the tags")
    first_id: int = Field(default=0, ge=0, description="identifier of the first tag")


class StagSection(_Print):
    """STag's square with a circle of dots in it, from its library HD21."""

    kind: Literal["stag"] = Field(description="STag's square with a circle of dots in it")
    tag_m: Positive = Field(description="side of the square, m")
    id: Identity = Field(default=0, description="identity, 0 to 11")


Marker = Annotated[
    DiscSection
    | DiscWithTickSection
    | RingSection
    | RingsSection
    | CodedRingsSection
    | RingCodeSection
    | DotCodeSection
    | TwoDiscsSection
    | DotRingSection
    | CircleGridSection
    | ChessboardSection
    | DiscWithChessboardSection
    | CharucoSection
    | DiscWithCharucoSection
    | TagBoardSection
    | StagSection,
    Field(discriminator="kind"),
]

KINDS: dict[str, type[Section]] = {
    "disc": DiscSection,
    "disc_with_tick": DiscWithTickSection,
    "ring": RingSection,
    "rings": RingsSection,
    "coded_rings": CodedRingsSection,
    "ring_code": RingCodeSection,
    "dot_code": DotCodeSection,
    "two_discs": TwoDiscsSection,
    "dot_ring": DotRingSection,
    "circle_grid": CircleGridSection,
    "chessboard": ChessboardSection,
    "disc_with_chessboard": DiscWithChessboardSection,
    "charuco": CharucoSection,
    "disc_with_charuco": DiscWithCharucoSection,
    "tags": TagBoardSection,
    "stag": StagSection,
}

# Boards that a study may calibrate its camera from.
CALIBRATION_BOARDS = ("chessboard", "circle_grid")

# Kinds whose first part is a circle.
CIRCULAR = (
    *("disc", "disc_with_tick", "ring", "rings", "coded_rings", "ring_code", "dot_code"),
    *("two_discs", "dot_ring", "disc_with_chessboard", "disc_with_charuco"),
)
