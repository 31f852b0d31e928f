"""Write scenes/markers/tag_bits.json: the bit patterns of four tag families, from OpenCV's dictionaries.

    python tests/helpers/make_tag_bits.py

Run it once when a family is added; `test_tags.py` compares the file with OpenCV.
"""

import json
from pathlib import Path

import cv2
import numpy as np

# Family -> OpenCV's name, and number of shipped tags.
FAMILIES = {
    "aruco_4x4_50": ("DICT_4X4_50", 50),
    "aruco_5x5_100": ("DICT_5X5_100", 100),
    "aruco_6x6_250": ("DICT_6X6_250", 250),
    "apriltag_36h11": ("DICT_APRILTAG_36h11", 587),
}
OUT = Path(__file__).resolve().parents[2] / "scenes" / "markers" / "tag_bits.json"


def drawn_bits(name: str, tag_id: int) -> np.ndarray:
    """The (n, n) cells of a tag inside its black border, 1 = white, one pixel per cell."""
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
    side = dictionary.markerSize + 2
    image = cv2.aruco.generateImageMarker(dictionary, tag_id, side, None, 1)
    assert not image[[0, -1]].any()
    assert not image[:, [0, -1]].any()
    return (image[1:-1, 1:-1] > 127).astype(np.uint8)


def family_of(name: str, count: int) -> dict:
    tags = [drawn_bits(name, i) for i in range(count)]
    digits = -(-tags[0].size // 4)
    codes = [f"{int(''.join(map(str, tag.ravel())), 2):0{digits}x}" for tag in tags]
    return {"side": len(tags[0]), "codes": codes}


def text() -> str:
    families = {family: family_of(*source) for family, source in FAMILIES.items()}
    lines = [
        "{",
        ' "about": "cells of a tag within its black border, row by row from the top left, 1 = white; a code is that '
        'number in hex",',
        ' "source": "OpenCV\'s predefined dictionaries (objdetect/aruco; Apache-2.0): ArUco (Garrido-Jurado et al. '
        '2014, 2016) and AprilTag 36h11 (Olson 2011)",',
        ' "families": {',
    ]
    for i, (family, entry) in enumerate(families.items()):
        comma = "," if i + 1 < len(families) else ""
        lines.append(f'  "{family}": {{"side": {entry["side"]}, "codes": [')
        codes = [f'"{code}"' for code in entry["codes"]]
        rows = [", ".join(codes[k : k + 10]) for k in range(0, len(codes), 10)]
        lines.append("   " + ",\n   ".join(rows))
        lines.append("  ]}" + comma)
    return "\n".join([*lines, " }", "}", ""])


if __name__ == "__main__":
    made = text()
    json.loads(made)
    OUT.write_text(made, encoding="utf-8")
