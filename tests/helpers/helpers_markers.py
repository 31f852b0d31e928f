"""One marker of each kind, and its sheet."""

from typing import Any

from pydantic import TypeAdapter

from roundel.scenes.markers.marker import Sheet
from roundel.scenes.study.marker_section import Marker
from roundel.scenes.world.sheets import sheet_of

MARKERS: dict[str, dict[str, Any]] = {
    "disc": {"diameter_m": 0.08},
    "disc_with_tick": {"diameter_m": 0.08},
    "ring": {"diameter_m": 0.08, "inner_diameter_m": 0.05},
    "rings": {"diameters_m": [0.08, 0.06, 0.05, 0.02]},
    "coded_rings": {"diameter_m": 0.08, "code": ["11010010", "01101001", "10011100"]},
    "ring_code": {"diameter_m": 0.08, "id": 7},
    "dot_code": {"diameter_m": 0.08, "id": 5},
    "two_discs": {"diameter_m": 0.08, "second_diameter_m": 0.04, "spacing_m": 0.09},
    "dot_ring": {"diameter_m": 0.02, "ring_diameter_m": 0.1, "dots": 7, "turn_deg": 30.0},
    "chessboard": {"columns": 5, "rows": 4, "square_m": 0.02},
    "disc_with_chessboard": {
        "diameter_m": 0.08,
        "gap_m": 0.01,
        "chessboard": {"columns": 5, "rows": 4, "square_m": 0.015},
    },
    "disc_with_charuco": {
        "diameter_m": 0.08,
        "gap_m": 0.01,
        "charuco": {"columns": 5, "rows": 4, "square_m": 0.02, "tag_m": 0.015},
    },
    "charuco": {"columns": 5, "rows": 4, "square_m": 0.03, "tag_m": 0.02, "first_id": 3},
    "circle_grid": {"columns": 4, "rows": 5, "spacing_m": 0.02, "diameter_m": 0.014, "layout": "asymmetric"},
    "stag": {"tag_m": 0.08, "id": 3},
    "tags": {"columns": 3, "rows": 2, "tag_m": 0.04, "gap_m": 0.01},
}


def sheet(kind: str, seed: int = 0, **keys: Any) -> Sheet:
    return sheet_of(TypeAdapter(Marker).validate_python({"kind": kind, **MARKERS[kind], **keys}), seed)
