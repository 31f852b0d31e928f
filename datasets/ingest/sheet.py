"""The printed sheet of photographs, from a study's marker, and the study of the dataset."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from roundel.datasets.ingest.photographs import GROUP, Photograph
from roundel.scenes.camera.model import Camera, project
from roundel.scenes.errors import UsageError
from roundel.scenes.geometry.pose import tilt_azimuth_deg
from roundel.scenes.markers.marker import Part, Sheet
from roundel.scenes.study.marker_section import KINDS
from roundel.scenes.study.schema import GroupSection, SolveSection, ValidateSection
from roundel.scenes.study.study import Study, validated
from roundel.scenes.world.sheets import sheet_of

BOARDS = ("chessboard", "charuco")


def marker_of_study(study: Study, group: str | None = None) -> Any:
    """The section of the marker that a study's photographs show.

    Parameters
    ----------
    study : Study
    group : str, optional
        Default: the groups whose sheet has a circle and a board, if they have the same.

    Raises
    ------
    UsageError
        If there is no such group, the groups differ, or sizes are drawn.
    """
    if group is not None and group not in study.groups:
        raise UsageError(f"--group {group}: the study has {', '.join(study.groups)}")
    names = [group] if group is not None else [n for n in study.groups if _fits(study, n)]
    if not names:
        raise UsageError(
            f"{study.path}: no group has a sheet with a circle and a board beside it; see disc_with_chessboard"
        )
    if len({study.groups[name].marker.model_dump_json() for name in names}) > 1:
        raise UsageError(f"{study.path}: groups {', '.join(names)} have different sheets; name one with --group")
    drawn = [where for where, _ in study.groups[names[0]].spreads if where[0] == "marker"]
    if drawn:
        key = ".".join(map(str, drawn[0]))
        raise UsageError(f"{study.path}: {key} is drawn anew in each frame; a printed sheet has a fixed size")
    return study.groups[names[0]].marker


def _fits(study: Study, name: str) -> bool:
    try:
        parts_of(sheet_of(study.groups[name].marker))
    except (ValueError, TypeError):
        return False
    return True


def scaled_marker(marker: Any, factor: float) -> Any:
    """The section of a marker with all its lengths multiplied: a printer may stretch a page by a percent."""

    def scaled(value: Any, key: str) -> Any:
        if isinstance(value, dict):
            return {name: scaled(inner, name) for name, inner in value.items()}
        if isinstance(value, list):
            return [scaled(inner, key) for inner in value]
        return value * factor if key.endswith("_m") and isinstance(value, float | int) else value

    return KINDS[marker.kind].model_validate(scaled(marker.model_dump(exclude_none=True), ""))


def parts_of(sheet: Sheet) -> tuple[Part, list[Part]]:
    """The board of a flat sheet, and its circles.

    Raises
    ------
    ValueError
        If it has no board, several, no circle, or is bent.
    """
    boards = [part for part in sheet.parts if part.kind in BOARDS]
    circles = [part for part in sheet.parts if part.radius_m is not None]
    if len(boards) != 1 or not circles:
        raise ValueError(
            f"its sheet has {len(circles)} circles and {len(boards)} boards; an import needs a circle with one "
            f"{' or '.join(BOARDS)} beside it, as disc_with_chessboard has"
        )
    if sheet.curve is not None:
        raise ValueError("its sheet is bent; poses follow from a flat one alone")
    return boards[0], circles


def study_of_photographs(
    marker: Any, camera: Camera, photos: Sequence[Photograph], sheet: Sheet, name: str, licence: str
) -> Study:
    """The study of imported photographs: their sheet, their camera, and the ranges of their poses.

    Nothing is rendered from it. Rendering it elsewhere gives frames like the photographs, with poses drawn uniformly
    from the same ranges.

    Parameters
    ----------
    marker : Marker
        The section of the sheet.
    camera : Camera
    photos : sequence of Photograph
    sheet : Sheet
    name, licence : str
    """
    focal, k = [photo.focal_35mm_mm for photo in photos], camera.K
    poses = np.stack([photo.camera_from_part[0] for photo in photos])
    tilt, azimuth = tilt_azimuth_deg(poses[:, :3, 2])
    offset = project(camera, poses[:, :3, 3]) - k[:2, 2]
    distance_m = np.linalg.norm(poses[:, :3, 3], axis=1)
    section = {
        "camera": {
            "width_px": camera.width_px,
            "height_px": camera.height_px,
            "focal_px": float(k[0, 0]),
            "aspect": float(k[1, 1] / k[0, 0]),
            "principal_point_x_px": float(k[0, 2]),
            "principal_point_y_px": float(k[1, 2]),
            "distortion": list(camera.distortion),
            **({"focal_35mm_mm": focal[0]} if focal[0] is not None and len(set(focal)) == 1 else {}),
        },
        "marker": marker.model_dump(exclude_none=True),
        "pose": {
            "distance_m": _range(distance_m, 4),
            "tilt_deg": _range(tilt, 2),
            "azimuth_deg": _range(azimuth, 2),
            "offset_x_px": _range(offset[:, 0], 1),
            "offset_y_px": _range(offset[:, 1], 1),
        },
        "frames": len(photos),
    }
    labels = ["true", *(["exif"] if None not in focal else []), "default"]
    return Study(
        Path("study.yaml"),
        name,
        0,
        licence,
        {GROUP: validated(GroupSection, section, Path("study.yaml"), {}, GROUP)},
        SolveSection(groups=[GROUP], intrinsics=labels),
        ValidateSection(),
        {},
    )


def _range(values: Any, digits: int) -> Any:
    low, high = round(float(np.min(values)), digits), round(float(np.max(values)), digits)
    return {"uniform": [low, high]} if high > low else low
