"""Draw estimates on a photograph: contour, centre, both normals, and the distance with its standard deviation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera, distort_px, project
from roundel.scenes.geometry.conic import circle_points_m, ellipse_points
from roundel.scenes.geometry.pose import camera_from_marker_of, tilt_azimuth_deg
from roundel.solver.estimates import Estimate

if TYPE_CHECKING:
    from PIL import Image, ImageDraw, ImageFont

Array = NDArray[np.float64]
Colour = tuple[int, int, int]
Box = tuple[float, float, float, float]

CONTOUR: Colour = (0, 224, 190)
CANDIDATES: tuple[Colour, Colour] = ((255, 166, 43), (108, 178, 255))
FAILED: Colour = (255, 92, 92)
_WHITE: Colour = (255, 255, 255)
_HALO: Colour = (16, 20, 26)
_PANEL_OPACITY = 195

# Small images are enlarged to fit the text, large ones reduced so that viewers load them quickly.
_SMALLEST_PX, _LARGEST_PX = 960, 3200
_SHIFT = 4  # OpenCV draws on a grid of 1/16 px
_LABELLED = 12  # further circles in an image only have their number


@dataclass(frozen=True, eq=False)
class Drawn:
    """One detection to draw: its estimate, the circle's diameter, and the first and the last lines of its label.

    Without a name, several detections are numbered.
    """

    estimate: Estimate
    diameter_m: float
    label: str
    name: str = ""
    notes: tuple[str, ...] = ()


@dataclass
class _Canvas:
    """The scaled picture, its scale, and the unit of line widths and text: a thousandth of its side."""

    pixels: NDArray[np.uint8]
    scale: float
    taken: list[Box] = field(default_factory=list)

    @property
    def unit(self) -> float:
        return float(max(self.pixels.shape[:2])) / 1000.0

    def at(self, points_px: Array) -> Array:
        """Position of image pixels on the canvas; pixel centres are integers in both."""
        return np.asarray((points_px + 0.5) * self.scale - 0.5)

    def line(self, points: Array, colour: Colour, width: float, closed: bool = False) -> None:
        """A line with a dark outline, so that it is visible on white and on black."""
        fixed = [np.rint(points * 2**_SHIFT).astype(np.int32).reshape(-1, 1, 2)]
        for tone, thickness in ((_HALO, width + 2 * self.unit), (colour, width)):
            cv2.polylines(self.pixels, fixed, closed, tone, max(1, round(thickness)), cv2.LINE_AA, _SHIFT)

    def dot(self, point: Array, colour: Colour, radius: float) -> None:
        x, y = (int(v) for v in np.rint(point * 2**_SHIFT))
        for tone, r in ((_HALO, radius + self.unit), (colour, radius)):
            cv2.circle(self.pixels, (x, y), max(1, round(r * 2**_SHIFT)), tone, -1, cv2.LINE_AA, _SHIFT)


def draw_overlay(picture: NDArray[np.uint8], drawn: Sequence[Drawn], footer: str) -> NDArray[np.uint8]:
    """Draw estimates on a picture.

    Each has its contour, the image of its centre, an arrow along each candidate's normal (thin if the other one was
    chosen) and a label; the footer states the basis of the numbers.

    Parameters
    ----------
    picture : (H, W, 3) uint8 array
        RGB.
    drawn : sequence of Drawn
        The strongest first.
    footer : str

    Returns
    -------
    (h, w, 3) uint8 array
        RGB: enlarged by an integer factor below 960 px, reduced above 3,200 px, with a strip for the footer.
    """
    canvas = _canvas(picture)
    for one in reversed(drawn):
        _draw_pose(canvas, one)
    return _lettered(canvas, drawn, footer.replace("+-", "±"))


def _canvas(picture: NDArray[np.uint8]) -> _Canvas:
    height, width = picture.shape[:2]
    side = max(height, width)
    if side < _SMALLEST_PX:
        factor = -(-_SMALLEST_PX // side)
        # Enlarged without smoothing, to show the measured pixels.
        return _Canvas(np.ascontiguousarray(picture.repeat(factor, axis=0).repeat(factor, axis=1)), float(factor))
    scale = min(1.0, _LARGEST_PX / side)
    if scale == 1.0:
        return _Canvas(np.array(picture), 1.0)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    return _Canvas(np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.uint8), scale)


def _contour(canvas: _Canvas, one: Drawn) -> Array | None:
    """The circle's outline: from its ellipse, or else from its chosen or first pose."""
    estimate, camera = one.estimate, one.estimate.camera
    if camera is None:
        return None
    if estimate.ellipse is not None:
        points = canvas.at(distort_px(camera, ellipse_points(estimate.ellipse, 256)))
    elif estimate.normal is not None and estimate.centre_m is not None:
        first = estimate.chosen or 0
        pose = camera_from_marker_of(estimate.normal[first], estimate.centre_m[first])
        points = canvas.at(project(camera, circle_points_m(pose, one.diameter_m / 2, 256)))
    else:
        return None
    return points if _visible(points) else None


def _centre(canvas: _Canvas, estimate: Estimate) -> Array | None:
    """The image of the centre, if the method gives it."""
    point = None if estimate.centre_image is None else canvas.at(estimate.centre_image)
    return point if point is not None and _visible(point) else None


def _visible(points: Array) -> bool:
    return bool(np.all(np.isfinite(points)) and np.max(np.abs(points)) < 1e6)


def _draw_pose(canvas: _Canvas, one: Drawn) -> None:
    estimate, unit = one.estimate, canvas.unit
    contour, point = _contour(canvas, one), _centre(canvas, estimate)
    if contour is not None:
        canvas.line(contour, CONTOUR if estimate else FAILED, 2.0 * unit, closed=True)
    if point is not None:
        canvas.dot(point, CONTOUR, 3.0 * unit)
    if estimate.normal is None or estimate.centre_m is None or estimate.camera is None:
        return
    first = 0 if estimate.chosen is None else estimate.chosen
    last_drawn = [candidate for candidate in range(len(estimate.normal)) if candidate != first] + [first]
    for candidate in last_drawn:
        width = 3.2 * unit if estimate.chosen in (None, candidate) else 1.4 * unit
        _arrow(canvas, estimate, candidate, one.diameter_m, width)
    # The candidates' centres differ by some hundredths of a diameter, which is visible on a near marker.
    for candidate in last_drawn:
        centre = canvas.at(project(estimate.camera, estimate.centre_m[candidate]))
        if _visible(centre):
            canvas.dot(centre, _WHITE, (3.0 if candidate == first else 2.2) * unit)


def _arrow(canvas: _Canvas, estimate: Estimate, candidate: int, diameter_m: float, width: float) -> None:
    """The normal, one diameter long; longer on a small marker, so that its direction is visible."""
    assert estimate.normal is not None
    assert estimate.centre_m is not None
    assert estimate.camera is not None
    camera: Camera = estimate.camera
    centre, normal = estimate.centre_m[candidate], estimate.normal[candidate]
    diameter_px = canvas.scale * float(camera.K[0, 0]) * diameter_m / float(np.linalg.norm(centre))
    length_m = diameter_m * max(0.9, 80.0 * canvas.unit / max(diameter_px, 1e-6))
    # At most half the distance to the camera; a longer arrow would leave the picture.
    length_m = min(length_m, 0.5 * float(np.linalg.norm(centre)))
    start, tip = canvas.at(project(camera, np.stack([centre, centre + length_m * normal])))
    if not _visible(np.stack([start, tip])):
        return
    along = tip - start
    length = float(np.linalg.norm(along))
    if length < 2.0 * width:
        return  # it points at the camera and is represented by the centre's dot
    along /= length
    head = min(5.0 * width, 0.5 * length)
    across = np.array([-along[1], along[0]])
    base = tip - head * along
    canvas.taken.append(_bounds(np.stack([start, tip])))
    canvas.line(np.stack([start, base]), CANDIDATES[candidate], width)
    triangle = np.stack([tip, base + 0.5 * head * across, base - 0.5 * head * across])
    fixed = np.rint(triangle * 2**_SHIFT).astype(np.int32)
    cv2.polylines(
        canvas.pixels, [fixed], True, _HALO, max(1, round(width * 0.5 + 2 * canvas.unit)), cv2.LINE_AA, _SHIFT
    )
    cv2.fillConvexPoly(canvas.pixels, fixed, CANDIDATES[candidate], cv2.LINE_AA, _SHIFT)


def _lettered(canvas: _Canvas, drawn: Sequence[Drawn], footer: str) -> NDArray[np.uint8]:
    from PIL import Image, ImageDraw, ImageFont

    unit = canvas.unit
    size = max(11.0, 19.0 * unit)
    font = ImageFont.load_default(size)
    image = Image.fromarray(canvas.pixels)
    draw = ImageDraw.Draw(image)
    boxes = [_box(canvas, one) for one in drawn]
    canvas.taken += [box for box in boxes if box is not None]
    for number, (one, box) in enumerate(zip(drawn, boxes, strict=True)):
        if box is not None:
            name = one.name or (f"#{number}" if len(drawn) > 1 else "")
            _panel(canvas, image, font, box, _label(one, name) if number < _LABELLED else [(name, _WHITE)])
    lines_of_footer = _wrapped(draw, font, footer, image.width - 2 * size)
    strip = round(1.35 * size * len(lines_of_footer) + size)
    whole = Image.new("RGB", (image.width, image.height + strip), _HALO)
    whole.paste(image, (0, 0))
    below = ImageDraw.Draw(whole)
    for i, line in enumerate(lines_of_footer):
        below.text((size, image.height + 0.4 * size + 1.35 * size * i), line, font=font, fill=(214, 220, 228))
    return np.array(whole)


def _box(canvas: _Canvas, one: Drawn) -> Box | None:
    """The box that a label must not cover: the contour, or only the centre."""
    contour, point = _contour(canvas, one), _centre(canvas, one.estimate)
    if contour is not None:
        return _bounds(contour)
    return None if point is None else _bounds(np.stack([point - 8 * canvas.unit, point + 8 * canvas.unit]))


def _label(one: Drawn, name: str) -> list[tuple[str, Colour]]:
    estimate, title = one.estimate, f"{name}  {one.label}".strip()
    if not estimate:
        return [(title, FAILED)]
    lines = [(title, _WHITE)]
    if estimate.normal is None:
        return lines
    for candidate, tilt in enumerate(tilt_azimuth_deg(estimate.normal)[0]):
        percent = "" if estimate.probability is None else f"  {100 * estimate.probability[candidate]:.0f} %"
        chosen = ", chosen" if estimate.chosen == candidate and len(estimate.normal) > 1 else ""
        lines.append((f"tilt {tilt:.1f}°{percent}{chosen}", CANDIDATES[candidate]))
    return lines + [(note, _WHITE) for note in one.notes]


def _bounds(points: Array) -> Box:
    low, high = points.min(axis=0), points.max(axis=0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _panel(
    canvas: _Canvas,
    image: Image.Image,
    font: ImageFont.FreeTypeFont | ImageFont.ImageFont,
    box: Box,
    lines: list[tuple[str, Colour]],
) -> None:
    """Text on a dark panel beside a box, if possible where it covers neither a marker nor another panel."""
    from PIL import Image, ImageDraw

    draw = ImageDraw.Draw(image)
    size = max(11.0, 19.0 * canvas.unit)
    width = max(draw.textlength(text, font=font) for text, _ in lines) + 1.2 * size
    height = 1.3 * size * len(lines) + 0.8 * size
    limit_x, limit_y = image.width - width - 2, image.height - height - 2
    (x0, y0, x1, y1), middle = box, ((box[0] + box[2]) / 2, (box[1] + box[3]) / 2)

    def cost(place: tuple[float, float]) -> float:
        x, y = place
        outside = max(-x, 0) + max(x - limit_x, 0) + max(-y, 0) + max(y - limit_y, 0)
        away = math.hypot(x + width / 2 - middle[0], y + height / 2 - middle[1])
        hidden = sum(_overlap((x, y, x + width, y + height), other) for other in canvas.taken)
        return float(outside * size + hidden + 0.05 * size * away)

    places = []
    for gap in (size, 3 * size, 6 * size, 10 * size):
        left, right, above, below = x0 - gap - width, x1 + gap, y0 - gap - height, y1 + gap
        centred = middle[0] - width / 2, middle[1] - height / 2
        places += [(right, centred[1]), (left, centred[1]), (centred[0], below), (centred[0], above)]
        places += [(right, above), (right, below), (left, below), (left, above)]
    x, y = min(places, key=cost)
    x, y = round(min(max(x, 2), max(limit_x, 2))), round(min(max(y, 2), max(limit_y, 2)))
    canvas.taken.append((x, y, x + width, y + height))
    panel = Image.new("L", (math.ceil(width), math.ceil(height)))
    ImageDraw.Draw(panel).rounded_rectangle((0, 0, panel.width - 1, panel.height - 1), 0.45 * size, _PANEL_OPACITY)
    image.paste(_HALO, (x, y), panel)
    for i, (text, colour) in enumerate(lines):
        draw.text((x + 0.6 * size, y + 0.3 * size + 1.3 * size * i), text, font=font, fill=colour)


def _overlap(one: Box, other: Box) -> float:
    width = min(one[2], other[2]) - max(one[0], other[0])
    height = min(one[3], other[3]) - max(one[1], other[1])
    return width * height if width > 0 and height > 0 else 0.0


def _wrapped(
    draw: ImageDraw.ImageDraw, font: ImageFont.FreeTypeFont | ImageFont.ImageFont, text: str, width: float
) -> list[str]:
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and draw.textlength(longer, font=font) > width:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines
