"""The page of a calibration from photographs: no script, nothing from a network."""

from __future__ import annotations

import base64
import io
from importlib import resources
from typing import Any

import numpy as np

from roundel.datasets.environment import versions
from roundel.scenes.display_text import NAME_LIMIT, TEXT_LIMIT, clean
from roundel.validate.photo_calibration.figures import coverage_picture, residual_picture
from roundel.validate.photo_calibration.next_photo import uncertainty_px
from roundel.validate.photo_calibration.record import BoardPhoto, Fitted, PhotoCalibration
from roundel.validate.photo_calibration.summary import next_lines, odd_photos, warnings
from roundel.validate.report.html import figures, template

_HERE = "roundel.validate.photo_calibration"
_MEANINGS = {
    "fx": "focal length along x: a displacement of {border:.2g} px at the right border of the image",
    "fy": "focal length along y: a displacement of {border:.2g} px at the lower border of the image",
    "cx": "principal point, from the left",
    "cy": "principal point, from the top",
    "k1": "lens, radial: bends straight lines, barrel (below 0) or pincushion (above 0)",
    "k2": "lens, radial, of fourth order: acts near the corners, together with k1",
    "p1": "lens, tangential: a decentred element, along y",
    "p2": "lens, tangential: a decentred element, along x",
    "k3": "lens, radial, of sixth order",
}


def calibration_page(found: PhotoCalibration, file: str) -> bytes:
    """The page.

    Parameters
    ----------
    found : PhotoCalibration
    file : str
        Name of the camera file.
    """
    from markupsafe import Markup

    report, own = (
        (resources.files(package) / name).read_text(encoding="utf-8")
        for package, name in (("roundel.validate.report", "report.css"), (_HERE, "calibration.css"))
    )
    odd = {photo.name for photo in odd_photos(found)}
    shown = found.shown
    pictures = [coverage_picture(found)] if shown else []
    pictures += [residual_picture(found)] if found.fitted is not None else []
    page = template(_HERE, "calibration.html.j2").render(
        css=Markup(report + own),
        name=clean(file.rpartition(".")[0] or file, NAME_LIMIT),
        file=clean(file, NAME_LIMIT),
        used=len(found.used),
        size=found.size_px if any(found.size_px) else None,
        board=clean(found.board.title, TEXT_LIMIT),
        problem=clean(found.problem, TEXT_LIMIT),
        warnings=[clean(line, TEXT_LIMIT) for line in warnings(found)],
        next=[clean(line[:1].upper() + line[1:] + ".", TEXT_LIMIT) for line in next_lines(found)],
        cards=[] if found.fitted is None else _cards(found, found.fitted),
        parameters=[] if found.fitted is None else _parameters(found.fitted),
        pictures=figures(pictures),
        # Those that were not used come first: they are what the reader can do something about.
        photos=[_shown(photo, photo.name in odd) for photo in sorted(found.photos, key=lambda photo: photo.used)],
        version=versions()["roundel"],
    )
    return (page.strip() + "\n").encode()


def _cards(found: PhotoCalibration, fitted: Fitted) -> list[dict[str, str]]:
    sure, values, sigmas = uncertainty_px(fitted.camera, fitted.covariance), fitted.values, fitted.sigmas
    view = [
        2 * np.degrees(np.arctan(side / 2 / focal))
        for side, focal in ((fitted.camera.width_px, values["fx"]), (fitted.camera.height_px, values["fy"]))
    ]
    return [
        {"value": f"{values['fx']:.1f} px", "text": f"focal length, to {100 * sigmas['fx'] / values['fx']:.2g} %; "
         f"the image spans {view[0]:.1f} by {view[1]:.1f} degrees before distortion"},
        {"value": f"{values['cx']:.1f}, {values['cy']:.1f}", "text": "principal point, px, to "
         f"{sure['principal point']:.2g} px"},
        {"value": f"{sure['lens distortion']:.2g} px", "text": "uncertainty of the lens at the corner of the image"},
        {"value": f"{found.rms_px:.3f} px", "text": "RMS of the residuals; small does not mean accurate, see the "
         "uncertainties"},
    ]  # fmt: skip


def _parameters(fitted: Fitted) -> list[dict[str, str]]:
    camera, values, sigmas = fitted.camera, fitted.values, fitted.sigmas
    border = {
        "fx": sigmas["fx"] / values["fx"] * camera.width_px / 2,
        "fy": sigmas["fy"] / values["fy"] * camera.height_px / 2,
    }
    return [
        {
            "name": name,
            "value": f"{value:.3f}" if name[0] in "fc" else f"{value:.5f}",
            "sigma": f"{sigmas[name]:.3f}" if name[0] in "fc" else f"{sigmas[name]:.5f}",
            "meaning": _MEANINGS[name].format(border=border.get(name, 0.0)),
        }
        for name, value in values.items()
    ]


def _shown(photo: BoardPhoto, odd: bool) -> dict[str, Any]:
    if photo.used:
        assert photo.camera_from_board is not None
        distance = float(np.linalg.norm(photo.camera_from_board[:3, 3]))
        text = f"RMS {photo.rms_px:.3f} px, tilt {photo.tilt_deg:.0f} degrees, {distance:.2f} m"
        text += "; fits worse than the others" if odd else ""
    elif photo.reason:
        text = f"not used: {photo.reason}"
    else:
        text = f"shows the board ({len(photo.pixels)} points)"
    return {
        "name": clean(photo.name.rpartition("/")[2], NAME_LIMIT),
        "text": clean(text, TEXT_LIMIT),
        "bad": odd or bool(photo.reason),
        "picture": _picture(photo),
    }


def _picture(photo: BoardPhoto) -> Any:
    """The photograph, small, with a dot on each point of the board."""
    from markupsafe import Markup
    from PIL import Image

    if photo.picture is None:
        return Markup('<span class="missing"></span>')
    sink = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(photo.picture)).save(sink, "JPEG", quality=80)
    data = base64.b64encode(sink.getvalue()).decode()
    height, width = photo.picture.shape[:2]
    scale = width / photo.size_px[0]
    dots = "".join(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="1.4"/>' for x, y in ((photo.pixels + 0.5) * scale).tolist())
    image = f'<image href="data:image/jpeg;base64,{data}" width="{width}" height="{height}"/>'
    return Markup(f'<svg class="photo" viewBox="0 0 {width} {height}">{image}{dots}</svg>')
