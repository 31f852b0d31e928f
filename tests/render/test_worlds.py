"""A sheet in a world: the same geometry as in the laboratory, lit by what stands around it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers_studies import small_study

from roundel.datasets.fidelity.measure import measure_circle
from roundel.render.radiance import _estimate, _Shot, render_radiance
from roundel.render.rays.rays import optics_of
from roundel.render.scene.meshes import mesh_of
from roundel.render.scene.scene import WORLD_BOUNCES, build_scene, trace_built
from roundel.render.scene.textures import TILE_M, texture
from roundel.scenes.camera.model import ray_direction
from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic
from roundel.scenes.surroundings.bodies import Body, Material
from roundel.scenes.surroundings.objects import HOUSEHOLD, WORKSHOP
from roundel.scenes.world.frame import frame_of

LIGHT = "light: {environment: 0.7, lamps: [{position_m: [-0.3, -0.5, 0.0], size_m: 0.2, radiance: 6}]}"


def world_study(folder: Path, world: str, render: str = "target_error: 0.05, background_error: 0.2"):
    return small_study(folder, (LIGHT, f"world: {world}"), ("band_samples: 256", render))


def _on_sheet(frame):
    """Pixels (H, W) whose centre sees the sheet's rectangle."""
    pose, (h, w) = frame.camera_from_sheet, (frame.camera.height_px, frame.camera.width_px)
    rays = ray_direction(frame.camera, np.stack(np.meshgrid(np.arange(w), np.arange(h)), axis=-1).reshape(-1, 2))
    distance = (pose[:3, 3] @ pose[:3, 2]) / (rays @ pose[:3, 2])
    across = (rays * distance[:, None] - pose[:3, 3]) @ pose[:3, :2]
    return ((across > frame.sheet.low_m) & (across < frame.sheet.high_m)).all(axis=1).reshape(h, w)


@pytest.mark.parametrize("world", ["tabletop", "room", "shelf", "workshop"])
def test_the_sheet_is_where_the_pose_says(mi, tmp_path: Path, world: str) -> None:
    frame = frame_of(world_study(tmp_path, world), 1)
    radiance = render_radiance(mi, frame)
    assert radiance.mean.min() >= 0
    part = frame.sheet.parts[0]
    ellipse = ellipse_of_conic(conic_of_circle(frame.camera_from_part(part), part.radius_m, frame.camera.K))
    # Nothing hides the disc: its coverage is the area of its ellipse. Pixels of the edge have 64 rays or more each.
    assert radiance.coverage[0].sum() == pytest.approx(np.pi * ellipse[2] * ellipse[3], rel=3e-3)
    inside = radiance.coverage[0] == 1.0
    rows, columns = np.nonzero(inside)
    rays = ray_direction(frame.camera, np.column_stack([columns, rows]).astype(float))
    pose = frame.camera_from_sheet
    distance = (pose[:3, 3] @ pose[:3, 2]) / (rays @ pose[:3, 2])
    # A pixel's depth is that at its centre.
    ratio = radiance.depth_m[inside] / (rays[:, 2] * distance)
    np.testing.assert_allclose(ratio, 1.0, rtol=1e-5)
    # Ink and paper are lit alike: their radiances have the ratio of their reflectances, within the Monte-Carlo noise.
    paper = _on_sheet(frame) & (radiance.coverage[0] == 0)
    marker = frame.settings.marker
    ratio = radiance.mean[inside].mean() / np.median(radiance.mean[paper])
    assert ratio == pytest.approx(marker.ink / marker.paper, rel=0.25)


def test_outdoors_has_sun_and_sky(rgb, tmp_path: Path) -> None:
    frame = frame_of(world_study(tmp_path, "outdoor"), 0)
    radiance = render_radiance(rgb, frame)
    assert (radiance.mean > 0).mean() > 0.99
    assert radiance.coverage[0].max() == 1.0


@pytest.mark.parametrize("maker", sorted({*HOUSEHOLD, *WORKSHOP}, key=lambda m: m.__name__))
def test_objects_are_closed_and_face_outward(maker) -> None:
    up = np.array([0.0, -1.0, 0.0])
    for seed in range(4):
        body = maker(np.random.default_rng(seed), np.zeros(3), up)
        mesh = mesh_of(body)
        a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
        # The divergence theorem: a mesh whose faces all look outward encloses a positive volume.
        assert np.sum(np.cross(b - a, c - a) * a) / 6 > 0
        face = np.cross(b - a, c - a)
        area = np.linalg.norm(face, axis=1)
        normal = mesh.normals[mesh.faces].mean(axis=1)
        large = area > 1e-3 * area.max()
        assert np.all(np.sum(face * normal, axis=1)[large] > 0)
        # It stands on its foot, and its bounding box holds it.
        world = mesh.vertices @ body.camera_from_body[:3, :3].T + body.camera_from_body[:3, 3]
        assert (world @ up).min() == pytest.approx(0.0, abs=5e-3)
        assert np.all(np.abs(mesh.vertices) <= body.half_m * 1.001 + 1e-6)


def test_boxes_have_texture_at_scale() -> None:
    body = Body("box", np.eye(4), np.array([0.5, 0.2, 0.1]), Material("brick", (0.4, 0.2, 0.1)))
    mesh = mesh_of(body)
    for face in mesh.faces:
        a, b, c = mesh.vertices[face]
        u, v, w = mesh.uv_m[face]
        assert np.linalg.norm(v - u) == pytest.approx(np.linalg.norm(b - a))
        assert np.linalg.norm(w - u) == pytest.approx(np.linalg.norm(c - a))


@pytest.mark.parametrize("kind", sorted(TILE_M))
def test_textures_repeat_without_a_seam_and_keep_their_mean(kind: str) -> None:
    tile = texture(kind, (0.4, 0.3, 0.2), 1).astype(float)
    assert tile.shape == (512, 512, 3)
    across = np.abs(tile[:, 0] - tile[:, -1]).mean() / np.abs(np.diff(tile, axis=1)).mean()
    down = np.abs(tile[0] - tile[-1]).mean() / np.abs(np.diff(tile, axis=0)).mean()
    # A seam would show as a step many times that between neighbours.
    assert max(across, down) < 2.5
    assert tile.mean(axis=(0, 1))[0] == pytest.approx(0.4, rel=0.2)


@pytest.mark.parametrize("world", ["tabletop", "workshop"])
def test_paths_agree_with_mitsubas_integrator(mi, tmp_path: Path, world: str) -> None:
    frame = frame_of(world_study(tmp_path, world), 1)
    built = build_scene(mi, frame)
    assert built.bounces == WORLD_BOUNCES
    depth = WORLD_BOUNCES + 1
    plain = replace(built, lit=None, integrator=mi.load_dict({"type": "path", "max_depth": depth, "rr_depth": 99}))
    found = [measure(mi, frame, built, 64), measure(mi, frame, plain, 256)]
    means, variances = zip(*found, strict=True)
    # 2,000 pixels, each of whose means has an error known from its replicates: by different random numbers all agree
    # within three standard errors, over the image and in each of its 16 parts (four, for there are many).
    parts = [np.arange(len(means[0])), *np.array_split(np.arange(len(means[0])), 16)]
    for part, most in zip(parts, [3.0, *16 * [4.0]], strict=True):
        error = np.sqrt(variances[0][part].sum() + variances[1][part].sum()) / len(part)
        assert abs(means[0][part].mean() - means[1][part].mean()) < most * error
    assert means[0].min() >= 0


def test_paths_count_every_reflection_asked_for(mi, tmp_path: Path) -> None:
    frame = frame_of(world_study(tmp_path, "tabletop"), 1)
    built = build_scene(mi, frame)
    for bounces in (1, 2):
        one = replace(built, bounces=bounces)
        plain = replace(
            built, lit=None, integrator=mi.load_dict({"type": "path", "max_depth": bounces + 1, "rr_depth": 99})
        )
        (a, var_a), (b, var_b) = measure(mi, frame, one, 64), measure(mi, frame, plain, 256)
        assert abs(a.mean() - b.mean()) < 3 * np.sqrt(var_a.sum() + var_b.sum()) / len(a)


def measure(mi, frame, built, samples):
    import drjit as dr

    shot = _Shot(dr, mi, frame, optics_of(dr, mi, frame), lambda sampler, ray: trace_built(built, sampler, ray))
    pixels = np.arange(0, frame.camera.width_px * frame.camera.height_px, 9)
    mean, variance = _estimate(shot, pixels, samples, 5, ())[:2].astype(float)
    return mean, variance


@pytest.mark.parametrize(("world", "index"), [("tabletop", 2), ("room", 3)])
def test_fidelity_is_measured_in_a_world(mi, tmp_path: Path, world: str, index: int) -> None:
    frame = frame_of(world_study(tmp_path, world, "target_error: 0.01, background_error: 0.3"), index)
    radiance = render_radiance(mi, frame)
    found = measure_circle(frame, 0, radiance.mean, radiance.variance)
    assert "reason" not in found
    # Within four standard errors, which the paths' noise gives: some 0.003 px at this error of a pixel.
    assert found["shift_se_px"] < 0.006
    assert abs(found["shift_x_px"]) < 4 * found["shift_se_px"]
    assert abs(found["shift_y_px"]) < 4 * found["shift_se_px"]
    # Above 1.6 the edge of a shadow would be named; noise alone has 1.
    assert 0.5 < found["chi2_left"] < 1.6
    # A renderer that were 0.05 px off would be found.
    k = frame.camera.K.copy()
    k[0, 2] -= 0.05
    moved = measure_circle(replace(frame, camera=replace(frame.camera, K=k)), 0, radiance.mean, radiance.variance)
    assert moved["shift_x_px"] - found["shift_x_px"] == pytest.approx(0.05, abs=0.003)
