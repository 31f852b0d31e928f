"""The tracker on drawn sequences: identities, branches, births and deaths."""

import numpy as np
import pytest
from helpers_video import CAMERA, DIAMETER_M, HEIGHT, WIDTH, image_of, pose

import roundel
from roundel.scenes.camera.model import project
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera
from roundel.solver.tracking import tracker as module
from roundel.solver.tracking.tracker import Tracker

RATE = 30.0
BLANK = image_of([])


def carried(k: int, t: float) -> np.ndarray:
    """Two markers that cross at 0.9 s, one in front of the other."""
    if k == 0:
        return pose([0.11 * np.sin(1.6 * (t - 0.9)), 0.03 * np.cos(t), 0.55], 35 + 5 * np.sin(t), 40)
    return pose([-0.16 * np.sin(1.4 * (t - 0.9)), -0.03 * np.cos(t), 0.8], 42 + 5 * np.sin(1.2 * t), 200)


def nearest(marker, poses) -> int:
    """Which of the poses a measured marker is."""
    centres = project(CAMERA, np.stack([one[:3, 3] for one in poses]))
    apart = np.linalg.norm(project(CAMERA, marker.estimate.centre_m[0]) - centres, axis=1)
    assert apart.min() < 4.0
    return int(np.argmin(apart))


def test_two_markers_that_cross_keep_their_identities_and_settle_their_branch():
    tracker, owner, right, measured = Tracker(DIAMETER_M, CAMERA), {}, [], 0
    for i in range(75):
        poses = [carried(k, i / RATE) for k in (0, 1)]
        markers = tracker.update(image_of(poses[::-1], seed=i), i / RATE)
        assert [m.identity for m in markers] == [0, 1]
        for marker in (m for m in markers if m.estimate is not None):
            k = nearest(marker, poses)
            assert owner.setdefault(marker.identity, k) == k
            measured += 1
            assert marker.estimate.track_id == marker.identity
            assert marker.estimate.frame_id == i
            if i >= RATE:
                error = roundel.normal_error_deg(marker.estimate.normal, poses[k][:3, 2])
                right.append(marker.estimate.chosen == int(np.argmin(error)))
    assert sorted(owner.values()) == [0, 1]
    assert measured >= 130  # the hind one is hidden for some frames
    assert np.mean(right) >= 0.99


def test_markers_at_rest_tell_nothing():
    tracker, poses = Tracker(DIAMETER_M, CAMERA), [pose([0.03, 0.02, 0.6], 40, 30)]
    for i in range(60):
        (marker,) = tracker.update(image_of(poses, seed=i))
        estimate = marker.estimate
        assert estimate.chosen is None
        assert abs(estimate.probability[0] - 0.5) < 0.1
    assert "not told apart by the motion so far" in estimate.choice_basis


def test_what_is_declared_decides_at_once_and_is_not_counted_again():
    prior = [0.1, 0.3, -0.9]
    tracker = Tracker(DIAMETER_M, CAMERA, "linear", roundel_prior(prior))
    for i in range(40):
        (marker,) = tracker.update(image_of([pose([0.03, 0.02, 0.6], 40, 80)], seed=i))
        (alone,) = roundel.locate(
            image_of([pose([0.03, 0.02, 0.6], 40, 80)], seed=i), DIAMETER_M, CAMERA, "linear", roundel_prior(prior)
        )
        assert marker.estimate.chosen == alone.chosen
    first = alone.chosen
    # Forty looks at the same declaration are one declaration.
    assert abs(marker.estimate.probability[first] - alone.probability[first]) < 0.05


def roundel_prior(normal):
    from roundel.solver.ambiguity.normal_prior import NormalPrior

    return NormalPrior(np.array(normal), 15.0)


def test_a_marker_that_is_hidden_for_a_while_keeps_its_identity_and_is_then_forgotten():
    tracker, shown = Tracker(DIAMETER_M, CAMERA, memory_s=1.0), []
    for i in range(100):
        t = i / RATE
        hidden = 15 <= i < 30 or i >= 50
        one = pose([0.05 * np.sin(1.5 * t), 0.02, 0.6], 40, 30)
        shown.append(tracker.update(BLANK if hidden else image_of([one], seed=i), t))
    assert {m.identity for markers in shown for m in markers} == {0}
    gap = shown[20][0]
    assert gap.estimate is None
    assert gap.unseen_s == pytest.approx(6 / RATE)
    assert shown[49][0].frames >= 33  # found again at the next search of the whole image
    # Measured for the last time in frame 49, and forgotten after a second.
    assert len(shown[79]) == 1
    assert shown[80] == []


def test_a_false_positive_of_one_image_ends_with_it():
    tracker, disc = Tracker(DIAMETER_M, CAMERA), image_of([pose([0.03, 0.02, 0.6], 40, 30)])
    (marker,) = tracker.update(disc)
    assert not marker.confirmed
    assert tracker.update(BLANK) == []
    (again,) = tracker.update(disc)
    assert again.identity == 1


def test_the_whole_image_is_searched_now_and_then(monkeypatch):
    searched, detect_circles = [], module.detect_circles
    monkeypatch.setattr(module, "detect_circles", lambda *a, **k: searched.append(1) or detect_circles(*a, **k))
    tracker = Tracker(DIAMETER_M, CAMERA)
    for i in range(40):
        (marker,) = tracker.update(image_of([pose([0.002 * i, 0.02, 0.6], 40, 30)], seed=i))
        assert marker.estimate
    # Three frames until the track is confirmed, then every tenth.
    assert len(searched) == 3 + 3


def test_wrong_frames_are_refused_and_the_next_one_is_taken_up():
    tracker, disc = Tracker(DIAMETER_M, CAMERA), image_of([pose([0.03, 0.02, 0.6], 40, 30)])
    tracker.update(disc, 1.0)
    with pytest.raises(ValueError, match=r"after that of the last one \(1.0 s\), not 1.0"):
        tracker.update(disc, 1.0)
    with pytest.raises(ValueError, match="not nan"):
        tracker.update(disc, float("nan"))
    with pytest.raises(ValueError, match="the camera is for 320x240 px"):
        tracker.update(np.zeros((HEIGHT, WIDTH + 1), np.uint8), 2.0)
    (marker,) = tracker.update(disc, 1.1)
    assert marker.frames == 2
    with pytest.raises(ValueError, match="positive number of metres"):
        Tracker(0.0)


def test_errors_of_the_camera_do_not_hide_the_motion():
    # They are the same in all frames, and do not make the candidates' motion less certain.
    uncertain = UncertainCamera(CAMERA, focal_sigma=0.03, principal_sigma_px=10.0)
    exact, assumed = Tracker(DIAMETER_M, CAMERA, "linear"), Tracker(DIAMETER_M, uncertain, "linear")
    for i in range(20):
        image = image_of([carried(0, i / RATE)], seed=i)
        (one,), (other,) = exact.update(image), assumed.update(image)
    assert one.estimate.probability == pytest.approx(other.estimate.probability, abs=1e-6)
    assert other.estimate.cov[0, 2, 2] > 10 * one.estimate.cov[0, 2, 2]
