"""Make the pictures of the documentation: `python docs/pictures/make.py`. Everything in them is rendered."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from roundel.render.redevelop import develop_dataset
from roundel.render.run import render_study
from roundel.solver.photos.photo_report import line_of
from roundel.solver.photos.photographs import solve_photographs

HERE = Path(__file__).parent
TRUTH = (0, 190, 160)
ZOOM, PATCH_PX, BORDER = 11, 22, 3


def inset(image: NDArray[np.uint8], centre: NDArray[np.float64], contour: NDArray[np.float64]) -> Image.Image:
    """Pixels round `centre`, enlarged without smoothing, with a contour drawn on them."""
    left, top = (int(v) for v in np.rint(centre) - PATCH_PX // 2)
    patch = Image.fromarray(image[top : top + PATCH_PX, left : left + PATCH_PX]).convert("RGB")
    big = patch.resize((PATCH_PX * ZOOM, PATCH_PX * ZOOM), Image.Resampling.NEAREST)
    draw = ImageDraw.Draw(big)
    # The centre of a pixel is a whole number: its left border stands half a pixel before it.
    points = (contour - [left - 0.5, top - 0.5]) * ZOOM
    draw.line([tuple(p) for p in np.vstack([points, points[:1]])], fill=TRUTH, width=2)
    return big


def hero(folder: Path) -> None:
    """A rendered frame, and its disc's edge pixel by pixel under the analytic contour.

    The inset is developed once more without tone curve and sharpening, which move an edge for the eye.
    """
    dataset = render_study(HERE / "hero.yaml", folder / "hero")
    assert dataset is not None
    (folder / "linear.yaml").write_text("{curve: linear, isp: none}\n", encoding="utf-8")
    linear = develop_dataset(folder / "hero", folder / "linear", folder / "linear.yaml").images.image(0)
    image, row = dataset.images.image(0), dataset.truth.to_pylist()[0]
    contour = np.column_stack([row["contour_x_px"], row["contour_y_px"]])
    picture = Image.fromarray(image).convert("RGB")
    ImageDraw.Draw(picture).line([tuple(p) for p in np.vstack([contour, contour[:1]])], fill=TRUTH, width=1)
    detail = inset(linear, contour[20], contour)
    frame = Image.new("RGB", (detail.width + 2 * BORDER, detail.height + 2 * BORDER), (255, 255, 255))
    frame.paste(detail, (BORDER, BORDER))
    picture.paste(frame, (picture.width - frame.width - 24, picture.height - frame.height - 24))
    picture.save(HERE / "hero.png", optimize=True)


def photograph(folder: Path) -> None:
    """A rendered frame as a phone would save it, solved as a photograph: its overlay."""
    dataset = render_study(HERE / "photograph.yaml", folder / "photograph")
    assert dataset is not None
    row = dataset.truth.to_pylist()[0]
    shot = Image.open(dataset.path / "images" / "000000.jpg")
    camera = dataset.images.camera(0)
    focal_35mm_mm = camera.K[0, 0] * np.hypot(36, 24) / np.hypot(camera.width_px, camera.height_px)
    exif = Image.Exif()
    exif.get_ifd(0x8769).update({0xA405: round(focal_35mm_mm), 0xA002: shot.width, 0xA003: shot.height})
    shot.save(folder / "IMG_0042.jpg", quality="keep", exif=exif)
    (result,) = solve_photographs([folder / "IMG_0042.jpg"], folder / "solved", 0.08)
    # docs/photographs.md quotes these two lines.
    sys.stdout.write(line_of(result).removeprefix(f"{folder}/") + "\n")
    sys.stdout.write(f"the truth: {row['distance_m']:.3f} m, tilt {row['tilt_deg']:.1f} deg\n")
    Image.open(folder / "solved" / result.overlay).save(HERE / "photograph.png", optimize=True)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        hero(Path(name))
        photograph(Path(name))
