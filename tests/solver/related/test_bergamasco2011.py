import numpy as np
import pytest
from helpers_prints import drawn, plane_homography, plane_view, small_view, view_of

from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic
from roundel.scenes.geometry.pose import angle_deg
from roundel.scenes.markers.dot_codes import SECTORS, dot_code_words, dots_of, inked_places
from roundel.solver.methods.plugin import MethodFailure
from roundel.solver.related.bergamasco2011 import decode, find, homography_of_dots
from roundel.solver.views.homography_pose import MeasuredHomography, moved, poses_of_homography


def image_of_dots(discs: np.ndarray, seed: int, **keys: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    pose, K = small_view(np.random.default_rng(seed))
    return drawn((96, 96), plane_homography(pose, K), discs, np.ones(len(discs)), **keys), pose, K


def test_exact_ellipses_of_dots_give_the_exact_pose_over_500_scenes() -> None:
    rng = np.random.default_rng(1)
    worst = np.zeros(2)
    for n in range(500):
        pose, K = plane_view(rng)
        dots = dots_of(n % 40)
        centres = []
        for x, y, r in dots:
            about = pose.copy()
            about[:3, 3] += pose[:3, 0] * x + pose[:3, 1] * y
            centres.append(ellipse_of_conic(conic_of_circle(about, r, K))[:2])
        start = moved(plane_homography(pose, K), rng.normal(0, 0.01, 8))
        found = homography_of_dots(np.array(centres), dots, start)
        assert found is not None
        best = poses_of_homography(MeasuredHomography(found, 1e-6 * np.eye(8)), K)[0]
        centre = pose[:3, 3]
        errors = angle_deg(best.normal, pose[:3, 2]), np.linalg.norm(best.centre - centre) / np.linalg.norm(centre)
        worst = np.maximum(worst, errors)
    assert worst.max() < 1e-6


def test_centres_of_ellipses_taken_for_those_of_dots_are_wrong() -> None:
    # What the correction is for: near, at 60 degrees, they differ by more than a fit's precision.
    pose, K = plane_view(np.random.default_rng(2), tilt_deg=(60.0, 60.0), distance=(8.0, 8.0))
    x, y, r = dots_of(0)[0]
    about = pose.copy()
    about[:3, 3] += pose[:3, 0] * x + pose[:3, 1] * y
    ray = K @ about[:3, 3]
    assert np.hypot(*(ellipse_of_conic(conic_of_circle(about, r, K))[:2] - ray[:2] / ray[2])) > 0.01


def test_every_word_is_decoded_in_every_rotation_with_one_wrong_sector_or_two_unsure_ones() -> None:
    sure = np.zeros(2 * SECTORS, dtype=bool)
    for identity, word in enumerate(dot_code_words()):
        inked = inked_places(word).reshape(2, SECTORS)
        for turn in range(SECTORS):
            present = np.roll(inked, turn, axis=1).ravel()
            assert decode(present, sure) == (identity, turn, 0)
            wrong, unsure = present.copy(), sure.copy()
            wrong[(3 * identity + turn) % 22] ^= True
            read = decode(wrong, sure)
            # A sector that loses its only dot is seen to be damaged; one that gains or loses one of two is not.
            assert read is not None
            assert read[:2] == (identity, turn)
            assert read[2] in (1, 2)
            unsure[[turn, (turn + 4) % SECTORS]] = True
            assert decode(present, unsure) == (identity, turn, 2)


def test_a_word_with_two_wrong_sectors_is_detected() -> None:
    word = inked_places(dot_code_words()[3])
    word[[0, 5, SECTORS + 8]] ^= True
    assert decode(word, np.zeros(22, dtype=bool)) is None


def test_drawn_markers_are_read_and_located() -> None:
    errors = []
    for identity in range(0, 40, 2):
        levels, pose, K = image_of_dots(dots_of(identity), 100 + identity)
        (found,) = find(view_of(levels, K, "dot_code", {"id": (identity + 1) % 40}))
        assert found.identity == identity  # and not what the layout says
        ((normal, centre),) = found.poses
        errors.append([angle_deg(normal, pose[:3, 2]), np.linalg.norm(centre - pose[:3, 3]) / pose[2, 3]])
    worst = np.max(errors, axis=0)
    # 16-bit levels and a drawing with steps of 1/10 px: 0.001 px of a radius of 20.
    assert worst[0] < 0.2
    assert worst[1] < 1e-3


def test_light_dots_on_dark_are_read() -> None:
    levels, _, K = image_of_dots(dots_of(9), 3, paper=12.0, ink=200.0)
    (found,) = find(view_of(levels, K, "dot_code"))
    assert found.identity == 9


def test_one_dot_too_few_is_corrected() -> None:
    levels, _, K = image_of_dots(np.delete(dots_of(6), 2, axis=0), 4)
    (found,) = find(view_of(levels, K, "dot_code"))
    assert found.identity == 6
    assert found.confidence is not None
    assert found.confidence < 1


def test_another_kind_of_marker_is_refused() -> None:
    levels, _, K = image_of_dots(dots_of(6), 5)
    with pytest.raises(MethodFailure, match="it reads dot_code; the printed marker is dot_ring"):
        find(view_of(levels, K, "dot_ring"))


def test_too_few_dots_are_refused() -> None:
    levels, _, K = image_of_dots(dots_of(6)[:8], 6)
    with pytest.raises(MethodFailure, match="8 dots are found; a marker has 11 or more"):
        find(view_of(levels, K, "dot_code"))


def test_a_code_that_is_none_is_refused() -> None:
    # All dots of both rings: the constant word, which has no rotation of its own.
    from roundel.scenes.markers.dot_codes import dot_places

    levels, _, K = image_of_dots(dot_places(), 7)
    with pytest.raises(MethodFailure, match="no word of the bank"):
        find(view_of(levels, K, "dot_code"))


def test_an_empty_image_is_refused() -> None:
    _, K = small_view(np.random.default_rng(8))
    with pytest.raises(MethodFailure, match="0 dots are found"):
        find(view_of(np.full((96, 96), 180.0), K, "dot_code"))
