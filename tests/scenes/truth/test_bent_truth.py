"""Truth of circles on bent paper: exact contours, the tangent plane's pose, and no conic."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers_studies import small_study

from roundel.datasets.layout.truth_table import truth_table
from roundel.scenes.errors import StudyError
from roundel.scenes.markers.surfaces import Curve
from roundel.scenes.truth.edge_points import edge_points_of
from roundel.scenes.truth.truth import truth_of
from roundel.scenes.world.frame import frame_of

DISC = "kind: disc, diameter_m: 0.08"


def bent(folder: Path, surface: str, *edits, name: str = "bent.yaml"):
    return small_study(folder, (DISC, f"{DISC}, surface: {{{surface}}}"), *edits, name=name)


def contour(row) -> np.ndarray:
    return np.stack([row["contour_x_px"], row["contour_y_px"]], axis=-1)


def test_a_cylinder_of_a_huge_radius_is_flat(tmp_path: Path) -> None:
    (flat,) = truth_of(frame_of(small_study(tmp_path), 0))
    (row,) = truth_of(frame_of(bent(tmp_path, "shape: cylinder, radius_m: 1.0e6"), 0))
    # The paper falls by 0.04^2 / 2e6 m = 1 nm: a millionth of a pixel.
    np.testing.assert_allclose(contour(row), contour(flat), atol=2e-6)
    assert (row["surface"], row["curvature_radius_m"], flat["surface"]) == ("cylinder", 1e6, "flat")
    assert row["conic_00"] is None
    assert row["ellipse_a_px"] is None
    assert row["other_normal_x"] is None
    for name in ("normal_x", "centre_z_m", "distance_D", "tilt_deg", "centre_image_x_px", "vanishing_line_0"):
        assert row[name] == pytest.approx(flat[name], abs=1e-9)
    assert truth_table([flat, row]).num_rows == 2


def test_a_contour_on_a_cylinder_by_hand(tmp_path: Path) -> None:
    frame = frame_of(bent(tmp_path, "shape: cylinder, radius_m: 0.06, axis_deg: 90"), 0)
    (row,) = truth_of(frame)
    turn = np.linspace(0, 2 * np.pi, len(contour(row)), endpoint=False)
    angle = 0.04 * np.cos(turn) / 0.06
    points = np.stack([0.06 * np.sin(angle), 0.04 * np.sin(turn), 0.06 * (np.cos(angle) - 1)], axis=-1)
    seen = points @ frame.camera_from_sheet[:3, :3].T + frame.camera_from_sheet[:3, 3]
    px = seen[:, :2] / seen[:, 2:] * 320 + [79.5, 59.5]
    # The truth may start and turn otherwise round the circle: every point of one is a point of the other.
    for a, b in ((contour(row), px), (px, contour(row))):
        assert np.linalg.norm(a[:, None] - b[None], axis=-1).min(axis=1).max() < 1e-9


def test_parts_beside_the_origin_have_their_own_tangent_planes(tmp_path: Path) -> None:
    two = (DISC, "kind: two_discs, diameter_m: 0.03, second_diameter_m: 0.03, spacing_m: 0.05")
    study = small_study(
        tmp_path, two, ("spacing_m: 0.05", "spacing_m: 0.05, surface: {shape: cylinder, radius_m: 0.08}")
    )
    first, second = truth_of(frame_of(study, 1))
    a, b = (np.array([row[f"normal_{axis}"] for axis in "xyz"]) for row in (first, second))
    # 5 cm of arc on a cylinder of 8 cm.
    assert np.arccos(a @ b) == pytest.approx(0.05 / 0.08, abs=1e-9)
    apart = np.linalg.norm([first[f"centre_{axis}_m"] - second[f"centre_{axis}_m"] for axis in "xyz"])
    assert apart == pytest.approx(2 * 0.08 * np.sin(0.05 / 0.16), rel=1e-9)


def test_edge_points_scatter_about_the_bent_contour(tmp_path: Path) -> None:
    points = ("frames: 4", "frames: 4\nmode: points\npoints: {count: 4000, sigma_px: 0.0}")
    frame = frame_of(bent(tmp_path, "shape: bent, radius_m: 0.1, wave_m: 0.2, axis_deg: 30", points), 2)
    xy, outline = edge_points_of(frame, frame.sheet.parts[0]), contour(truth_of(frame)[0])
    closed = np.concatenate([outline, outline[:1]])
    a, b = closed[:-1], closed[1:]
    along = np.clip(np.einsum("nmk,mk->nm", xy[:, None] - a, b - a) / ((b - a) ** 2).sum(axis=1), 0, 1)
    away = np.linalg.norm(xy[:, None] - a - along[..., None] * (b - a), axis=-1).min(axis=1)
    # Chords of the 256 points: (2 pi / 256)^2 / 8 of a semi-axis of some 25 px.
    assert away.max() < 2e-3
    steps = np.linalg.norm(np.diff(xy, axis=0), axis=1)
    assert steps.std() / steps.mean() < 1e-3


def test_the_pose_is_that_of_the_flat_sheet(tmp_path: Path) -> None:
    flat, bent_ = frame_of(small_study(tmp_path), 3), frame_of(bent(tmp_path, "shape: cylinder, radius_m: 0.05"), 3)
    np.testing.assert_array_equal(flat.camera_from_sheet, bent_.camera_from_sheet)
    part = bent_.sheet.parts[0]
    np.testing.assert_allclose(bent_.camera_from_part(part), flat.camera_from_part(part), atol=1e-15)
    assert replace(bent_.sheet, curve=None) == flat.sheet
    assert bent_.sheet.curve == Curve("cylinder", 0.05, 90.0)


@pytest.mark.parametrize(
    ("surface", "said"),
    [
        (
            "shape: cylinder, radius_m: 0.01",
            r"marker.surface.radius_m: a cylinder of 0.01 m is too small for a sheet of",
        ),
        ("shape: cylinder, radius_m: 0.03", r"marker.surface.radius_m: marker 0 is bent out of the camera's sight"),
        ("shape: cylinder", r"marker.surface: shape cylinder needs radius_m"),
        ("shape: conical", r"marker.surface.shape: .*'flat', 'cylinder' or 'bent'"),
        ("radius_m: 0.1", r"marker.surface: radius_m and wave_m need shape"),
        ("shape: bent, radius_m: 0.1", r"marker.surface: wave_m belongs to shape bent"),
        ("shape: cylinder, radius_m: 0.1, wave_m: 1", r"marker.surface: wave_m belongs to shape bent"),
        ("shape: bent, radius_m: 0.01, wave_m: 0.2", r"marker.surface.wave_m: waves of 0.2 m .* rise by"),
        ("shape: bent, radius_m: 0.1, wave_m: 0.01", r"marker.surface.wave_m: 0.01 m is too short"),
        ("shape: cylinder, radius_m: -1", r"marker.surface.radius_m: -1 is out of range"),
    ],
)
def test_paper_that_cannot_be_bent_so_is_refused(tmp_path: Path, surface: str, said: str) -> None:
    with pytest.raises(StudyError, match=said):
        frame_of(bent(tmp_path, surface), 0)


def test_a_bent_sheet_has_no_clutter_behind_it(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match=r"marker.clutter: .* leave out clutter, or marker.surface.shape"):
        bent(tmp_path, "shape: cylinder, radius_m: 0.1}, clutter: {cell_m: 0.05")
