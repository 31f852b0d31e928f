"""Files that a mesh file refers to: buffers and images of glTF, materials and textures of OBJ."""

from __future__ import annotations

import base64
import binascii
import json
import struct
from collections.abc import Callable
from typing import Any
from urllib.parse import unquote

from roundel.scenes.assets.pictures import check_decodes

Read = Callable[[str], bytes]

_GLB, _JSON, _BIN = 0x46546C67, 0x4E4F534A, 0x004E4942
# An accessor without data is filled with zeros, whatever it claims.
_MOST_ELEMENTS = 20_000_000
# Required extensions that change only the look; without them the base material remains.
_HARMLESS = "KHR_materials_"


def gltf_parts(name: str, data: bytes) -> tuple[dict[str, Any], bytes]:
    """The JSON of a .gltf or .glb file, and the binary chunk of a .glb (glTF 2.0, section 4.4).

    Raises
    ------
    ValueError
        If the file is corrupt, truncated, of another version, or needs an extension.
    """
    binary = b""
    try:
        if data[:4] == struct.pack("<I", _GLB):
            _, version, total = struct.unpack_from("<III", data)
            length, kind = struct.unpack_from("<II", data, 12)
            if version != 2 or kind != _JSON or total > len(data):
                raise ValueError
            text = data[20 : 20 + length]
            at = 20 + length
            if at + 8 <= total:
                size, kind = struct.unpack_from("<II", data, at)
                if kind == _BIN:
                    binary = data[at + 8 : at + 8 + size]
        else:
            text = data
        tree = json.loads(text.decode("utf-8"))
        if not isinstance(tree, dict) or not str(tree["asset"]["version"]).startswith("2"):
            raise ValueError
    except (ValueError, KeyError, TypeError, struct.error, RecursionError) as error:
        raise ValueError(f"{name}: is not a glTF 2.0 file, or is truncated or corrupt; export it again") from error
    counts = [a.get("count", 0) for a in tree.get("accessors", []) if isinstance(a, dict)]
    if any(not isinstance(count, int) or not 0 <= count <= _MOST_ELEMENTS for count in counts):
        raise ValueError(f"{name}: an accessor has more than {_MOST_ELEMENTS:,} elements; simplify the scene")
    needed = [e for e in tree.get("extensionsRequired", []) if not str(e).startswith(_HARMLESS)]
    if needed:
        raise ValueError(f"{name}: needs the extension {needed[0]}, which is not read; export it without")
    return tree, binary


def gltf_references(name: str, data: bytes, read: Read) -> dict[str, bytes]:
    """Contents of the files that a glTF refers to, by the name written in it; embedded images are decoded.

    Parameters
    ----------
    name : str
        Of the file, for messages.
    data : bytes
    read : callable
        From a name relative to the file to its content; raises ValueError.
    """
    tree, binary = gltf_parts(name, data)
    found: dict[str, bytes] = {}
    buffers: list[bytes] = []
    images: list[tuple[str, str | None, bytes]] = []
    try:
        for buffer in tree.get("buffers", []):
            buffers.append(_content(name, buffer["uri"], found, read) if "uri" in buffer else binary)
        for i, image in enumerate(tree.get("images", [])):
            if "uri" in image:
                embedded = image["uri"].startswith("data:")
                images.append((f"{name} (image {i})" if embedded else image["uri"], image["uri"], b""))
            else:
                view = tree["bufferViews"][image["bufferView"]]
                start = view.get("byteOffset", 0)
                blob = buffers[view.get("buffer", 0)][start : start + view["byteLength"]]
                images.append((f"{name} (image {i})", None, blob))
    except (KeyError, IndexError, TypeError, AttributeError) as error:
        raise ValueError(f"{name}: its buffers or images are described wrongly; export it again") from error
    for label, uri, blob in images:
        check_decodes(label, blob if uri is None else _content(name, uri, found, read))
    return found


def _content(name: str, uri: str, found: dict[str, bytes], read: Read) -> bytes:
    if uri.startswith("data:"):
        try:
            return base64.b64decode(uri.split(",", 1)[1], validate=True)
        except (IndexError, binascii.Error) as error:
            raise ValueError(f"{name}: an embedded buffer or image is corrupt; export it again") from error
    if uri not in found:
        found[uri] = read(unquote(uri))
    return found[uri]


def obj_references(data: bytes, read: Read) -> dict[str, bytes]:
    """Contents of the material library and the textures that an OBJ refers to, by the name written in it."""
    found: dict[str, bytes] = {}
    for library in _arguments(data, "mtllib"):
        found[library] = read(library)
        for texture in _arguments(found[library], "map_kd"):
            if texture not in found:
                found[texture] = read(texture)
                check_decodes(texture, found[texture])
    return found


def text_of(data: bytes) -> str:
    """The text of an OBJ or MTL file: UTF-8, or Latin-1 as older programs write names."""
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _arguments(data: bytes, keyword: str) -> list[str]:
    """What follows a keyword at the start of a line."""
    lines = (line.strip() for line in text_of(data).splitlines())
    return [line[len(keyword) :].strip() for line in lines if line.lower().startswith((f"{keyword} ", f"{keyword}\t"))]
