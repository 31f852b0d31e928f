"""Square tags: exact corners, rendered frames of every dictionary, boards, lenses, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers_boards import SQUARE, pinhole, plane_views
from helpers_reports import make_dataset

from roundel.datasets.dataset import Dataset
from roundel.scenes.camera.model import Camera, distort_px
from roundel.scenes.geometry.pose import angle_deg, transform_points
from roundel.solver.detect.quad_edges import refine_quad
from roundel.solver.methods.plugin import Found, MethodFailure, View
from roundel.solver.related.fiala2010 import DICTIONARIES, detected_tags, find, tag_corners_m
from roundel.solver.views.plane_marker import found_plane
from roundel.validate.metrics.ground_truth import poses_of

STUDY = """\
schema: 1
name: tags
seed: 4
camera: {width_px: 320, height_px: 240, focal_px: 400, distortion: [-0.15, 0.04, 0.001, -0.001]}
marker: MARKER
pose:
  distance_m: {uniform: [0.45, 0.8]}
  tilt_deg: {uniform: [15, 55]}
  azimuth_deg: {uniform: [-180, 180]}
  roll_deg: {uniform: [-180, 180]}
  offset_x_px: {uniform: [-60, 60]}
  offset_y_px: {uniform: [-40, 40]}
frames: 6
"""


def views_of(dataset: Dataset, **changes: Any) -> list[tuple[View, np.ndarray]]:
    """What the method gets of each frame, and the true pose."""
    out = []
    for i, pose in enumerate(poses_of(dataset.truth)):
        markers = dataset.images.markers(i)
        view = View(dataset.images.image(i), dataset.images.camera(i), 0.08, markers)
        out.append((replace(view, **changes), pose))
    return out


def best(found: Found, pose: np.ndarray) -> tuple[float, float]:
    """Errors of the nearest pose: normal in degrees, position in parts of the distance."""
    errors = [float(angle_deg(normal, pose[:3, 2])) for normal, _ in found.poses]
    centre = np.asarray(found.poses[int(np.argmin(errors))][1])
    return min(errors), float(np.linalg.norm(centre - pose[:3, 3]) / np.linalg.norm(pose[:3, 3]))


@pytest.mark.parametrize("scenes", [50, pytest.param(500, marks=pytest.mark.slow)])
def test_exact_corners_give_both_poses_and_the_focal_length(scenes):
    measured = 0
    for true in plane_views(scenes, 11, SQUARE):
        view = View(np.zeros((480, 640), np.uint8), true.camera, 0.08)
        found = found_plane(view, SQUARE, true.pixels, 1e-4, square=True, identity=3)
        normal, position = best(found, true.camera_from_marker)
        assert normal < 1e-6
        assert position < 1e-6
        if found.focal_px is not None:
            measured += 1
            assert found.focal_px == pytest.approx(true.camera.K[0, 0], rel=1e-6)
        assert found.identity == 3
    assert measured > 0.9 * scenes


@pytest.mark.parametrize("family", DICTIONARIES)
def test_each_dictionary_is_read_through_a_lens(tmp_path, family):
    dataset = make_dataset(
        tmp_path / "ds", STUDY.replace("MARKER", f"{{kind: tags, tag_m: 0.08, family: {family}, first_id: 7}}")
    )
    for view, pose in views_of(dataset):
        (found,) = find(view)
        normal, position = best(found, pose)
        # A hundredth of a pixel in the corners of a square of 50 px is 0.1 degrees and 0.03 %.
        assert normal < 0.5
        assert position < 0.001
        assert found.identity == 7
        assert found.chosen is not None
        assert float(angle_deg(found.poses[found.chosen][0], pose[:3, 2])) == normal
        assert abs(np.log(found.focal_px / 400)) < 4 * found.focal_sigma_px / found.focal_px


def test_light_tags_on_dark_paper_are_read(tmp_path):
    dataset = make_dataset(
        tmp_path / "ds", STUDY.replace("MARKER", "{kind: tags, tag_m: 0.08, inverted: true, first_id: 9}")
    )
    for view, pose in views_of(dataset):
        (found,) = find(view)
        assert found.identity == 9
        assert best(found, pose)[0] < 0.5


def test_a_board_of_tags_is_one_marker(tmp_path):
    board = "{kind: tags, columns: 3, rows: 2, tag_m: 0.04, gap_m: 0.01, family: aruco_4x4_50, first_id: 11}"
    dataset = make_dataset(tmp_path / "ds", STUDY.replace("MARKER", board))
    for view, pose in views_of(dataset):
        (found,) = find(view)
        normal, position = best(found, pose)
        assert normal < 0.15
        assert position < 0.0005
        assert found.identity is None
        # The same tags as those of another board.
        other = [{**m, "layout": {**m["layout"], "first_id": 30}} for m in view.markers]
        (nothing,) = find(replace(view, markers=other))
        assert "no tag of the board was found; its identities are 30 to 35" in nothing.failure


def test_the_focal_length_is_fused_with_a_prior_and_the_poses_follow(tmp_path):
    dataset = make_dataset(tmp_path / "ds", STUDY.replace("MARKER", "{kind: tags, tag_m: 0.08, first_id: 7}"))
    alone, fused = [], []
    for view, pose in views_of(dataset):
        k = view.camera.K.copy()
        k[:2, :2] *= 1.12
        wrong = replace(view.camera, K=k, distortion=())
        straight = replace(view, camera=wrong, focal_sigma=0.115)
        (found,) = find(straight)
        assert found.camera.K[0, 0] == pytest.approx(found.camera.K[1, 1])
        alone.append(best(find(replace(straight, focal_sigma=0.0))[0], pose)[1])
        fused.append(best(found, pose)[1])
        assert abs(np.log(found.camera.K[0, 0] / 400)) < np.log(1.12)
    assert np.median(fused) < 0.5 * np.median(alone)


def test_a_tag_too_small_for_its_edges_has_poses_but_no_choice(tmp_path):
    """OpenCV's corners stand in, with their larger error: what they cannot decide is left open."""
    text = STUDY.replace("MARKER", "{kind: tags, tag_m: 0.08, family: aruco_4x4_50, first_id: 3}")
    text = text.replace("[0.45, 0.8]", "[2.6, 3.0]").replace("frames: 6", "frames: 12")
    found = []
    for view, pose in views_of(make_dataset(tmp_path / "ds", text)):
        try:
            found.append((find(view)[0], pose))
        except MethodFailure:
            continue
    assert len(found) >= 6
    errors = [best(one, pose) for one, pose in found]
    # Half a pixel in a side of 11 px.
    assert np.median([normal for normal, _ in errors]) < 10
    assert np.median([position for _, position in errors]) < 0.05
    assert sum(one.chosen is None for one, _ in found) >= 0.8 * len(found)
    assert all(one.focal_px is None for one, _ in found)


def plain(**changes: Any) -> View:
    markers = [
        {
            "marker_id": 0,
            "kind": "tags",
            "diameter_m": None,
            "layout": {"columns": 1, "rows": 1, "tag_m": 0.08, "family": "aruco_4x4_50"},
        }
    ]
    return replace(View(np.full((120, 160), 200, np.uint8), pinhole(300), 0.08, markers), **changes)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({}, "no tag of aruco_4x4_50 was found"),
        ({"markers": []}, "no tag of apriltag_36h11, aruco_4x4_50, aruco_5x5_100, aruco_6x6_250 was found"),
        ({"markers": [{"kind": "disc", "layout": {}}]}, "reads tags; the printed marker is disc"),
        (
            {"markers": [{"kind": "tags", "layout": {"columns": 1, "rows": 1, "tag_m": 1.0, "family": "chilitags"}}]},
            "the printed tag is chilitags",
        ),
        (
            {
                "markers": [
                    {"kind": "tags", "layout": {"columns": 1, "rows": 1, "tag_m": m, "family": "aruco_4x4_50"}}
                    for m in (0.1, 0.2)
                ]
            },
            "tags of aruco_4x4_50 are printed in several sizes",
        ),
    ],
)
def test_what_it_cannot_read_is_refused_in_one_sentence(changes, sentence):
    with pytest.raises(MethodFailure, match=sentence) as caught:
        find(plain(**changes))
    assert "\n" not in str(caught.value)


def test_another_dictionary_is_not_read(tmp_path):
    dataset = make_dataset(tmp_path / "ds", STUDY.replace("MARKER", "{kind: tags, tag_m: 0.08, family: aruco_6x6_250}"))
    for view, _ in views_of(dataset):
        markers = [{**m, "layout": {**m["layout"], "family": "apriltag_36h11"}} for m in view.markers]
        with pytest.raises(MethodFailure, match="no tag of apriltag_36h11 was found"):
            find(replace(view, markers=markers))


def test_a_tag_that_faces_the_camera_has_no_focal_length(tmp_path):
    text = STUDY.replace("MARKER", "{kind: tags, tag_m: 0.08}").replace("tilt_deg: {uniform: [15, 55]}", "tilt_deg: 0")
    dataset = make_dataset(tmp_path / "ds", text)
    for view, pose in views_of(dataset):
        (found,) = find(view)
        assert found.focal_px is None or found.focal_sigma_px / found.focal_px > 0.1
        assert best(found, pose)[1] < 0.002


def test_edges_are_located_below_a_fiftieth_of_a_pixel(tmp_path):
    """OpenCV's own corners are off by a tenth and more; the stated covariance holds."""
    dataset = make_dataset(
        tmp_path / "ds", STUDY.replace("MARKER", "{kind: tags, tag_m: 0.08}").replace("frames: 6", "frames: 30")
    )
    errors, rough, chi2 = [], [], []
    for view, pose in views_of(dataset):
        true = transform_points(pose, tag_corners_m(0.08))
        flat = true[:, :2] / true[:, 2:] * 400 + view.camera.K[:2, 2]
        ((_, corners),) = detected_tags(view.grey, "apriltag_36h11")
        quad = refine_quad(view.grey, corners, 1 / 8, view.camera)
        error = (quad.corners_px - flat).ravel()
        errors.append(error)
        rough.append(corners - distort_px(view.camera, flat))
        chi2.append(error @ np.linalg.solve(quad.cov_px2, error))
    assert np.sqrt(np.mean(np.square(errors))) < 0.02
    assert np.sqrt(np.mean(np.square(rough))) > 0.1
    # 8 coordinates; a third to twice as much is what a floor for clean images costs.
    assert 8 / 4 < np.mean(chi2) < 8 * 2


def test_a_square_without_edges_is_not_refined():
    flat = np.full((100, 100), 128.0)
    assert refine_quad(flat, SQUARE[:, :2] * 500 + 50, 1 / 6, Camera(100, 100, np.eye(3))) is None
    tiny = SQUARE[:, :2] * 60 + 50
    assert refine_quad(flat, tiny, 1 / 6, Camera(100, 100, np.eye(3))) is None
