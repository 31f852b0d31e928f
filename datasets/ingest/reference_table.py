"""Columns of reference.parquet: where each pose of imported photographs comes from, and its covariance."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from roundel.datasets.ingest.photographs import Photograph
from roundel.scenes.markers.marker import Sheet

POSE = 6
COVARIANCE = tuple(f"cov_{i}{j}" for i in range(POSE) for j in range(i, POSE))

REFERENCE_SCHEMA = pa.schema(
    [
        ("frame_id", pa.int64()),
        ("marker_id", pa.int64()),
        ("photograph", pa.string()),
        ("orientation", pa.int64()),
        ("corners", pa.int64()),
        ("corner_sigma_px", pa.float64()),
        ("corner_rms_px", pa.float64()),
        ("normal_sigma_deg", pa.float64()),
        ("position_sigma_m", pa.float64()),
        *[(name, pa.float64()) for name in COVARIANCE],
    ]
)


def sigmas(photo: Photograph, part: int) -> tuple[float, float]:
    """Standard deviations of the normal's angle (degrees) and of the centre (m) of a part."""
    normal, cov = photo.camera_from_part[part, :3, 2], photo.covariance[part]
    # A turn about the normal does not change it.
    turned = float(np.trace(cov[3:, 3:]) - normal @ cov[3:, 3:] @ normal)
    return float(np.degrees(np.sqrt(max(turned, 0.0)))), float(np.sqrt(np.trace(cov[:3, :3])))


def reference_table(photos: Sequence[Photograph], sheet: Sheet) -> pa.Table:
    """One row for each marker of a photograph, in the order of truth.parquet."""
    upper = np.triu_indices(POSE)
    rows: list[dict[str, Any]] = []
    for frame_id, photo in enumerate(photos):
        for place, part in enumerate(sheet.parts):
            normal_deg, position_m = sigmas(photo, place)
            rows.append(
                {
                    "frame_id": frame_id,
                    "marker_id": part.marker_id,
                    "photograph": photo.name,
                    "orientation": photo.orientation,
                    "corners": photo.corners,
                    "corner_sigma_px": photo.sigma_px,
                    "corner_rms_px": photo.rms_px,
                    "normal_sigma_deg": normal_deg,
                    "position_sigma_m": position_m,
                    **dict(zip(COVARIANCE, photo.covariance[place][upper].tolist(), strict=True)),
                }
            )
    return pa.Table.from_pylist(rows, schema=REFERENCE_SCHEMA)


def sigma_record(photos: Sequence[Photograph], sheet: Sheet) -> dict[str, float]:
    """RMS of the standard deviations over the circles: normal (degrees), centre (m, and % of its distance)."""
    found = []
    for photo in photos:
        for place, part in enumerate(sheet.parts):
            if part.radius_m is not None:
                normal_deg, position_m = sigmas(photo, place)
                distance_m = float(np.linalg.norm(photo.camera_from_part[place, :3, 3]))
                found.append((normal_deg, position_m, 100 * position_m / distance_m))
    rms = np.sqrt(np.mean(np.square(found), axis=0)).tolist()
    return dict(zip(("normal_deg", "position_m", "position_pct"), rms, strict=True))
