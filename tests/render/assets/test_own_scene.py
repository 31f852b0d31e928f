"""A sheet in the user's own scene: where the anchor says, lit by the study, over textures that stand upright."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers_assets import LIGHT, TABLE_M, arrow, own_study, png_bytes, table, write_table, write_xml

from roundel.datasets.fidelity.measure import measure_circle
from roundel.render.radiance import render_radiance
from roundel.render.run import render_study
from roundel.render.scene.scene import build_scene
from roundel.scenes.camera.model import project
from roundel.scenes.errors import DataError, StudyError
from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic
from roundel.scenes.geometry.pose import transform_points
from roundel.scenes.study.study import load_study
from roundel.scenes.truth.truth import truth_of
from roundel.scenes.world.frame import frame_of

FEW = ("render: {band_samples: 256}", "render: {target_error: 0.05, background_error: 0.1}")
ANCHOR = "anchor: {position_m: [0, 0.75, 0]}"


def seen_at(frame, point_scene) -> tuple[int, int]:
    """Row and column of a point of the scene."""
    camera = transform_points(frame.surroundings.scene.camera_from_scene, np.array([point_scene], dtype=float))
    column, row = project(frame.camera, camera)[0]
    return round(row), round(column)


def albedo(mi, frame, point_scene) -> np.ndarray:
    """Linear red, green and blue of the surface seen at a point of the scene."""
    toward = transform_points(frame.surroundings.scene.camera_from_scene, np.array([point_scene], dtype=float))[0]
    built = build_scene(mi, frame)
    ray = mi.RayDifferential3f(mi.Point3f(0.0, 0.0, 0.0), mi.Vector3f(*(toward / np.linalg.norm(toward)).tolist()))
    hit = built.scene.ray_intersect(ray)
    return np.array(hit.bsdf(ray).eval_diffuse_reflectance(hit)).ravel()


def test_the_sheet_lies_on_the_mesh_and_its_image_is_that_of_the_pose(mi, tmp_path: Path) -> None:
    write_table(tmp_path)
    study = own_study(tmp_path, "{scene: table.glb}", LIGHT, FEW)
    assert study.groups["main"].world.anchor.position_m == [0.0, TABLE_M, 0.0]
    frame = frame_of(study, 1)
    # The back of the sheet is on the table, the sheet's upper edge toward -z.
    scene_from_sheet = np.linalg.inv(frame.surroundings.scene.camera_from_scene) @ frame.camera_from_sheet
    np.testing.assert_allclose(transform_points(scene_from_sheet, [0, 0, -0.0003]), [0, TABLE_M, 0], atol=1e-12)
    np.testing.assert_allclose(scene_from_sheet[:3, :3], [[1, 0, 0], [0, 0, 1], [0, -1, 0]], atol=1e-12)
    radiance = render_radiance(mi, frame)
    part = frame.sheet.parts[0]
    ellipse = ellipse_of_conic(conic_of_circle(frame.camera_from_part(part), part.radius_m, frame.camera.K))
    # Pixels of the edge have 64 rays or more each.
    assert radiance.coverage[0].sum() == pytest.approx(np.pi * ellipse[2] * ellipse[3], rel=3e-3)
    # The table is where the scene has it: the depth beside the sheet is that of the table's plane.
    point = [0.1, TABLE_M, 0.02]
    row, column = seen_at(frame, point)
    depth = transform_points(frame.surroundings.scene.camera_from_scene, point)[2]
    # Half a pixel is 0.1 % of the depth here.
    assert radiance.depth_m[row, column] == pytest.approx(depth, rel=2e-3)
    assert radiance.coverage[0][row, column] == 0
    assert radiance.mean[row, column] > 0
    assert truth_of(frame)[0]["visible_fraction"] == 1.0
    # Another frame moves the loaded meshes; the first one comes out the same again.
    render_radiance(mi, frame_of(study, 2))
    np.testing.assert_array_equal(render_radiance(mi, frame).mean, radiance.mean)


def test_poses_are_those_of_the_plain_study(tmp_path: Path) -> None:
    write_table(tmp_path)
    own = own_study(tmp_path, f"{{scene: table.glb, {ANCHOR}}}", LIGHT)
    plain = own_study(tmp_path, "plain", LIGHT)
    for i in range(4):
        a, b = frame_of(own, i), frame_of(plain, i)
        np.testing.assert_array_equal(a.camera_from_sheet, b.camera_from_sheet)
        assert a.ray_seed == b.ray_seed


def test_textures_are_upright_and_linear(rgb, tmp_path: Path) -> None:
    # Its top quarter, toward -z, is red; its right quarter, toward +x, is blue; 128 of 255 is 21.6 % of light.
    write_table(tmp_path)
    frame = frame_of(own_study(tmp_path, "{scene: table.glb}", LIGHT, FEW), 0)
    red, blue, grey = (albedo(rgb, frame, [x, TABLE_M, z]) for x, z in ((0.1, -0.4), (0.4, 0.1), (-0.2, 0.1)))
    assert red[0] > 5 * red[2]
    assert blue[2] > 5 * blue[0]
    # The principled model reports its base colour.
    np.testing.assert_allclose(grey, 0.2159, rtol=0.01)


def test_a_mesh_shades_the_sheet_and_fidelity_holds(mi, tmp_path: Path) -> None:
    import trimesh

    # A board above the sheet, out of the camera's sight, between it and the lamp.
    board = trimesh.creation.box([0.3, 0.01, 0.3])
    lamp = "light: {environment: 0.01, lamps: [{position_m: [-0.3, -0.5, 0.0], size_m: 0.05, radiance: 60}]}"
    write_table(tmp_path)
    still = ("tilt_deg: {uniform: [10, 50]}", "tilt_deg: 40")
    exact = ("render: {band_samples: 256}", "render: {target_error: 0.01, background_error: 0.1}")
    frame = frame_of(own_study(tmp_path, "{scene: table.glb}", lamp, still, exact), 0)
    to_lamp = transform_points(np.linalg.inv(frame.surroundings.scene.camera_from_scene), [-0.3, -0.5, 0.0])
    board.apply_translation(0.4 * to_lamp + 0.6 * np.array([0.0, TABLE_M, 0.0]))
    write_table(tmp_path, "shaded.glb", extra={"board": board})
    found = render_radiance(mi, frame)
    study = own_study(tmp_path, f"{{scene: shaded.glb, {ANCHOR}}}", lamp, still, exact)
    shaded = render_radiance(mi, frame_of(study, 0))
    ink = found.coverage[0] == 1.0
    assert shaded.mean[ink].mean() < 0.3 * found.mean[ink].mean()
    measured = measure_circle(frame, 0, found.mean, found.variance)
    assert "reason" not in measured
    # Within four standard errors, which the paths' noise gives.
    assert measured["shift_se_px"] < 0.01
    assert abs(measured["shift_x_px"]) < 4 * measured["shift_se_px"]
    k = frame.camera.K.copy()
    k[0, 2] -= 0.05
    moved = measure_circle(replace(frame, camera=replace(frame.camera, K=k)), 0, found.mean, found.variance)
    assert moved["shift_x_px"] - measured["shift_x_px"] == pytest.approx(0.05, abs=0.003)


def test_units_anchors_and_axes(mi, tmp_path: Path) -> None:
    # The same table in centimetres with z up gives the same picture.
    write_table(tmp_path)
    turned = table()
    turned.apply_transform(np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]]))
    turned.apply_scale(100)
    (tmp_path / "centimetres.glb").write_bytes(turned.export(file_type="glb"))
    planes = []
    for world in ("{scene: table.glb}", "{scene: centimetres.glb, unit_m: 0.01, vertical: z}"):
        frame = frame_of(own_study(tmp_path, world, LIGHT, FEW), 2)
        planes.append(render_radiance(mi, frame).mean)
        np.testing.assert_allclose(frame.surroundings.up @ frame.camera_from_sheet[:3, 2], 1.0)
    # Not bit for bit: vertices are rounded differently; a ray in 10,000 may meet another edge.
    assert np.median(np.abs(planes[0] - planes[1])) < 1e-5
    np.testing.assert_allclose(planes[0].mean(), planes[1].mean(), rtol=1e-3)


def test_a_map_is_fixed_to_the_scene(rgb, tmp_path: Path) -> None:
    from helpers_light import light_from, write_map

    from roundel.render.scene.lights import emitters

    pixels = np.full((32, 64, 3), 0.01, dtype=np.float32)
    pixels[0] = 100.0
    write_map(tmp_path / "map.exr", pixels)
    write_table(tmp_path)
    for i in range(2):
        frame = frame_of(own_study(tmp_path, "{scene: table.glb}", "light: {map: {file: map.exr}}", FEW), i)
        up = frame.camera_from_sheet[:3, 2]
        light = light_from(rgb, emitters(rgb, frame)["environment"], np.stack([up, -up, [1.0, 0.0, 0.0]]))[:, 0]
        assert light[0] > 50
        assert light[1:].max() < 1


def test_point_lamps_light_a_scene_as_they_do_the_plain_sheet(mi, tmp_path: Path) -> None:
    from helpers_light import radiance_at

    write_table(tmp_path)
    lamp = "light: {environment: 0, lamps: [{kind: point, position_m: [-0.2, -0.3, 0.1], intensity: 1}]}"
    points = np.array([[0.0, 0.0], [0.03, 0.03]])
    found = [
        radiance_at(mi, frame_of(own_study(tmp_path, world, lamp, FEW), 0), points, 4096)
        for world in ("{scene: table.glb}", "plain")
    ]
    # Direct light is exact; the table adds what it reflects: nothing, as it lies below the sheet's face.
    np.testing.assert_allclose(found[0], found[1], rtol=2e-3)


@pytest.mark.parametrize("lit", [False, True])
def test_mitsubas_own_scenes(rgb, tmp_path: Path, lit: bool) -> None:
    lamp = '<shape type="rectangle" id="lamp"><transform name="to_world"><rotate x="1" angle="90"/><translate y="2.5"/>'
    lamp += '</transform><emitter type="area"><rgb name="radiance" value="3"/></emitter></shape>'
    write_xml(tmp_path, lamp if lit else "")
    frame = frame_of(own_study(tmp_path, f"{{scene: scene.xml, {ANCHOR}}}", "" if lit else LIGHT, FEW), 0)
    assert frame.surroundings.scene.has_lights == lit
    np.testing.assert_allclose(albedo(rgb, frame, [0.15, TABLE_M, 0.1]), [0.2, 0.3, 0.5], rtol=1e-5)
    first = render_radiance(rgb, frame)
    assert first.mean[first.coverage[0] == 1.0].mean() > 0.01
    # Another frame moves the loaded scene; the first one comes out the same again.
    render_radiance(rgb, frame_of(own_study(tmp_path, f"{{scene: scene.xml, {ANCHOR}}}", "" if lit else LIGHT, FEW), 1))
    np.testing.assert_array_equal(render_radiance(rgb, frame).mean, first.mean)


def test_a_scene_with_lights_of_its_own_needs_no_other(tmp_path: Path) -> None:
    write_xml(tmp_path, '<emitter type="constant"/>')
    with pytest.raises(StudyError, match=r"light: the scene has lights of its own; leave out light"):
        own_study(tmp_path, f"{{scene: scene.xml, {ANCHOR}}}", LIGHT)


def test_a_mitsuba_scene_that_hides_the_marker_is_refused_before_rendering(tmp_path: Path) -> None:
    write_xml(
        tmp_path,
        '<shape type="sphere" id="lid"><point name="center" x="0" y="0.85" z="0"/>'
        '<float name="radius" value="0.05"/></shape>',
    )
    study = own_study(tmp_path, f"{{scene: scene.xml, {ANCHOR}}}", LIGHT, FEW)
    with pytest.raises(StudyError, match=r"world.scene: the marker is hidden by 'lid'.*\(frame 0 of group main\)"):
        render_study(study, tmp_path / "ds")
    assert not (tmp_path / "ds").exists()


def test_a_mitsuba_scene_that_mitsuba_refuses_is_one_line(tmp_path: Path) -> None:
    write_xml(tmp_path, '<shape type="sphere"><float name="radios" value="1"/></shape>')
    with pytest.raises(StudyError, match=r"study.yaml:\d+:\d+: world.scene: .*Mitsuba refuses it") as caught:
        render_study(own_study(tmp_path, f"{{scene: scene.xml, {ANCHOR}}}", LIGHT, FEW), tmp_path / "ds")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "ds").exists()


def test_a_dataset_is_drawn_again_without_the_scene_and_refused_with_another(tmp_path: Path) -> None:
    write_table(tmp_path)
    study = own_study(tmp_path, "{scene: table.glb}", LIGHT, FEW, ("frames: 4", "frames: 2"))
    assert render_study(study, tmp_path / "ds", frames=range(1)) is None
    moved = tmp_path / "elsewhere"
    (tmp_path / "ds").rename(moved)
    # The study in the dataset stands alone, with the anchor and the checksums that were found.
    inside = load_study(moved / "study.yaml")
    assert inside.digest() == study.digest()
    np.testing.assert_array_equal(frame_of(inside, 1).camera_from_sheet, frame_of(study, 1).camera_from_sheet)
    write_table(tmp_path, texture=arrow(32))
    from roundel.scenes.errors import UsageError

    with pytest.raises(UsageError, match="holds frames of another study"):
        render_study(load_study(tmp_path / "study.yaml"), moved)


def test_a_scene_changed_while_it_is_rendered_is_refused(mi, tmp_path: Path) -> None:
    from roundel.scenes.assets.meshes import load_meshes

    write_table(tmp_path)
    frame = frame_of(own_study(tmp_path, "{scene: table.glb}", LIGHT, FEW), 0)
    write_table(tmp_path, texture=arrow(16))
    load_meshes.cache_clear()
    with pytest.raises(DataError, match="was changed"):
        build_scene(mi, frame)


def test_an_xml_with_meshes_and_textures(rgb, tmp_path: Path) -> None:
    import trimesh

    (tmp_path / "parts").mkdir()
    square = trimesh.Trimesh([[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]], [[0, 1, 2], [0, 2, 3]], process=False)
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    lines = [f"v {x} {y} {z}" for x, y, z in square.vertices] + [f"vt {u} {v}" for u, v in uv]
    (tmp_path / "parts" / "top.obj").write_text("\n".join([*lines, "f 1/1 2/2 3/3", "f 1/1 3/3 4/4"]))
    (tmp_path / "parts" / "top.png").write_bytes(png_bytes(arrow()))
    (tmp_path / "parts" / "scene.xml").write_text(
        """<scene version="3.0.0"><shape type="obj"><string name="filename" value="top.obj"/>
        <transform name="to_world"><scale value="0.5"/><translate y="0.75"/></transform>
        <bsdf type="twosided"><bsdf type="diffuse"><texture type="bitmap" name="reflectance">
        <string name="filename" value="top.png"/></texture></bsdf></bsdf></shape></scene>"""
    )
    study = own_study(tmp_path, f"{{scene: parts/scene.xml, {ANCHOR}}}", LIGHT, FEW)
    files = study.groups["main"].world.checksums
    assert set(files) == {"parts/scene.xml", "parts/top.obj", "parts/top.png"}
    frame = frame_of(study, 0)
    # As the same table from trimesh: red toward -z, blue toward +x, grey 21.6 %.
    red, blue, grey = (albedo(rgb, frame, [x, TABLE_M, z]) for x, z in ((0.1, -0.4), (0.4, 0.1), (-0.2, 0.1)))
    assert red[0] > 5 * red[2]
    assert blue[2] > 5 * blue[0]
    np.testing.assert_allclose(grey, 0.2159, rtol=0.01)


def test_several_and_bent_sheets(mi, tmp_path: Path) -> None:
    write_table(tmp_path)
    listed = "markers: [{pose: {distance_D: 8, tilt_deg: 30, azimuth_deg: -90, offset_x_px: 55}}]"
    still = ("tilt_deg: {uniform: [10, 50]}", "tilt_deg: 30")
    small = ("diameter_m: 0.08", "diameter_m: 0.04")
    far = ("distance_D: {uniform: [7, 9]}", "distance_D: 8")
    ahead = ("offset_x_px: {uniform: [-20, 20]}", "offset_x_px: -55")
    for world in ("{scene: table.glb}", "{pictures: walls}"):
        if "walls" in world:
            (tmp_path / "walls").mkdir()
            (tmp_path / "walls" / "a.png").write_bytes(png_bytes(arrow()))
        frame = frame_of(own_study(tmp_path, world, f"{LIGHT}\n{listed}", FEW, still, small, far, ahead), 0)
        radiance = render_radiance(mi, frame)
        assert all(coverage.max() == 1.0 for coverage in radiance.coverage.values())
        assert len(radiance.coverage) == 2


def test_an_xml_with_an_exr_is_decoded_on_one_thread(tmp_path: Path) -> None:
    from helpers_light import write_map

    write_map(tmp_path / "sky.exr", np.ones((8, 16, 3), dtype=np.float32))
    write_xml(tmp_path, '<emitter type="envmap"><string name="filename" value="sky.exr"/></emitter>')
    study = own_study(tmp_path, f"{{scene: scene.xml, {ANCHOR}}}", "", FEW, ("frames: 4", "frames: 1"))
    dataset = render_study(study, tmp_path / "ds", threads=1)
    assert dataset is not None
    from roundel.render.backend import start

    start(threads=2)


def test_a_corrupt_sky_of_an_xml_is_refused_before_rendering(tmp_path: Path) -> None:
    from helpers_light import write_map

    write_map(tmp_path / "sky.exr", np.random.default_rng(0).random((32, 64, 3)).astype(np.float32))
    data = (tmp_path / "sky.exr").read_bytes()
    (tmp_path / "sky.exr").write_bytes(data[: len(data) // 2])
    write_xml(tmp_path, '<emitter type="envmap"><string name="filename" value="sky.exr"/></emitter>')
    study = own_study(tmp_path, f"{{scene: scene.xml, {ANCHOR}}}", "", FEW)
    with pytest.raises(StudyError, match=r"study.yaml:\d+:\d+: world.scene: ") as caught:
        render_study(study, tmp_path / "ds")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "ds").exists()
