"""A known print tells which of the two poses of a circle is the true one.

Source: A. Pagani, J. Koehler, D. Stricker, Circular markers for camera pose estimation, WIAMIS (2011). The image inside
the circle is rectified with both poses; each is compared with the expected print over all rotations in the plane; the
nearer one is the pose. Here the rectified image is polar, so that all rotations are one circular correlation. The
expected print is what the layout of the printed marker says; for `ring_code` all profiles of the bank are expected, and
the best one is the identity.

At low tilt both poses, and both rectified images, are nearly the same, and the method says that it cannot tell: it
returns both poses and chooses none. The criterion is the log-likelihood of the residuals with as many independent
values as there are pixels inside the circle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import distort_px
from roundel.scenes.geometry.pose import camera_from_marker_of
from roundel.scenes.markers.ink_pattern import coverage
from roundel.scenes.markers.marker import Bar, Disc, Sectors, Shape
from roundel.scenes.markers.ring_codes import ring_code_radii, ring_code_widths
from roundel.solver.methods.plugin import Found, MethodFailure, View
from roundel.solver.pose.circle_pose import poses_from_ellipse
from roundel.solver.views.circles_of_view import CircleImage, circles_of_view
from roundel.solver.views.marker_pixels import LightImage, light_image

Array = NDArray[np.float64]

KINDS = ("ring", "rings", "ring_code", "coded_rings", "disc_with_tick")

_RINGS, _TURNS, _FINE = 28, 240, 4
_INNER, _OUTER = 0.04, 1.06  # of the compared ring of the plane, outer radii
_LEAST_CONFIDENCE = 0.2
_LEAST_CORRELATION = 0.7
_DECISIVE = 5.0  # log-likelihood: odds of 150
# The residual of the next identity over that of the right one, logarithm: at least 1.7 on 289 rendered frames. Where
# another identity was read instead, at high tilt, it was 0.44 to 0.84.
_DISTINCT = 1.2
# The true pose leaves a residual, too, of resampling and blur: a difference of less than a twentieth of it is nothing.
_DIFFERENT = math.log(1.05)


@dataclass(frozen=True, eq=False)
class Expected:
    """An expected print: ink on the polar grid, (rings, turns) in [0, 1], and the identity that it stands for."""

    ink: Array
    identity: int | None


@dataclass(frozen=True, eq=False)
class Comparison:
    """A pose against the expected prints.

    Attributes
    ----------
    expected : Expected
        The nearest one.
    correlation : float
        Of the rectified image with it, at the best rotation.
    next_best : float
        Of the rectified image with the nearest print of another identity; -1 if there is none.
    turn_deg : float
        The rotation in the plane, X toward Y.
    """

    expected: Expected
    correlation: float
    next_best: float
    turn_deg: float


def polar_grid(fine: int = 1) -> tuple[Array, Array]:
    """Radii (rings * fine,) in outer radii, and angles (turns,) in radians, of the compared points."""
    count = _RINGS * fine
    radius = _INNER + (_OUTER - _INNER) * (np.arange(count) + 0.5) / count
    return radius, 2 * np.pi * np.arange(_TURNS) / _TURNS


def expected_prints(view: View) -> list[Expected]:
    """What may be printed, by the layout of the view's markers.

    Raises
    ------
    MethodFailure
        If nothing inside the circle tells two poses apart, or nothing is said of the print.
    """
    for marker in view.markers:
        kind, layout = str(marker["kind"]), marker.get("layout") or {}
        if kind == "ring_code":
            return [_print(_rings(ring_code_radii(i)), i) for i in range(len(ring_code_widths()))]
        shapes = _shapes(kind, layout, float(marker["diameter_m"] or 0.0) / 2)
        if shapes:
            return [_print(shapes, None)]
    printed = ", ".join(sorted({str(marker["kind"]) for marker in view.markers})) or "not described"
    raise MethodFailure(
        f"it reads {', '.join(KINDS)}; the printed marker is {printed}, with no print inside its circle"
    )


def _rings(radii: tuple[float, ...]) -> list[tuple[Shape, float]]:
    return [(Disc(0.0, 0.0, r, 0.0), float(i % 2 == 0)) for i, r in enumerate(radii)]


def _shapes(kind: str, layout: dict[str, Any], radius_m: float) -> list[tuple[Shape, float]]:
    """Shapes in painting order, in outer radii, with 1 for ink and 0 for paper; empty if there are none to compare."""
    if kind == "ring":
        return _rings((1.0, layout["inner_diameter_m"] / 2 / radius_m))
    if kind == "rings":
        return _rings(tuple(d / 2 / radius_m for d in layout["diameters_m"]))
    if kind == "disc" and "tick_from_m" in layout:
        start, end, width = (layout[f"tick_{k}_m"] / radius_m for k in ("from", "to", "width"))
        return [*_rings((1.0,)), (Bar((start + end) / 2, 0.0, end - start, width, 0.0, 0.0), 0.0)]
    if kind == "coded_rings":
        code = layout["code"]
        cells = bytes(int(bit) for row in code for bit in row)
        sectors = Sectors(0.0, 0.0, layout["code_from"], layout["code_to"], len(code), len(code[0]), cells, 0.0)
        return [*_rings((1.0, layout["ring_from"])), (sectors, 1.0), (Disc(0.0, 0.0, layout["disc"], 0.0), 1.0)]
    return []


def _print(shapes: list[tuple[Shape, float]], identity: int | None) -> Expected:
    radius, angle = polar_grid(_FINE)
    # Marker frame: X right, Y up, angles from +X toward +Y.
    x, y = np.outer(radius, np.cos(angle)), np.outer(radius, np.sin(angle))
    ink = np.zeros_like(x)
    for shape, level in shapes:
        cover = coverage(shape, x, y)
        ink = (1 - cover) * ink + cover * level
    return Expected(ink.reshape(_RINGS, _FINE, _TURNS).mean(axis=1), identity)


def rectified(image: LightImage, normal: Array, centre: Array, K: Array) -> Array | None:
    """The image on the polar grid of a pose's plane, (rings, turns); None if it reaches beyond the image.

    Parameters
    ----------
    image : LightImage
    normal, centre : (3,) arrays
        In outer radii.
    K : (3, 3) array
    """
    pose = camera_from_marker_of(normal, centre)
    radius, angle = polar_grid()
    plane = np.stack([np.outer(radius, np.cos(angle)), np.outer(radius, np.sin(angle))], axis=-1)
    points = plane @ pose[:3, :2].T + pose[:3, 3]
    rays = points @ np.asarray(K, dtype=np.float64).T
    levels = image.at(rays[..., :2] / rays[..., 2:])
    return levels if bool(np.all(np.isfinite(levels))) else None


def compared(levels: Array, prints: list[Expected], blur: float) -> Comparison:
    """The best print and rotation for a rectified image, by the correlation weighted with the area.

    Parameters
    ----------
    levels : (rings, turns) array
    prints : list of Expected
    blur : float
        Standard deviation of the image's blur in the plane, outer radii: prints are blurred by it along the radius.
    """
    radius, _ = polar_grid()
    weight = np.repeat(radius[:, None], _TURNS, axis=1)
    weight = weight / weight.sum()

    def normalised(values: Array) -> Array:
        centred = values - np.sum(weight * values)
        return np.asarray(centred / math.sqrt(max(float(np.sum(weight * centred**2)), 1e-12)))

    step = radius[1] - radius[0]
    smooth = np.exp(-0.5 * ((radius[:, None] - radius[None]) / max(blur, 0.3 * step)) ** 2)
    smooth = smooth / smooth.sum(axis=1, keepdims=True)
    # Ink is dark on paper or light on dark: the sign of a correlation is not compared.
    seen = np.fft.rfft(weight * normalised(levels), axis=1)
    found: list[tuple[float, int, Expected]] = []
    for one in prints:
        asked = np.fft.rfft(normalised(smooth @ one.ink), axis=1)
        by_turn = np.fft.irfft((seen * np.conj(asked)).sum(axis=0), n=_TURNS)
        turn = int(np.argmax(np.abs(by_turn)))
        found.append((float(abs(by_turn[turn])), turn, one))
    found.sort(key=lambda entry: -entry[0])
    correlation, turn, best = found[0]
    return Comparison(best, correlation, found[1][0] if len(found) > 1 else -1.0, 360.0 * turn / _TURNS)


def decides(better: float, worse: float) -> bool:
    """Whether two correlations with the prints of two identities tell which of them is there."""
    return math.log(max(1 - worse**2, 1e-9) / max(1 - better**2, 1e-9)) > _DISTINCT


def _log_odds(better: float, worse: float, count: float) -> float:
    """Log-likelihood ratio of two correlations with a print: residuals are 1 - correlation^2."""
    ratio = math.log(max(1 - worse**2, 1e-9) / max(1 - better**2, 1e-9))
    return 0.5 * count * ratio if ratio > _DIFFERENT else 0.0


def choose_pose(image: LightImage, circle: CircleImage, view: View, prints: list[Expected]) -> Found | str:
    """The pose of one circle by the print inside it, both if they cannot be told apart, or why it is not there."""
    radius_m = view.diameter_m / 2
    poses = poses_from_ellipse(circle.ellipse, view.camera.K, 1.0)
    blur_px = float(getattr(circle.fit, "blur_px", 0.6))
    # A blur of the image is wider in the plane along the minor axis: between the two.
    blur = math.hypot(blur_px, 0.4) / math.sqrt(float(circle.ellipse[2] * circle.ellipse[3]))
    levels = [rectified(image, poses.normal[i], poses.centre_m[i], view.camera.K) for i in range(2)]
    found = [compared(one, prints, blur) for one in levels if one is not None]
    if len(found) < 2:
        return "a circle reaches beyond the image"
    first = 0 if found[0].correlation >= found[1].correlation else 1
    best, other = found[first], found[1 - first]
    if best.correlation < _LEAST_CORRELATION:
        return f"the print inside a circle is not the expected one (correlation {best.correlation:.2f})"
    count = math.pi * float(circle.ellipse[2] * circle.ellipse[3])
    if best.next_best >= 0 and not decides(best.correlation, best.next_best):
        return "the print inside a circle does not decide between two identities"
    told = _log_odds(best.correlation, other.correlation, count) > _DECISIVE
    pairs = [(poses.normal[i], poses.centre_m[i] * radius_m) for i in range(2)]
    centre = poses.centre_m[first] if told else poses.centre_m.mean(axis=0)
    ray = view.camera.K @ centre
    return Found(
        poses=[pairs[first]] if told else pairs,
        ellipse=circle.ellipse,
        centre_px=distort_px(view.camera, ray[:2] / ray[2]),
        chosen=0 if told else None,
        confidence=min(circle.confidence, best.correlation),
        identity=best.expected.identity,
    )


def find(view: View) -> list[Found]:
    """Poses of circles with a known print: one where the print tells, both where it cannot.

    Raises
    ------
    MethodFailure
        If the printed marker has no print inside its circle, or no circle shows the expected one.
    """
    prints = expected_prints(view)
    image = light_image(view)
    circles = circles_of_view(view, least_confidence=_LEAST_CONFIDENCE)
    answers = [choose_pose(image, circle, view, prints) for circle in circles]
    out = [one for one in answers if isinstance(one, Found)]
    reasons = [one for one in answers if isinstance(one, str)]
    if reasons and not out:
        raise MethodFailure(f"no known print is read: {reasons[0]}")
    return out
