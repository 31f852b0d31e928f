"""A pose for each row under a rolling shutter."""

from pathlib import Path

import numpy as np
from helpers_studies import small_study

from roundel.scenes.camera.model import project
from roundel.scenes.camera.motion import pose_at
from roundel.scenes.truth.row_poses import row_poses_of
from roundel.scenes.truth.truth import truth_of
from roundel.scenes.world.frame import frame_of

MOTION = (
    "motion: {exposure_s: 0.002, readout_s: 0.02, camera: {velocity_m_s: [0.4, 0.1, 0], rate_deg_s: [0, 20, 30]}}\n"
)


def test_each_row_of_the_outline_has_the_pose_of_its_own_time(tmp_path: Path) -> None:
    frame = frame_of(small_study(tmp_path, ("pose:", MOTION + "pose:")), 0)
    part = frame.sheet.parts[0]
    rows = row_poses_of(frame, part)
    contour = truth_of(frame)[0]["contour_y_px"]
    assert [r["row"] for r in rows] == list(range(round(min(contour)), round(max(contour)) + 1))
    middle = min(rows, key=lambda r: abs(r["time_s"]))
    assert abs(middle["row"] - frame.motion.centre_row_px) <= 0.5
    for row in rows[::7]:
        pose = np.array([[row[f"camera_from_marker_{i}{j}"] for j in range(4)] for i in range(3)])
        expected = pose_at(frame.motion, frame.camera_from_sheet, frame.motion.row_time_s(row["row"]))
        np.testing.assert_allclose(pose, expected[:3], atol=1e-15)
        assert np.all(np.isfinite(project(frame.camera, pose[:, 3])))


def test_a_global_shutter_and_a_still_camera_have_none(tmp_path: Path) -> None:
    for motion in ("motion: {camera: {velocity_m_s: [0.4, 0, 0]}}\n", "motion: {readout_s: 0.02}\n", ""):
        frame = frame_of(small_study(tmp_path, ("pose:", motion + "pose:")), 0)
        assert row_poses_of(frame, frame.sheet.parts[0]) == []
