"""Rolling shutter: the pose for each sensor row that images a marker."""

from __future__ import annotations

from typing import Any

import numpy as np

from roundel.scenes.camera.motion import image_of, pose_at
from roundel.scenes.geometry.pose import transform_points
from roundel.scenes.markers.marker import Part
from roundel.scenes.markers.surfaces import tangent_frame
from roundel.scenes.world.frame import Frame
from roundel.scenes.world.placement import part_outline

_OUTLINE_POINTS = 256


def row_poses_of(frame: Frame, part: Part) -> list[dict[str, Any]]:
    """One row of `rows.parquet` for each image row that a part's outline reaches; none without a rolling shutter.

    `time_s` is the row's mid-exposure relative to that of the part's centre row, the time of the pose of record.
    """
    motion = frame.motion
    if not motion.moves or motion.row_s == 0:
        return []
    outline, _ = image_of(
        frame.camera, motion, frame.camera_from_sheet, part_outline(frame.sheet, part, _OUTLINE_POINTS)
    )
    first, last = np.clip(
        np.rint([outline[:, 1].min(), outline[:, 1].max()]).astype(int), 0, frame.camera.height_px - 1
    )
    rows = np.arange(first, last + 1)
    time = motion.row_time_s(rows)
    poses = pose_at(motion, frame.camera_from_sheet, time)
    if frame.sheet.curve is not None:
        poses = poses @ tangent_frame(frame.sheet.curve, part.x_m, part.y_m)
    else:
        poses[:, :3, 3] = [transform_points(pose, [part.x_m, part.y_m, 0.0]) for pose in poses]
    after = time - frame.part_time_s(part)
    return [
        {
            "frame_id": frame.frame_id,
            "marker_id": part.marker_id,
            "row": int(row),
            "time_s": float(t),
            **{f"camera_from_marker_{i}{j}": float(pose[i, j]) for i in range(3) for j in range(4)},
        }
        for row, t, pose in zip(rows, after, poses, strict=True)
    ]
