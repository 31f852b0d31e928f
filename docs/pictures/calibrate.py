"""Make the picture of docs/calibration.md: `python docs/pictures/calibrate.py`; needs Chromium for the screenshot.

The photographs are rendered, the page is the one that `roundel calibrate` writes.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

from roundel.cli.main import main
from roundel.render.run import render_study

HERE = Path(__file__).parent
WIDTH_PX, HEIGHT_PX = 1180, 2340


def make(folder: Path, browser: str) -> None:
    """Render, calibrate, and take the picture of the page."""
    dataset = render_study(HERE / "calibrate.yaml", folder / "dataset")
    assert dataset is not None
    photos = folder / "photos"
    photos.mkdir()
    for i, file in enumerate(sorted((folder / "dataset" / "images").iterdir())):
        shutil.copy(file, photos / f"IMG_{4101 + i}.jpg")
    # One that shows too little of the board.
    with Image.open(photos / "IMG_4101.jpg") as image:
        image.crop((0, 0, 330, 247)).resize((800, 600)).save(photos / "IMG_4112.jpg", quality=90)
    # docs/calibration.md quotes these lines.
    main(["calibrate", str(photos), str(folder / "camera.yaml"), "--board", "charuco"])
    shot = folder / "page.png"
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]
    subprocess.run(
        [browser, *options, f"--screenshot={shot}", f"--window-size={WIDTH_PX},{HEIGHT_PX}",
         (folder / "camera.html").as_uri()],
        check=True, capture_output=True,
    )  # fmt: skip
    with Image.open(shot) as image:
        image.convert("RGB").save(HERE / "calibrate.jpg", quality=85, optimize=True)


if __name__ == "__main__":
    found = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if found is None:
        sys.exit("error: no Chromium on the path; the picture is a screenshot of the page")
    with tempfile.TemporaryDirectory() as name:
        make(Path(name), found)
