"""The plug-in interface for third-party methods: `View` in, `Found` out, and its checks (docs/your-own-method.md).

A method is a callable `find(view)` that returns a list of `Found`. It gets the data available to a solver: the image, a
camera, and the printed markers. The smallest example finds centres only:

    import cv2
    from roundel.solver.methods.plugin import Found, View

    def find(view: View) -> list[Found]:
        '''Centres by OpenCV's blob detector.'''
        detector = cv2.SimpleBlobDetector_create()
        return [Found(centre_px=point.pt) for point in detector.detect(view.grey)]
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.camera.model import Camera, camera_problem
from roundel.scenes.camera.response_curve import UNKNOWN, ResponseCurve
from roundel.scenes.errors import first_line
from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic
from roundel.scenes.geometry.pose import camera_from_marker_of

Array = NDArray[np.float64]

UNIT_TOLERANCE = 1e-6
# A circle whose image is smaller than this cannot have been detected: its pose must be in other units.
LEAST_SEMI_AXIS_PX = 0.25


@dataclass(frozen=True, eq=False)
class View:
    """The data of a frame that a method gets. Every call gets its own copy.

    Attributes
    ----------
    image : (H, W) or (H, W, 3) array
        uint8 or uint16, as delivered by the camera: RGB, with lens distortion and the sensor's response curve.
    camera : Camera
        The intrinsics given by `--intrinsics`: `K`, `distortion`, `distortion_model`, `width_px`, `height_px`. With
        `default` or `scaled:0.7` they differ from the true intrinsics.
    diameter_m : float
        Outer diameter of the printed circle.
    markers : list of dict
        The printed markers: `marker_id`, `kind`, `diameter_m`, `layout`; without poses.
    saturation_dn : float
        The level at which pixels saturate.
    curve : ResponseCurve
        The curve of the image's levels, as far as it is known; `curve.light(image / 255)` undoes it. `unknown` if
        nothing tells.
    focal_sigma : float
        Standard deviation of the camera's focal length, as a fraction of it; 0 if it is exact.
    companions : callable
        Returns the views of other images by the same camera, for methods that need several; an empty list if there are
        none. It reads and decodes them when it is called.
    """

    image: NDArray[Any]
    camera: Camera
    diameter_m: float
    markers: list[dict[str, Any]] = field(default_factory=list)
    saturation_dn: float = 255.0
    curve: ResponseCurve = UNKNOWN
    focal_sigma: float = 0.0
    companions: Callable[[], list[View]] = list

    @property
    def grey(self) -> NDArray[np.uint8]:
        """The image as (H, W) uint8 with averaged colours, as OpenCV's detectors need it."""
        levels = self.image if self.image.ndim == 2 else self.image[..., :3].mean(axis=-1)
        if levels.dtype == np.uint8:
            return np.ascontiguousarray(levels)
        return np.rint(np.clip(levels * (255.0 / self.saturation_dn), 0, 255)).astype(np.uint8)


class MethodFailure(ValueError):
    """Why a method has no answer for a frame, in one sentence: a marker that it cannot read, too few circles."""


@dataclass(frozen=True, eq=False)
class Found:
    """One detection, with at least one of pose, ellipse and centre, or the reason why it has none.

    Attributes
    ----------
    poses : sequence of (normal, centre_m)
        Zero, one or both of the two candidates. `normal`: unit vector out of the printed face, toward the camera, in
        OpenCV's camera frame (x right, y down, z forward); `centre_m`: the circle's centre in that frame, in metres.
    ellipse : (5,) array_like, optional
        x_px, y_px, a_px, b_px, angle_deg of the circle's image: semi-axes a >= b, the angle from +x toward +y. In
        undistorted pixel coordinates of `view.camera`. Without poses, both are computed from it.
    centre_px : (2,) array_like, optional
        Image of the circle's centre in the delivered image. Pixel (0, 0) is the centre of the top-left pixel.
    chosen : int, optional
        Index of the pose that the method chooses; a single pose is always chosen.
    confidence : float, optional
        0 to 1.
    identity : int, optional
        The identity that the marker's code says.
    focal_px, focal_sigma_px : float, optional
        Focal length measured from this image alone, without the camera's, and its standard deviation.
    camera : Camera, optional
        The camera with which `poses` and `ellipse` were computed, if it is not `view.camera`.
    failure : str
        Why this detection has no answer; nothing else is then read.
    """

    poses: Sequence[tuple[ArrayLike, ArrayLike]] = ()
    ellipse: ArrayLike | None = None
    centre_px: ArrayLike | None = None
    chosen: int | None = None
    confidence: float | None = None
    identity: int | None = None
    focal_px: float | None = None
    focal_sigma_px: float | None = None
    camera: Camera | None = None
    failure: str = ""


Finder = Callable[[View], Sequence[Found]]


@dataclass(frozen=True, eq=False)
class Checked:
    """A checked detection: float64 arrays, candidates in the order of the conventions."""

    normal: Array | None
    centre_m: Array | None
    ellipse: Array | None
    centre_px: Array | None
    chosen: int | None
    confidence: float | None
    identity: int | None
    focal_px: float | None
    focal_sigma_px: float | None
    camera: Camera


def check_found(found: object, view: View) -> Checked:
    """Check one detection of a method.

    Raises
    ------
    ValueError
        If it is invalid; the message is one clause with the reason.
    """
    if not isinstance(found, Found):
        raise ValueError(f"it is a {type(found).__name__}, not a roundel.solver.methods.plugin.Found")
    if found.failure:
        raise MethodFailure(found.failure)
    ellipse = None if found.ellipse is None else _numbers("ellipse", found.ellipse, 5)
    if ellipse is not None and not ellipse[2] >= ellipse[3] > 0:
        raise ValueError(
            f"its ellipse has semi-axes a = {ellipse[2]:.6g}, b = {ellipse[3]:.6g} px; a >= b > 0 is needed"
        )
    centre_px = None if found.centre_px is None else _numbers("centre_px", found.centre_px, 2)
    camera = _camera(found, view)
    normal, centre, chosen = _poses(found, view, camera)
    if normal is None and ellipse is None and centre_px is None:
        raise ValueError("it has neither a pose nor an ellipse nor a centre")
    confidence = None if found.confidence is None else float(_numbers("confidence", [found.confidence], 1)[0])
    if confidence is not None and not 0 <= confidence <= 1:
        raise ValueError(f"its confidence is {confidence:g}; it must be from 0 to 1")
    identity = None if found.identity is None else int(_numbers("identity", [found.identity], 1)[0])
    focal = _focal(found)
    return Checked(normal, centre, ellipse, centre_px, chosen, confidence, identity, *focal, camera)


def _camera(found: Found, view: View) -> Camera:
    if found.camera is None:
        return view.camera
    if not isinstance(found.camera, Camera):
        raise ValueError(f"its camera is a {type(found.camera).__name__}, not a roundel.Camera")
    problem = camera_problem(found.camera)
    if problem:
        raise ValueError(f"its camera is invalid: {problem}")
    return found.camera


def _focal(found: Found) -> tuple[float | None, float | None]:
    if found.focal_px is None:
        return None, None
    focal = float(_numbers("focal_px", [found.focal_px], 1)[0])
    if focal <= 0:
        raise ValueError(f"its focal length is {focal:.6g} px; it must be positive")
    if found.focal_sigma_px is None:
        return focal, None
    sigma = float(_numbers("focal_sigma_px", [found.focal_sigma_px], 1)[0])
    if sigma < 0:
        raise ValueError(f"the standard deviation of its focal length is negative: {sigma:.6g} px")
    return focal, sigma


def _numbers(name: str, value: ArrayLike, count: int) -> Array:
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"its {name} must be {count} numbers: {first_line(error)}") from error
    if array.shape != (count,):
        raise ValueError(f"its {name} has shape {array.shape}, not ({count},)")
    if not np.all(np.isfinite(array)):
        raise ValueError(f"its {name} is not finite: {array.tolist()}")
    return array


def _poses(found: Found, view: View, camera: Camera) -> tuple[Array | None, Array | None, int | None]:
    try:
        pairs = [(_numbers("normal", n, 3), _numbers("centre_m", c, 3)) for n, c in found.poses]
    except TypeError as error:
        raise ValueError(f"its poses are not pairs (normal, centre_m): {first_line(error)}") from error
    if len(pairs) > 2:
        raise ValueError(f"it has {len(pairs)} poses; a circle has at most two")
    if found.chosen is not None and found.chosen not in range(len(pairs)):
        raise ValueError(f"chosen is {found.chosen!r}, but it has {len(pairs)} poses")
    if not pairs:
        return None, None, None
    for normal, centre in pairs:
        length = float(np.linalg.norm(normal))
        if abs(length - 1) > UNIT_TOLERANCE:
            raise ValueError(f"its normal has length {length:.7g}; give a unit vector")
        if centre[2] <= 0:
            raise ValueError(f"its centre is behind the camera (z = {centre[2]:.6g} m)")
        if normal @ centre >= 0:
            raise ValueError("its normal points away from the camera; it must point out of the printed face")
        seen = semi_axis_px(normal, centre, view.diameter_m, camera)
        if seen < LEAST_SEMI_AXIS_PX:
            raise ValueError(
                f"a circle of {view.diameter_m:g} m at {np.linalg.norm(centre):.4g} m would be {2 * seen:.2g} px wide; "
                "is its centre in metres?"
            )
    # Order of the conventions: closer to fronto-parallel first; at a tie, the larger normal_x.
    order = sorted(range(len(pairs)), key=lambda i: (pairs[i][0][2], -pairs[i][0][0]))
    meant = 0 if len(pairs) == 1 else found.chosen
    normals, centres = (np.stack([pairs[i][part] for i in order]) for part in (0, 1))
    return normals, centres, None if meant is None else order.index(meant)


def semi_axis_px(normal: Array, centre_m: Array, diameter_m: float, camera: Camera) -> float:
    """Semi-major axis of the image of a circle; infinite if it is not an ellipse (partly behind the camera)."""
    try:
        pose = camera_from_marker_of(normal, centre_m)
        return float(ellipse_of_conic(conic_of_circle(pose, diameter_m / 2, camera.K))[2])
    except ValueError:
        return float("inf")
