"""A frame as one JSON object, for formats that hold any: WebDataset, Hugging Face, Croissant.

Coordinates are Roundel's, from the centre of the first pixel; lengths are metres.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from roundel.datasets.export.reading import ReadFrame, ReadMarker
from roundel.datasets.stream.frames import KEYPOINTS, Frame, Marker
from roundel.datasets.stream.masks import mask_of_runs, run_lengths

LEFT_OUT = (
    "depth",
    "the lens: aperture, focus and exposure",
    "motion: poses are those at mid-exposure of the marker's centre row",
    "boards and tags: only circular markers are there",
    "noise: levels and their standard deviations at the edge",
)
CONVENTION = "Image coordinates count from the centre of the first pixel, as in OpenCV. Lengths are metres."

_NUMBERS = ("distance_m", "distance_D", "tilt_deg", "azimuth_deg", "visible_fraction")
_ELLIPSE = ("ellipse_x_px", "ellipse_y_px", "ellipse_a_px", "ellipse_b_px", "ellipse_angle_deg")


def sample_of(frame: Frame) -> dict[str, Any]:
    """A frame without its image; see `read_sample`."""
    return {
        "frame_id": frame.frame_id,
        "group": frame.group,
        "width_px": frame.camera.width_px,
        "height_px": frame.camera.height_px,
        "K": [[float(v) for v in row] for row in frame.camera.K],
        "distortion_model": frame.record.get("distortion_model", "opencv"),
        "distortion": [float(v) for v in frame.camera.distortion],
        "markers": [_marker(marker) for marker in frame.markers],
    }


def _marker(marker: Marker) -> dict[str, Any]:
    keypoints = marker.keypoints_px.tolist()
    return {
        "marker_id": marker.marker_id,
        "kind": marker.kind,
        "category": marker.category,
        "diameter_m": marker.diameter_m,
        "camera_from_marker": marker.camera_from_marker.tolist(),
        "box_px": None if marker.box_px is None else list(marker.box_px),
        "ellipse": _known(marker, _ELLIPSE),
        "keypoints_px": [
            xy if inside else None for xy, inside in zip(keypoints, marker.keypoints_in_image, strict=True)
        ],
        "mask": run_lengths(marker.visible_mask),
        "full_mask": run_lengths(marker.full_mask),
        **{name: marker.truth.get(name) for name in _NUMBERS},
        "hidden_by": marker.truth.get("hidden_by") or "",
    }


def _known(marker: Marker, names: tuple[str, ...]) -> list[float] | None:
    values = [marker.truth.get(name) for name in names]
    return None if None in values else [float(v) for v in values if v is not None]


def read_sample(sample: dict[str, Any], split: str, image: bytes) -> ReadFrame:
    """A frame from its object.

    Raises
    ------
    KeyError, ValueError, TypeError
        If it is not one.
    """
    height, width = int(sample["height_px"]), int(sample["width_px"])
    markers = []
    for m in sample["markers"]:
        if len(m["keypoints_px"]) != len(KEYPOINTS):
            raise ValueError(f"{len(m['keypoints_px'])} keypoints")
        markers.append(
            ReadMarker(
                marker_id=m["marker_id"],
                pose=np.array(m["camera_from_marker"], dtype=np.float64),
                diameter_m=m["diameter_m"],
                category=m["category"],
                full_mask=mask_of_runs(m["full_mask"], height, width),
                visible_mask=mask_of_runs(m["mask"], height, width),
                box_px=None if m["box_px"] is None else np.array(m["box_px"], dtype=np.float64),
                keypoints_px=np.array([xy or [np.nan, np.nan] for xy in m["keypoints_px"]], dtype=np.float64),
            )
        )
    return ReadFrame(
        int(sample["frame_id"]),
        split,
        k=np.array(sample["K"], dtype=np.float64),
        distortion=tuple(float(v) for v in sample["distortion"]),
        size_px=(width, height),
        image=image,
        markers=markers,
    )
