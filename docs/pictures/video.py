"""Make the picture of docs/video.md: `python docs/pictures/video.py [FOLDER]`.

Renders the benchmark's sequence (or takes the frames that are in FOLDER), saves it as a video, solves it, and puts
three frames of the overlay side by side: before the motion has told the candidates apart, after it, and with one marker
hidden.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parents[1] / "benchmarks" / "solver"))

from tracking import sequence  # noqa: E402

from roundel.scenes.camera.srgb import linear_to_srgb  # noqa: E402
from roundel.solver.photos.video import solve_video  # noqa: E402
from roundel.solver.photos.video_file import open_video  # noqa: E402

COUNT, SHOWN = 160, (3, 60, 153)
GAP = 12


def main() -> None:
    """Write docs/pictures/video.png."""
    frames = Path(sys.argv[1] if len(sys.argv) > 1 else "out/tracking")
    seen = sequence("carried", frames, COUNT)
    with tempfile.TemporaryDirectory() as name:
        video = Path(name) / "carried.mkv"
        size = seen.camera.width_px, seen.camera.height_px
        writer = cv2.VideoWriter(str(video), cv2.VideoWriter.fourcc(*"FFV1"), 30.0, size)
        for image in seen.images:
            encoded = np.rint(255.0 * linear_to_srgb(image / 255.0)).astype(np.uint8)
            writer.write(cv2.cvtColor(encoded, cv2.COLOR_GRAY2BGR))
        writer.release()
        solve_video(video, Path(name) / "out", 0.08, f"focal:{seen.camera.K[0, 0]:g}")
        pictures = [frame for _, frame in open_video(Path(name) / "out" / "overlay.mp4")]
    strip = np.full_like(pictures[0][:, :GAP], 255)
    row = np.hstack([part for i in SHOWN for part in (pictures[i], strip)])[:, :-GAP]
    small = cv2.resize(row, None, fx=0.4, fy=0.4, interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(HERE / "video.png"), small, [cv2.IMWRITE_PNG_COMPRESSION, 9])


if __name__ == "__main__":
    main()
