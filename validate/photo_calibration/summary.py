"""A calibration from photographs in words: for the terminal and for its page."""

from __future__ import annotations

import numpy as np

from roundel.validate.photo_calibration.coverage import coverage_lines, coverage_of
from roundel.validate.photo_calibration.next_photo import Advice, next_photographs, uncertainty_px
from roundel.validate.photo_calibration.record import BoardPhoto, Fitted, PhotoCalibration

# Photographs whose points lie so much farther from the model than in the median one are worth a look.
_ODD = 2.5
# Standard deviations, of the focal length and of the image's width, that ten good photographs undercut many times.
_WEAK_FOCAL, _WEAK_CENTRE = 0.005, 0.005
_POINTS = {"chessboard": "corners", "charuco": "corners", "circle_grid": "circles"}


def points_word(found: PhotoCalibration) -> str:
    """What the points of the board are."""
    return _POINTS[found.board.kind]


def parameter_line(fitted: Fitted) -> str:
    """All parameters with their standard deviations."""
    values, sigmas = fitted.values, fitted.sigmas
    camera = ", ".join(f"{name} {values[name]:.3f} ± {sigmas[name]:.3f}" for name in ("fx", "fy", "cx", "cy"))
    lens = ", ".join(f"{name} {values[name]:.5f} ± {sigmas[name]:.5f}" for name in list(values)[4:])
    return f"{camera} px; {lens}"


def certainty_line(fitted: Fitted) -> str:
    """How well the parts of the camera are known, in plain words."""
    found, sigma = uncertainty_px(fitted.camera, fitted.covariance), fitted.sigmas
    focal = max(sigma["fx"] / fitted.values["fx"], sigma["fy"] / fitted.values["fy"])
    return (
        f"standard deviations: focal length {100 * focal:.2g} % ({found['focal length']:.2g} px at the border of the "
        f"image), principal point {found['principal point']:.2g} px, lens distortion {found['lens distortion']:.2g} px "
        "at the corner of the image"
    )


def odd_photos(found: PhotoCalibration) -> list[BoardPhoto]:
    """Used photographs that fit the camera much worse than the others, the worst first."""
    used = found.used
    if not used:
        return []
    limit = _ODD * float(np.median([photo.rms_px for photo in used]))
    return sorted((photo for photo in used if photo.rms_px > limit), key=lambda photo: -photo.rms_px)


def warnings(found: PhotoCalibration) -> list[str]:
    """What makes a calibration worth less than its numbers say."""
    fitted = found.fitted
    if fitted is None:
        return []
    lines = [*_weak(fitted), *fitted.notes]
    if fitted.widened > 1 and found.board.kind != "circle_grid":
        lines.append(
            "the photographs contradict each other by more than their noise (a bent board, a zoom or focus that "
            f"changed, or another lens model, see --k3): the standard deviations are widened by {fitted.widened:.1f}"
        )
    for photo in odd_photos(found):
        lines.append(
            f"{photo.name}: its {points_word(found)} lie {photo.rms_px:.2f} px (RMS) from the model, more than in the "
            "others: is it blurred, or was the board bent?"
        )
    return lines


def _weak(fitted: Fitted) -> list[str]:
    """Parts of the camera that the photographs leave open."""
    focal = max(fitted.sigmas[name] / fitted.values[name] for name in ("fx", "fy"))
    centre = uncertainty_px(fitted.camera, fitted.covariance)["principal point"]
    lines = []
    if focal > _WEAK_FOCAL:
        lines.append(f"the photographs leave the focal length open by {100 * focal:.2g} %; see what to photograph next")
    if centre > _WEAK_CENTRE * fitted.camera.width_px:
        lines.append(f"the photographs leave the principal point open by {centre:.2g} px; see what to photograph next")
    return lines


def advice_text(advice: Advice) -> str:
    """A photograph to take, and what it is worth."""
    part = advice.weakest
    return (
        f"{advice.candidate.text}: lowers the uncertainty of the {part} from {advice.before_px[part]:.2g} to "
        f"{advice.after_px[part]:.2g} px"
    )


def next_lines(found: PhotoCalibration) -> list[str]:
    """What to photograph next: what the photographs lack, then the poses that are predicted to help most."""
    shown = found.shown
    lines = coverage_lines(coverage_of(shown, found.size_px), len(found.used or shown))
    if found.fitted is None:
        return lines or ["take further photographs, with the board tilted by 20 to 45 degrees in several directions"]
    lines += [advice_text(advice) for advice in next_photographs(found.fitted, found.board)]
    return lines or ["nothing: one more photograph would change the uncertainties by less than 4 %"]


def summary_lines(found: PhotoCalibration) -> list[str]:
    """A calibration as lines for the terminal."""
    assert found.fitted is not None
    count = sum(len(photo.residual_px) for photo in found.used)
    return [
        f"calibration: {len(found.used)} of {len(found.photos)} views, {count} {points_word(found)}, "
        f"RMS {found.rms_px:.4f} px",
        parameter_line(found.fitted),
        certainty_line(found.fitted),
        *(f"warning: {line}" for line in warnings(found)),
        *(f"next: {line}" for line in next_lines(found)),
    ]
