"""Files that cannot be used are refused when the study is read, in one line that names the key."""

import os
import struct
from pathlib import Path

import numpy as np
import pytest
from helpers_assets import LIGHT, XML, arrow, own_study, png_bytes, table, write_table, write_xml

from roundel.scenes.assets import files, pictures
from roundel.scenes.errors import StudyError
from roundel.scenes.study.study import load_study

ANCHOR = "anchor: {position_m: [0, 0.75, 0]}"


def refusal(folder: Path, world: str, light: str = "") -> str:
    with pytest.raises(StudyError) as caught:
        own_study(folder, world, light)
    text = str(caught.value)
    assert "\n" not in text
    # The position is that of the world in the file, or of a key in it.
    assert text.startswith(f"{folder / 'study.yaml'}:11:")
    return text


def test_a_missing_file(tmp_path: Path) -> None:
    assert "world.scene: no such file: table.glb; the path is relative" in refusal(tmp_path, "{scene: table.glb}")
    assert "world.pictures: no such folder: walls" in refusal(tmp_path, "{pictures: walls}")
    assert "world.scene: no such file: a.xml" in refusal(tmp_path, f"{{scene: a.xml, {ANCHOR}}}")


@pytest.mark.parametrize(
    "name", ["../table.glb", "/tmp/table.glb", "a/../../table.glb", "https://a.org/table.glb", "~/a.glb"]
)
def test_a_path_that_leaves_the_folder(tmp_path: Path, name: str) -> None:
    (tmp_path / "study").mkdir()
    write_table(tmp_path)
    text = refusal(tmp_path / "study", f'{{scene: "{name}"}}')
    assert "leaves the study's folder" in text or "is not a relative path" in text


def test_a_link_that_leaves_the_folder(tmp_path: Path) -> None:
    (tmp_path / "study").mkdir()
    write_table(tmp_path)
    (tmp_path / "study" / "table.glb").symlink_to(tmp_path / "table.glb")
    assert "is a link that leaves the study's folder" in refusal(tmp_path / "study", "{scene: table.glb}")
    # A link inside it is no harm.
    write_table(tmp_path / "study", "other.glb")
    (tmp_path / "study" / "inner.glb").symlink_to(tmp_path / "study" / "other.glb")
    own_study(tmp_path / "study", "{scene: inner.glb}")


@pytest.mark.parametrize("cut", [0, 8, 100, 0.5, -4])
def test_a_truncated_mesh(tmp_path: Path, cut: float) -> None:
    data = table().export(file_type="glb")
    (tmp_path / "table.glb").write_bytes(data[: int(len(data) * cut) if isinstance(cut, float) else cut])
    assert "world.scene: table.glb" in refusal(tmp_path, "{scene: table.glb}")


@pytest.mark.parametrize("ending", ["obj", "ply", "glb", "gltf"])
def test_a_mesh_that_is_none(tmp_path: Path, ending: str) -> None:
    (tmp_path / f"a.{ending}").write_bytes(os.urandom(300))
    assert f"world.scene: a.{ending}" in refusal(tmp_path, f"{{scene: a.{ending}}}")


def test_an_unknown_ending(tmp_path: Path) -> None:
    assert "scene: table.blend is none of .glb, .gltf, .obj, .ply, .xml" in refusal(tmp_path, "{scene: table.blend}")


def test_a_corrupt_texture_in_a_glb(tmp_path: Path) -> None:
    data = table().export(file_type="glb")
    at = data.index(b"IDAT")
    (tmp_path / "table.glb").write_bytes(data[: at + 20] + bytes(30) + data[at + 50 :])
    assert "table.glb (image 0): the picture is truncated or corrupt" in refusal(tmp_path, "{scene: table.glb}")


def write_gltf(folder: Path, image: bytes = b"", uri: str = "top.png") -> None:
    """The table as .gltf, with its buffers and its texture beside it."""
    import json

    for name, data in table().export(file_type="gltf").items():
        if name.endswith(".gltf"):
            tree = json.loads(data)
            assert "bufferView" in tree["images"][0]
            tree["images"] = [{"uri": uri}]
            data = json.dumps(tree).encode()
            name = "table.gltf"
        (folder / name).write_bytes(data)
    (folder / "top.png").write_bytes(image or png_bytes(arrow()))


def test_files_that_a_gltf_names(tmp_path: Path) -> None:
    write_gltf(tmp_path)
    sums = own_study(tmp_path, "{scene: table.gltf}").groups["main"].world.checksums
    # All of them count: the file, its buffers, its texture.
    assert {"table.gltf", "top.png"} < set(sums)
    first = own_study(tmp_path, "{scene: table.gltf}").digest()
    (tmp_path / "top.png").write_bytes(png_bytes(arrow(32)))
    assert own_study(tmp_path, "{scene: table.gltf}").digest() != first
    world = "{scene: table.gltf, checksums: {" + ", ".join(f"{k}: {v}" for k, v in sums.items()) + "}}"
    assert "world.scene: top.png: is not the recorded file" in refusal(tmp_path, world)
    (tmp_path / "top.png").write_bytes(png_bytes(arrow())[:-60])
    assert "world.scene: top.png: the picture is truncated" in refusal(tmp_path, "{scene: table.gltf}")
    (tmp_path / "top.png").unlink()
    assert "world.scene: no such file: top.png" in refusal(tmp_path, "{scene: table.gltf}")
    write_gltf(tmp_path, uri="../top.png")
    assert "world.scene: ../top.png: leaves the study's folder" in refusal(tmp_path, "{scene: table.gltf}")
    write_gltf(tmp_path, uri="https://example.org/top.png")
    assert "refers to https://example.org/top.png" in refusal(tmp_path, "{scene: table.gltf}")


def test_files_that_an_obj_names(tmp_path: Path) -> None:
    (tmp_path / "table.mtl").write_text("newmtl wood\nKd 0.5 0.5 0.5\nmap_Kd top.png\n")
    (tmp_path / "table.obj").write_text(
        "mtllib table.mtl\nv -1 0 1\nv 1 0 1\nv 1 0 -1\nv -1 0 -1\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl wood\n"
        "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n"
    )
    assert "world.scene: no such file: top.png" in refusal(tmp_path, "{scene: table.obj}")
    (tmp_path / "top.png").write_bytes(png_bytes(arrow()))
    world = own_study(tmp_path, "{scene: table.obj}").groups["main"].world
    assert set(world.checksums) == {"table.obj", "table.mtl", "top.png"}
    (tmp_path / "table.mtl").write_text("newmtl wood\nmap_Kd ../top.png\n")
    assert "leaves the study's folder" in refusal(tmp_path, "{scene: table.obj}")


def test_a_mesh_without_faces_and_one_whose_vertices_are_no_numbers(tmp_path: Path) -> None:
    import trimesh

    (tmp_path / "points.ply").write_bytes(
        trimesh.PointCloud(np.random.default_rng(0).normal(size=(9, 3))).export(file_type="ply")
    )
    assert "points.ply: has no faces" in refusal(tmp_path, "{scene: points.ply}")
    (tmp_path / "empty.obj").write_text("v 0 0 0\n")
    assert "world.scene: empty.obj" in refusal(tmp_path, "{scene: empty.obj}")
    (tmp_path / "nan.obj").write_text("v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert "has vertices that are not finite numbers" in refusal(tmp_path, "{scene: nan.obj}")


def test_a_glb_of_a_million_faces(tmp_path: Path) -> None:
    import trimesh

    side = 708
    x, y = np.meshgrid(np.arange(side + 1.0), np.arange(side + 1.0))
    a = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    faces = np.concatenate([np.stack([a, a + 1, a + side + 1], 1), np.stack([a + 1, a + side + 2, a + side + 1], 1)])
    mesh = trimesh.Trimesh(np.stack([x.ravel(), 0 * x.ravel(), y.ravel()], 1), faces, process=False)
    assert len(mesh.faces) > 1_000_000
    (tmp_path / "dense.glb").write_bytes(mesh.export(file_type="glb"))
    assert "dense.glb: more than 500,000 faces; simplify the scene" in refusal(tmp_path, "{scene: dense.glb}")


def test_a_file_that_is_too_large(tmp_path: Path) -> None:
    with (tmp_path / "large.glb").open("wb") as file:
        file.truncate(files.MOST_BYTES + 1)
    assert "large.glb: 256 MB is too large (at most 256 MB)" in refusal(tmp_path, "{scene: large.glb}")


def png_header(width: int, height: int) -> bytes:
    """A PNG that claims a size."""
    import zlib

    chunks = [b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0), b"IDAT"]
    packed = [struct.pack(">I", len(c) - 4) + c + struct.pack(">I", zlib.crc32(c)) for c in chunks]
    return b"\x89PNG\r\n\x1a\n" + b"".join(packed)


@pytest.mark.parametrize("size", [(9000, 10), (10, 9000), (60_000, 60_000)])
def test_a_picture_that_is_too_large(tmp_path: Path, size: tuple[int, int]) -> None:
    (tmp_path / "walls").mkdir()
    (tmp_path / "walls" / "a.png").write_bytes(png_header(*size))
    text = refusal(tmp_path, "{pictures: walls}")
    assert "walls/a.png" in text
    assert "at most 8192" in text


def test_folders_of_pictures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    walls = tmp_path / "walls"
    walls.mkdir()
    (walls / "notes.txt").write_text("none")
    assert "world.pictures: walls: holds no picture (.png, .jpg, .jpeg)" in refusal(tmp_path, "{pictures: walls}")
    (walls / "a.jpg").write_bytes(b"no picture")
    assert "world.pictures: walls/a.jpg: is not a PNG or JPEG picture" in refusal(tmp_path, "{pictures: walls}")
    (walls / "a.jpg").write_bytes(png_bytes(arrow(), "JPEG"))
    (walls / "b.png").write_bytes(png_bytes(arrow()))
    monkeypatch.setattr(pictures, "MOST_PICTURES", 1)
    assert "holds 2 pictures; at most 1" in refusal(tmp_path, "{pictures: walls}")


@pytest.mark.parametrize("kind", ["PNG", "JPEG"])
def test_a_picture_whose_pixels_are_cut_off_is_refused_where_frames_are_placed(tmp_path: Path, kind: str) -> None:
    from roundel.scenes.world.frame import frames_of

    (tmp_path / "walls").mkdir()
    noise = np.random.default_rng(1).integers(0, 255, (200, 200, 3)).astype(np.uint8)
    data = png_bytes(noise, kind)
    (tmp_path / "walls" / f"a.{kind.lower()}").write_bytes(data[: len(data) // 2])
    study = own_study(tmp_path, "{pictures: walls}", LIGHT)
    with pytest.raises(
        StudyError, match=rf"world.pictures: walls/a.{kind.lower()}: the picture is truncated"
    ) as caught:
        list(frames_of(study))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("anchor", "said"),
    [
        ("{position_m: [0, 1, 0], normal: [0, 0, 0]}", "anchor.normal: is zero"),
        ("{position_m: [0, 1, 0], normal: [0, 2, 0], up: [0, -1, 0]}", "anchor.up: is parallel to the normal"),
        ("{position_m: [0, 1, 0], up: [0, 0, 0]}", "anchor.up: is zero"),
        ("{position_m: [0, 1]}", "world.anchor.position_m"),
        ("{normal: [0, 1, 0]}", "world.anchor.position_m: required key is missing"),
    ],
)
def test_anchors(tmp_path: Path, anchor: str, said: str) -> None:
    write_table(tmp_path)
    assert said in refusal(tmp_path, f"{{scene: table.glb, anchor: {anchor}}}")


@pytest.mark.parametrize(
    ("world", "said"),
    [
        ("{kind: scene}", "scene: required key is missing"),
        ("{kind: room, scene: table.glb}", "kind room has no scene"),
        ("{scene: table.glb, objects: 3}", "remove objects"),
        ("{scene: table.glb, pictures: walls}", "pictures hang on the wall of a plain world"),
        ("{kind: room, unit_m: 2}", "unit_m belongs to a scene"),
        ("{picture_m: 2}", "picture_m belongs to pictures"),
        ("{scene: scene.xml}", "anchor: required key is missing; an XML scene"),
        ("{scene: table.glb, unit_m: 0}", "world.unit_m"),
        ("{scene: table.glb, ancor: 0}", "world.ancor: unknown key; did you mean anchor?"),
    ],
)
def test_keys_that_do_not_go_together(tmp_path: Path, world: str, said: str) -> None:
    write_table(tmp_path)
    write_xml(tmp_path)
    assert said in refusal(tmp_path, world)


XMLS = {
    '<include filename="other.xml"/>': "<include> is refused",
    '<path value="/etc"/>': "<path> is refused",
    '<shape type="ply"><string name="filename" value="/etc/passwd"/></shape>': "a shape reads .obj, .ply",
    '<shape type="ply"><string name="filename" value="/etc/a.ply"/></shape>': "/etc/a.ply: is not a relative path",
    '<shape type="ply"><string name="filename" value="../a.ply"/></shape>': "../a.ply: leaves the study's folder",
    '<shape type="ply"><string name="filename" value="http://a.org/a.ply"/></shape>': "is not a relative path",
    '<shape type="ply"><string name="filename" value="a.ply"/></shape>': "no such file: a.ply",
    '<shape type="obj"><string name="filename" value="$file"/></shape>': "uses a default; write its value instead",
    '<shape type="sdfgrid"/>': "<shape type='sdfgrid'> is not supported; use one of cube",
    '<bsdf type="measured"><string name="filename" value="a.bsdf"/></bsdf>': "<bsdf type='measured'> is not supported",
    '<spectrum name="a" filename="/etc/passwd"/>': "has the attribute filename",
    '<spectrum name="a" value="/etc/passwd"/>': "holds no numbers",
    '<bsdf type="conductor"><string name="material" value="../../Au"/></bsdf>': "names and numbers pass",
    "<script>import os</script>": "<script> is not supported",
    '<medium type="homogeneous"/>': "<medium> is not supported",
    '<shape type="cube">': "is not well-formed XML",
    20_000 * '<bsdf type="twosided">' + 20_000 * "</bsdf>": "is nested more than 16 deep",
    "<?php evil?>": "has processing instructions",
    '<emitter type="envmap"><string name="filename" value="sky.exe"/></emitter>': "a emitter reads .exr, .hdr",
}


@pytest.mark.parametrize("more", XMLS, ids=lambda more: more[:40])
def test_what_an_xml_may_not_hold(tmp_path: Path, more: str) -> None:
    write_xml(tmp_path, more)
    text = refusal(tmp_path, f"{{scene: scene.xml, {ANCHOR}}}")
    assert "world.scene: " in text
    assert XMLS[more] in text


@pytest.mark.parametrize(
    "prolog",
    [
        '<!DOCTYPE scene [<!ENTITY a "b">]>',
        '<!DOCTYPE scene SYSTEM "http://a.org/a.dtd">',
        '<!DOCTYPE scene [<!ENTITY a SYSTEM "file:///etc/passwd">]>',
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_document_types_and_entities(tmp_path: Path, prolog: str, encoding: str) -> None:
    (tmp_path / "scene.xml").write_bytes((prolog + XML.replace("MORE", "")).encode(encoding))
    assert "has a document type or entities" in refusal(tmp_path, f"{{scene: scene.xml, {ANCHOR}}}")


def test_an_xml_without_shapes_and_one_that_is_no_scene(tmp_path: Path) -> None:
    (tmp_path / "scene.xml").write_text('<scene version="3.0.0"/>')
    assert "has no shape" in refusal(tmp_path, f"{{scene: scene.xml, {ANCHOR}}}")
    (tmp_path / "scene.xml").write_text("<html/>")
    assert "its outermost element is <html>" in refusal(tmp_path, f"{{scene: scene.xml, {ANCHOR}}}")


def test_a_scene_replaces_the_world_of_a_layer_above(tmp_path: Path) -> None:
    write_table(tmp_path)
    own_study(tmp_path, "{kind: room, objects: 3}")
    text = (tmp_path / "study.yaml").read_text()
    (tmp_path / "study.yaml").write_text(text + "groups:\n  own: {world: {scene: table.glb}}\n  room: {}\n")
    groups = load_study(tmp_path / "study.yaml").groups
    assert (groups["own"].world.kind, groups["room"].world.kind) == ("scene", "room")


def test_an_embedded_picture_by_data_uri(tmp_path: Path) -> None:
    import base64

    write_gltf(tmp_path, uri="data:image/png;base64," + base64.b64encode(png_bytes(arrow())).decode())
    assert "top.png" not in own_study(tmp_path, "{scene: table.gltf}").groups["main"].world.checksums
    write_gltf(tmp_path, uri="data:image/png;base64,AAAA")
    assert "image 0" in refusal(tmp_path, "{scene: table.gltf}")


def test_an_accessor_that_claims_too_much(tmp_path: Path) -> None:
    data = table().export(file_type="gltf")["model.gltf"].decode()
    assert '"count":4' in data
    (tmp_path / "table.gltf").write_text(data.replace('"count":4', '"count":400000000000', 1))
    assert "table.gltf: an accessor has more than 20,000,000 elements" in refusal(tmp_path, "{scene: table.gltf}")


def test_meshes_that_an_xml_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import trimesh

    from roundel.scenes.assets import mitsuba_xml

    ball = trimesh.creation.icosphere(1, 0.1)
    sound = ball.export(file_type="ply")
    ball.vertices[3] = np.nan
    write_xml(tmp_path, '<shape type="ply"><string name="filename" value="ball.ply"/></shape>')
    world = f"{{scene: scene.xml, {ANCHOR}}}"
    # A ball is 80 triangles; its last vertex number is made far too large.
    for data, said in (
        (ball.export(file_type="ply"), "has vertices that are not finite"),
        (sound[:-4] + b"\xff\xff\xff\x0f", "has faces without vertices"),
        (sound[: len(sound) // 2], "cannot be read as a mesh"),
        (b"ply\n", "cannot be read as a mesh"),
    ):
        (tmp_path / "ball.ply").write_bytes(data)
        assert f"world.scene: ball.ply: {said}" in refusal(tmp_path, world).replace("geometry_0 ", "")
    (tmp_path / "ball.ply").write_bytes(sound)
    own_study(tmp_path, world)
    monkeypatch.setattr(mitsuba_xml, "MOST_FACES", 79)
    assert "scene.xml: more than 79 faces" in refusal(tmp_path, world)
