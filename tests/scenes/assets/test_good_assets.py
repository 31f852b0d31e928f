"""Meshes as plain arrays, the anchor, and what a mesh hides, against values known by hand."""

from pathlib import Path

import numpy as np
import pytest
from helpers_assets import LIGHT, TABLE_M, own_study, table, write_table
from hypothesis import given
from hypothesis import strategies as st

from roundel.scenes.assets.anchor import scene_from_sheet, top_m
from roundel.scenes.assets.files import digest_of
from roundel.scenes.assets.meshes import UserMesh, load_meshes, mesh_checksums
from roundel.scenes.assets.visibility import hidden_by
from roundel.scenes.errors import StudyError
from roundel.scenes.study.identity import frame_numbers
from roundel.scenes.study.study import load_study
from roundel.scenes.world.frame import frame_of, frames_of


def meshes_in(folder: Path, name: str) -> dict[str, UserMesh]:
    found = load_meshes(folder, name, digest_of(mesh_checksums(folder, name)))
    return {mesh.name: mesh for mesh in found}


def test_a_glb_keeps_its_looks(tmp_path: Path) -> None:
    write_table(tmp_path)
    found = meshes_in(tmp_path, "table.glb")
    top, slab = found["top"], found["slab"]
    assert top.look.texture.shape == (64, 64, 3)
    assert (top.look.metallic, top.look.roughness) == (0.0, 0.9)
    # v runs downward: the far edge, at -z, is the texture's top row.
    np.testing.assert_allclose(top.uv[top.vertices[:, 2] < 0][:, 1], 0.0, atol=1e-6)
    # trimesh keeps factors in bytes.
    np.testing.assert_allclose(slab.look.colour, [0.4, 0.2, 0.1], atol=1 / 255)
    assert slab.look.texture is None


def test_placed_and_repeated_nodes(tmp_path: Path) -> None:
    import trimesh

    scene = trimesh.Scene()
    ball = trimesh.creation.icosphere(1, 1.0)
    for i in range(3):
        place = np.diag([2.0, 1.0, 1.0, 1.0])
        place[:3, 3] = [10.0 * i, 0, 0]
        scene.add_geometry(ball, geom_name="ball", transform=place)
    (tmp_path / "balls.glb").write_bytes(scene.export(file_type="glb"))
    found = load_meshes(tmp_path, "balls.glb", digest_of(mesh_checksums(tmp_path, "balls.glb")))
    middles = sorted(float(mesh.vertices[:, 0].mean()) for mesh in found)
    np.testing.assert_allclose(middles, [0, 10, 20], atol=1e-6)
    for mesh in found:
        # An ellipsoid's normal is its gradient, not the stretched normal of the ball.
        if mesh.normals is not None:
            gradient = (mesh.vertices - mesh.vertices.mean(axis=0)) / [4.0, 1.0, 1.0]
            gradient /= np.linalg.norm(gradient, axis=1, keepdims=True)
            np.testing.assert_allclose(mesh.normals, gradient, atol=1e-5)


def test_colours_of_vertices_are_linear(tmp_path: Path) -> None:
    import trimesh

    square = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 0, 1]], [[0, 2, 1]], process=False)
    square.visual.vertex_colors = np.full((3, 4), [128, 0, 255, 255], dtype=np.uint8)
    (tmp_path / "a.ply").write_bytes(square.export(file_type="ply"))
    found = meshes_in(tmp_path, "a.ply")
    (mesh,) = found.values()
    np.testing.assert_allclose(mesh.look.vertex_colours, [[0.2159, 0.0, 1.0]] * 3, atol=1e-4)
    assert mesh.normals is None


direction = st.tuples(*3 * [st.floats(-1, 1)]).filter(lambda v: np.linalg.norm(v) > 0.1)


@given(direction, direction, st.tuples(*3 * [st.floats(-5, 5)]), st.floats(1e-4, 0.05))
def test_an_anchor_is_a_rigid_pose(normal, up, position, thickness_m) -> None:
    across = np.linalg.norm(np.cross(normal, up)) / np.linalg.norm(normal) / np.linalg.norm(up)
    if across < 1e-3:
        return
    pose = scene_from_sheet(position, normal, up, thickness_m)
    np.testing.assert_allclose(pose[:3, :3].T @ pose[:3, :3], np.eye(3), atol=1e-12)
    assert np.linalg.det(pose[:3, :3]) > 0
    assert pose[:3, 2] @ normal > 0
    assert pose[:3, 1] @ up > 0
    np.testing.assert_allclose(pose[:3, 3] - thickness_m * pose[:3, 2], position, atol=1e-12)


def test_the_top_of_a_scene(tmp_path: Path) -> None:
    import trimesh

    (tmp_path / "a.glb").write_bytes(table(extra={"hat": trimesh.creation.icosphere(3, 0.2)}).export(file_type="glb"))
    found = list(meshes_in(tmp_path, "a.glb").values())
    np.testing.assert_allclose(top_m(found, 2.0, 1), [0, 2 * TABLE_M, 0], atol=1e-9)
    ring = [trimesh.creation.annulus(1.0, 2.0, 0.1)]
    empty = [UserMesh("ring", np.asarray(m.vertices), np.asarray(m.faces)) for m in ring]
    with pytest.raises(ValueError, match="nothing is in the middle of the scene"):
        top_m(empty, 1.0, 2)


@given(st.integers(0, 10_000))
def test_hidden_points_are_those_behind_a_triangle(seed: int) -> None:
    rng = np.random.default_rng(seed)
    eye, centre = rng.normal(size=3), rng.normal(size=3) + np.array([0, 0, 5])
    points = centre + 0.1 * rng.normal(size=(20, 3))
    triangles = rng.uniform(-1, 1, (30, 3, 3)) + eye + rng.uniform(0, 1.2, (30, 1, 1)) * (centre - eye)
    mesh = UserMesh("m", triangles.reshape(-1, 3), np.arange(90).reshape(-1, 3))
    # By volumes of tetrahedra: a segment meets a triangle if the signs agree.
    a, b, c = (triangles[:, None, i] for i in range(3))

    def volume(p, q, r, s):
        return np.sum(np.cross(q - p, r - p) * (s - p), axis=-1)

    p = points[None]
    sides = np.stack([volume(eye, p, a, b), volume(eye, p, b, c), volume(eye, p, c, a)])
    crosses = volume(a, b, c, np.broadcast_to(eye, a.shape)) * volume(a, b, c, p) < 0
    expected = (crosses & (np.abs(np.sign(sides).sum(axis=0)) == 3)).any(axis=0)
    found = hidden_by([mesh], eye, points)
    np.testing.assert_array_equal(found[0][1] if found else np.zeros(20, dtype=bool), expected)


def board_above(height_m: float):
    import trimesh

    board = trimesh.creation.box([0.02, 0.002, 0.02])
    board.apply_translation([0.02, TABLE_M + height_m, 0.0])
    return board


def test_a_marker_that_is_hidden_is_refused_with_the_name_of_what_hides_it(tmp_path: Path) -> None:
    write_table(tmp_path, extra={"lid": board_above(0.05)})
    study = own_study(tmp_path, f"{{scene: table.glb, anchor: {{position_m: [0, {TABLE_M}, 0]}}}}", LIGHT)
    with pytest.raises(StudyError, match=r"study.yaml:11:1: world.scene: the marker is hidden by 'lid' \(\d+%"):
        list(frames_of(study))
    # Beside the sight lines it is no harm.
    write_table(tmp_path, extra={"lid": board_above(0.05).apply_translation([0.3, 0, 0])})
    assert len(list(frames_of(load_study(tmp_path / "study.yaml")))) == 4


@pytest.mark.parametrize(("below_m", "seen"), [(0.0, True), (0.0002, True), (0.0004, False)])
def test_a_sheet_that_is_deeper_in_the_table_than_it_is_thick_is_hidden(
    tmp_path: Path, below_m: float, seen: bool
) -> None:
    write_table(tmp_path)
    study = own_study(tmp_path, f"{{scene: table.glb, anchor: {{position_m: [0, {TABLE_M - below_m}, 0]}}}}", LIGHT)
    if seen:
        frame_of(study, 0)
    else:
        with pytest.raises(StudyError, match="hidden by 'top'"):
            frame_of(study, 0)


def test_a_moving_camera_and_a_wide_lens_are_looked_through_wholly(tmp_path: Path) -> None:
    # A lid beside the still camera's sight, that a camera moving sideways passes.
    write_table(tmp_path, extra={"lid": board_above(0.3).apply_translation([0.03, 0, 0.175])})
    world = f"{{scene: table.glb, anchor: {{position_m: [0, {TABLE_M}, 0]}}}}"
    still = ("tilt_deg: {uniform: [10, 50]}", "tilt_deg: 30")
    far = ("distance_D: {uniform: [7, 9]}", "distance_m: 0.7")
    ahead = ("offset_x_px: {uniform: [-20, 20]}", "offset_x_px: 0")
    frame_of(own_study(tmp_path, world, LIGHT, still, far, ahead), 0)
    moving = "motion: {exposure_s: 0.1, frame_s: 0.2, camera: {velocity_m_s: [2, 0, 0]}}"
    with pytest.raises(StudyError, match="hidden by 'lid'"):
        frame_of(own_study(tmp_path, world, f"{LIGHT}\n{moving}", still, far, ahead), 0)
    wide = ("focal_px: 320", "focal_px: 320, aperture_mm: 120, focus_m: 0.7")
    with pytest.raises(StudyError, match="hidden by 'lid'"):
        frame_of(own_study(tmp_path, world, LIGHT, still, far, ahead, wide), 0)


def test_the_anchor_may_be_drawn_and_is_in_the_frames_identity(tmp_path: Path) -> None:
    write_table(tmp_path)
    anchor = f"anchor: {{position_m: [{{uniform: [-0.2, 0.2]}}, {TABLE_M}, {{uniform: [-0.2, 0.2]}}]}}"
    study = own_study(tmp_path, f"{{scene: table.glb, {anchor}}}", LIGHT)
    numbers = [frame_numbers(frame_of(study, i)) for i in range(4)]
    assert len({n["world"] for n in numbers}) == 4
    assert "world.anchor.position_m.0" in numbers[0]["drawn"]
    first = frame_of(own_study(tmp_path, "{scene: table.glb}", LIGHT), 0)
    for other in ("unit_m: 1.001, anchor: {position_m: [0, 0.7508, 0]}", "anchor: {position_m: [0.01, 0.75, 0]}"):
        assert frame_numbers(
            frame_of(own_study(tmp_path, f"{{scene: table.glb, {other}}}", LIGHT), 0)
        ) != frame_numbers(first)
    write_table(tmp_path, texture=np.zeros((4, 4, 3), dtype=np.uint8))
    again = frame_of(own_study(tmp_path, "{scene: table.glb}", LIGHT), 0)
    assert frame_numbers(again)["world"] != frame_numbers(first)["world"]


def test_a_mesh_is_read_once(tmp_path: Path) -> None:
    write_table(tmp_path)
    study = own_study(tmp_path, "{scene: table.glb}", LIGHT)
    before = load_meshes.cache_info().misses
    list(frames_of(study))
    assert load_meshes.cache_info().misses == before


@pytest.mark.parametrize("encoding", ["utf-8", "latin-1"])
def test_names_in_other_encodings(tmp_path: Path, encoding: str) -> None:
    (tmp_path / "tölpel.mtl").write_bytes("newmtl größe\nKd 0.2 0.4 0.6\n".encode(encoding))
    text = "mtllib tölpel.mtl\nv 0 0 0\nv 1 0 0\nv 0 0 -1\nusemtl größe\nf 1 2 3\n"
    (tmp_path / "a.obj").write_bytes(text.encode(encoding))
    (mesh,) = meshes_in(tmp_path, "a.obj").values()
    np.testing.assert_allclose(mesh.look.colour, [0.2, 0.4, 0.6], atol=1 / 255)
    assert mesh.look.metallic is None
