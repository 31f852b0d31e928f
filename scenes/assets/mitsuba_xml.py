"""A Mitsuba XML scene before Mitsuba sees it: only known elements, plugins and files inside the study's folder pass.

Shapes, BSDFs, textures and emitters are kept. Its sensor, integrator and defaults are dropped: the study has its own.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any
from xml.etree import ElementTree
from xml.parsers import expat

from roundel.scenes.assets.files import IMAGES, any_of, inside, read_inside, sha256_of, sibling
from roundel.scenes.assets.meshes import MOST_FACES, faces_in
from roundel.scenes.assets.pictures import check_decodes

MOST_XML_BYTES = 10_000_000
_MOST_DEPTH = 16

_PLUGINS = {
    "shape": {"obj", "ply", "sphere", "cylinder", "disk", "rectangle", "cube"},
    "bsdf": {
        "diffuse", "roughconductor", "conductor", "dielectric", "thindielectric", "roughdielectric", "plastic",
        "roughplastic", "principled", "principledthin", "twosided", "mask", "blendbsdf", "bumpmap", "normalmap",
    },
    "texture": {"bitmap", "checkerboard", "mesh_attribute"},
    "emitter": {"area", "constant", "envmap", "point", "spot", "directional"},
}  # fmt: skip
_VALUES = {
    "ref", "transform", "translate", "rotate", "scale", "matrix", "lookat", "float", "integer", "boolean", "string",
    "vector", "point", "rgb", "spectrum",
}  # fmt: skip
_DROPPED = {"sensor", "integrator", "default", "film", "sampler"}
_ATTRIBUTES = {"name", "value", "type", "id", "version", "x", "y", "z", "angle", "origin", "target", "up"}
_ENDINGS = {"shape": (".obj", ".ply"), "texture": (*IMAGES, ".exr", ".hdr"), "emitter": (".exr", ".hdr")}
# Names and numbers; no slash, so that no other value can be a path.
_WORD = re.compile(r"[\w .,:;+\-]{0,4000}\Z", re.ASCII)
_NUMBERS = re.compile(r"[\s\d.,:eE+\-]{0,100000}\Z", re.ASCII)


@dataclass(frozen=True, eq=False)
class XmlScene:
    """A scene that passed: its tree, the files it names (relative to the study), whether it has lights of its own."""

    root: Any
    files: tuple[str, ...]
    has_lights: bool


def read_xml(folder: Path, name: str) -> XmlScene:
    """Read and check an XML scene that a study in `folder` names.

    Raises
    ------
    ValueError
        If it is no XML, or holds anything that is not known to be harmless; the message names it.
    """
    data = read_inside(folder, name, MOST_XML_BYTES)
    _check_prolog(name, data)
    root = ElementTree.fromstring(data)
    if root.tag != "scene":
        raise ValueError(f"{name}: is not a Mitsuba scene; its outermost element is <{root.tag}>, not <scene>")
    for element in list(root):
        if element.tag in _DROPPED:
            root.remove(element)
    files: list[str] = []
    for element in root:
        _check(name, element, files)
    if not any(element.tag == "shape" for element in root.iter()):
        raise ValueError(f"{name}: has no shape")
    has_lights = any(element.tag == "emitter" for element in root.iter())
    return XmlScene(root, tuple(dict.fromkeys(files)), has_lights)


def xml_checksums(folder: Path, name: str) -> dict[str, str]:
    """sha256 of an XML scene and of every file that it names; pictures are decoded, meshes read.

    Raises
    ------
    ValueError
        If one is missing, outside the folder, too large or corrupt.
    """
    found = {name: sha256_of(read_inside(folder, name, MOST_XML_BYTES))}
    faces = 0
    for file in read_xml(folder, name).files:
        data = read_inside(folder, file)
        if file.lower().endswith((".obj", ".ply")):
            # Mitsuba does not look whether a face's vertices exist.
            faces += faces_in(file, data)
            if faces > MOST_FACES:
                raise ValueError(f"{name}: more than {MOST_FACES:,} faces; simplify the scene")
        if file.lower().endswith(IMAGES):
            check_decodes(file, data)
        found[file] = sha256_of(data)
    return found


def xml_text(folder: Path, name: str) -> str:
    """The scene as text for Mitsuba, its files by their full paths."""
    scene = read_xml(folder, name)
    for element in scene.root.iter("string"):
        if element.get("name") == "filename":
            element.set("value", str(inside(folder, sibling(name, element.get("value", ""))).resolve()))
    return ElementTree.tostring(scene.root, encoding="unicode")


def _check_prolog(name: str, data: bytes) -> None:
    """Refuse what is no XML, and document types: entities can name files, or grow without bound."""

    def refuse(*_: Any) -> None:
        raise ValueError(f"{name}: has a document type or entities; remove them")

    def refuse_instruction(*_: Any) -> None:
        raise ValueError(f"{name}: has processing instructions; remove them")

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse
    parser.ProcessingInstructionHandler = refuse_instruction
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise ValueError(f"{name}: is not well-formed XML ({error})") from error


def _check(name: str, element: Any, files: list[str], parent: str = "scene", depth: int = 1) -> None:
    tag = element.tag
    if depth > _MOST_DEPTH:
        raise ValueError(f"{name}: is nested more than {_MOST_DEPTH} deep; flatten it")
    if tag in ("include", "path", "alias"):
        raise ValueError(f"{name}: <{tag}> is refused; write everything into one file")
    if tag not in _PLUGINS and tag not in _VALUES:
        raise ValueError(f"{name}: <{tag}> is not supported; use {any_of(sorted(_PLUGINS))}")
    for key, value in element.attrib.items():
        if key not in _ATTRIBUTES:
            raise ValueError(f"{name}: <{tag}> has the attribute {key}, which is not supported")
        if "$" in value:
            raise ValueError(f"{name}: <{tag} {key}={value!r}> uses a default; write its value instead")
    if tag in _PLUGINS:
        kind = element.get("type", "")
        if kind not in _PLUGINS[tag]:
            raise ValueError(
                f"{name}: <{tag} type={kind!r}> is not supported; use one of {any_of(sorted(_PLUGINS[tag]))}"
            )
    elif tag == "string" and element.get("name") == "filename":
        files.append(_file(name, parent, element.get("value", "")))
    elif tag in ("spectrum", "matrix", "rgb", "vector", "point", "float", "integer"):
        if not _NUMBERS.match(element.get("value", "")):
            raise ValueError(f"{name}: <{tag} value={element.get('value')[:60]!r}> holds no numbers")
    elif not all(_WORD.match(value) for value in element.attrib.values()):
        raise ValueError(f"{name}: <{tag}> holds {next(iter(element.attrib.values()))[:60]!r}; names and numbers pass")
    for child in element:
        _check(name, child, files, tag if tag in _PLUGINS else parent, depth + 1)


def _file(name: str, parent: str, value: str) -> str:
    endings = _ENDINGS.get(parent, ())
    if PurePosixPath(value).suffix.lower() not in endings:
        raise ValueError(f"{name}: {value[:60]}: a {parent} reads {any_of(endings) or 'no file'}")
    return sibling(name, value)
