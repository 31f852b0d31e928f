"""Bodies, materials and lights of a world as plain records: what a renderer needs to build it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Colour = tuple[float, float, float]

# Shapes by name: half sizes are along the body's own axes; a cylinder's and a lathe's axis is Z.
SHAPES = ("box", "sphere", "cylinder", "lathe", "tube")


@dataclass(frozen=True)
class Material:
    """How a body reflects.

    Attributes
    ----------
    kind : str
        `matte`, `plastic`, `metal`, `glass`, or a textured one: `wood`, `cardboard`, `plaster`, `brick`, `concrete`,
        `fabric`.
    colour : (r, g, b)
        Linear reflectance; of a texture its mean.
    roughness : float
        GGX alpha of what shines.
    seed : int
        Of the texture.
    """

    kind: str
    colour: Colour
    roughness: float = 0.3
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Body:
    """A solid in the camera frame at time 0.

    Attributes
    ----------
    shape : str
        One of `SHAPES`.
    camera_from_body : (4, 4) array
        A rotation and a shift; the origin is the middle of the bounding box.
    half_m : (3,) array
        Half sides of the bounding box, metres.
    material : Material
    profile : (n, 2) array, optional
        Of a lathe: (radius, z) from bottom to top; of a tube: see `path`.
    path : (n, 3) array, optional
        Of a tube: points along its middle; its radius is `radius_m`.
    radius_m : float
    """

    shape: str
    camera_from_body: Array
    half_m: Array
    material: Material
    profile: Array | None = None
    path: Array | None = None
    radius_m: float = 0.0


@dataclass(frozen=True, eq=False)
class Panel:
    """A flat area light: its pose (Z is where it shines), half sides, radiance and colour."""

    camera_from_panel: Array
    half_m: tuple[float, float]
    radiance: float
    colour: Colour = (1.0, 1.0, 1.0)


@dataclass(frozen=True, eq=False)
class UserScene:
    """A scene of the user's own: its file and where it stands.

    Attributes
    ----------
    file : str
        Relative to the study's folder.
    digest : str
        Of the file and all that it refers to.
    camera_from_scene : (4, 4) array
        A rotation and a shift, of the scene's axes in metres.
    unit_m : float
        Metres in a unit of the file.
    has_lights : bool
        Whether it brings lights of its own; the study's section `light` lights it otherwise.
    """

    file: str
    digest: str
    camera_from_scene: Array
    unit_m: float
    has_lights: bool = False


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture on the wall behind the sheet, repeated in mirror beyond its edges.

    Attributes
    ----------
    folder : str
        Of the pictures, relative to the study's.
    digest : str
        Of all of them.
    index : int
        Of this one, in the sorted list of their names.
    camera_from_picture : (4, 4) array
        Origin at its middle, X to its right, Y up, Z out of the wall.
    width_m : float
    """

    folder: str
    digest: str
    index: int
    camera_from_picture: Array
    width_m: float


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Everything around a sheet.

    Attributes
    ----------
    up : (3,) array
        Against gravity, in the camera frame.
    support : str
        What holds the sheet: `table`, `wall`, `box`, `stand`, `can`, `ground`, or `scene` (the user's own).
    bodies : list of Body
    panels : list of Panel
        Windows and lamps.
    sun : (3,) array or None
        Direction toward the sun, where there is a sky.
    sheet_thickness_m : float
    scene : UserScene or None
    picture : Picture or None
        On the wall behind the sheet.
    camera_from_level : (4, 4) array or None
        The frame that the study's sky and map are given in, X right, Y down, Z forward, where it is not the camera's.
    """

    up: Array
    support: str
    bodies: list[Body] = field(default_factory=list)
    panels: list[Panel] = field(default_factory=list)
    sun: Array | None = None
    sheet_thickness_m: float = 0.0003
    scene: UserScene | None = None
    picture: Picture | None = None
    camera_from_level: Array | None = None

    @property
    def is_lit_by_the_study(self) -> bool:
        """Whether the study's section `light` has the lights."""
        return self.picture is not None or (self.scene is not None and not self.scene.has_lights)


def frame_on(up: Array, turn_rad: float) -> tuple[Array, Array]:
    """Two horizontal unit vectors, the first turned by an angle about `up`."""
    helper = np.array([0.0, 0.0, 1.0]) if abs(up[2]) < 0.8 else np.array([1.0, 0.0, 0.0])
    x = helper - (helper @ up) * up
    x /= np.linalg.norm(x)
    y = np.cross(up, x)
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    return c * x + s * y, -s * x + c * y


def pose_from_axes(x: Array, y: Array, z: Array, origin: Array) -> Array:
    """Pose (4, 4) from three orthonormal axes and an origin."""
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3] = x, y, z, origin
    return pose


def blocks(body: Body, eye: Array, points: Array, margin: float = 1.0) -> NDArray[np.bool_]:
    """Which segments from `eye` (3,) to `points` (n, 3) meet a body's bounding box, enlarged by a factor `margin`."""
    rotation, origin = body.camera_from_body[:3, :3], body.camera_from_body[:3, 3]
    start, ends = (eye - origin) @ rotation, (points - origin) @ rotation
    half = body.half_m * margin
    direction = ends - start
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (-half - start) / direction, (half - start) / direction
    near, far = np.fmax.reduce(np.fmin(a, b), axis=1), np.fmin.reduce(np.fmax(a, b), axis=1)
    # A segment parallel to a pair of faces and outside them has no finite crossing.
    outside = ((direction == 0) & (np.abs(start) > half)).any(axis=1)
    return np.asarray((near < far) & (far > 0) & (near < 1) & ~outside)
