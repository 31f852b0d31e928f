"""What a method is told of the printed markers, and the other views of a frame's set; measured focal lengths."""

import math
from importlib.metadata import EntryPoint

import numpy as np
import pyarrow.parquet as pq
import pytest

from roundel.datasets.layout.images import open_images
from roundel.render.run import render_study
from roundel.scenes.camera.model import Camera
from roundel.scenes.study.study import load_study
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera
from roundel.solver.methods import registry
from roundel.solver.methods.companions import SET_SIZE, companions_of, printed_markers
from roundel.solver.methods.plugin import Found, MethodFailure
from roundel.solver.methods.solve import solve_dataset

K = np.array([[420.0, 0, 159.5], [0, 420.0, 119.5], [0, 0, 1]])
GIVEN = UncertainCamera(Camera(320, 240, K), focal_sigma=0.115)
POSE = [(np.array([0.0, 0.6, -0.8]), np.array([0.0, 0.0, 0.4]))]


@pytest.fixture(scope="module")
def tags(tmp_path_factory):
    """Eight tags, and a disc by another camera."""
    folder = tmp_path_factory.mktemp("tags")
    study = folder / "study.yaml"
    study.write_text(
        """
schema: 1
name: tags
seed: 3
camera: {width_px: 160, height_px: 120, focal_px: 300}
pose: {distance_m: 0.6, tilt_deg: {uniform: [5, 40]}}
light: {environment: 1.0}
render: {target_error: 0.05, radiance: false}
groups:
  tag: {frames: 8, marker: {kind: tags, tag_m: 0.08, first_id: 17}}
  disc: {frames: 1, marker: {kind: disc, diameter_m: 0.08}}
"""
    )
    render_study(load_study(study), folder / "data")
    return folder / "data"


def test_the_sets_of_a_group_share_their_views(tags):
    images = open_images(tags)
    assert [len(companions_of(images, i, 0.08, GIVEN)) for i in range(9)] == [SET_SIZE - 1] * 6 + [1, 1, 0]
    views = companions_of(images, 0, 0.08, GIVEN)
    assert all(np.array_equal(view.image, images.image(i)) for i, view in enumerate(views, start=1))
    assert views[0].camera is GIVEN.camera
    assert views[0].focal_sigma == 0.115
    assert views[0].companions() == []


def test_a_method_is_not_told_the_identity(tags):
    images = open_images(tags)
    assert images.markers(0)[0]["layout"]["first_id"] == 17
    assert "first_id" not in printed_markers(images, 0)[0]["layout"]
    assert images.markers(0)[0]["size_m"] == [0.08, 0.08]


def find(view):
    """A focal length and an identity, and why the disc has none."""
    if view.markers[0]["kind"] == "disc":
        raise MethodFailure("it reads tags; the printed marker is a disc")
    assert view.diameter_m == pytest.approx(math.sqrt(4 / math.pi) * 0.08)
    return [Found(poses=POSE, identity=17, focal_px=310.0, focal_sigma_px=9.0), Found(failure="the code is damaged")]


def test_focal_length_identity_and_failures_are_recorded(tags, tmp_path, monkeypatch):
    entry = EntryPoint("mine", f"{__name__}:find", registry.GROUP)
    monkeypatch.setattr(registry, "entry_points", lambda group: [entry])
    monkeypatch.setattr(EntryPoint, "load", lambda self: find)
    solve_dataset(tags, tmp_path, ["mine"], ["default"])
    rows = pq.read_table(tmp_path / "estimates.parquet").to_pylist()
    assert len(rows) == 17
    for good, bad in zip(rows[0:16:2], rows[1:16:2], strict=True):
        assert (good["identity"], good["focal_px"], good["focal_sigma_px"]) == (17, 310.0, 9.0)
        assert bad["status"] == "failed"
        assert bad["reason"] == "mine: the code is damaged"
    assert rows[16]["reason"] == "mine: it reads tags; the printed marker is a disc"


@pytest.mark.parametrize(
    ("found", "reason"),
    [
        (Found(poses=POSE, focal_px=-3.0), "its focal length is -3 px"),
        (Found(poses=POSE, focal_px=np.nan), "its focal_px is not finite"),
        (Found(poses=POSE, focal_px=3.0, focal_sigma_px=-1.0), "is negative"),
        (Found(poses=POSE, camera="phone"), "its camera is a str"),
    ],
)
def test_impossible_focal_lengths_and_cameras_are_refused(found, reason):
    from roundel.solver.methods.plugin import View, check_found

    with pytest.raises(ValueError, match=reason):
        check_found(found, View(np.zeros((240, 320), np.uint8), GIVEN.camera, 0.08))
