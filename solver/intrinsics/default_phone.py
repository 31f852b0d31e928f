"""The default phone: the phones that it stands for, and the conventions of 35-mm equivalence."""

from __future__ import annotations

from typing import Literal

from roundel.scenes.camera.film import (
    DEFAULT_FOCAL_35MM_MM,
    DEFAULT_FOCAL_35MM_SIGMA_MM,
    FOCAL_35MM_2020S_MM,
    FOCAL_35MM_2020S_SIGMA_MM,
)

Phones = Literal["paper", "2020s"]
Convention = Literal["diagonal", "width", "crop43"]

DEFAULT_FORMS = (
    "default",
    "default:width",
    "default:crop43",
    "default:2020s",
    "default:2020s:width",
    "default:2020s:crop43",
)
_BY: dict[Convention, str] = {
    "diagonal": "by diagonal",
    "width": "by width",
    "crop43": "by the diagonal of the 4:3 sensor that the image is cut from",
}
# Mean and standard deviation of the 35-mm equivalents, mm, and the name of the prior.
_PHONES: dict[Phones, tuple[float, float, str]] = {
    "paper": (DEFAULT_FOCAL_35MM_MM, DEFAULT_FOCAL_35MM_SIGMA_MM, "default phone model"),
    "2020s": (FOCAL_35MM_2020S_MM, FOCAL_35MM_2020S_SIGMA_MM, "default phone of the 2020s"),
}


def parse_default(text: str) -> tuple[Phones, Convention] | None:
    """Phones and convention of `default`, `default:2020s:width` and the like; None for any other text."""
    match text.split(":"):
        case ["default"]:
            return "paper", "diagonal"
        case ["default", "2020s"]:
            return "2020s", "diagonal"
        case ["default", ("width" | "crop43") as convention]:
            return "paper", convention
        case ["default", "2020s", ("width" | "crop43") as convention]:
            return "2020s", convention
        case _:
            return None


def default_focal(phones: Phones, convention: Convention) -> tuple[float, float, str]:
    """35-mm-equivalent focal length in mm, its standard deviation as a fraction of it, and the basis of both."""
    mean_mm, sigma_mm, model = _PHONES[phones]
    sigma = sigma_mm / mean_mm
    return mean_mm, sigma, f"{model}: {mean_mm} mm (35-mm equivalent, {_BY[convention]}), +- {100 * sigma:.1f} %"
