"""Croissant 1.1: croissant.json describes shards of images and a table of truth, each with its checksum.

Source: http://mlcommons.org/croissant/1.1. Image coordinates are Roundel's, from the centre of the first pixel.
"""

from __future__ import annotations

import hashlib
import io
import json
import tarfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from roundel.datasets.export.output import Output
from roundel.datasets.export.reading import ReadFrame, ReadMarker, read_bytes, read_json
from roundel.datasets.export.sample import CONVENTION
from roundel.datasets.export.webdataset import TarShards
from roundel.datasets.layout.truth_table import TRUTH_COLUMNS, TRUTH_SCHEMA
from roundel.datasets.stream.frames import Frame
from roundel.scenes.errors import DataError, first_line

LEFT_OUT = (
    "masks and depth",
    "boards and tags: only circular markers have rows",
    "the lens: aperture, focus and exposure",
)

METADATA, FRAMES, MARKERS = "croissant.json", "frames.parquet", "markers.parquet"

_CONTEXT = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "annotation": "cr:annotation",
    "arrayShape": "cr:arrayShape",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "containedIn": "cr:containedIn",
    "cr": "http://mlcommons.org/croissant/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataBiases": "cr:dataBiases",
    "dataCollection": "cr:dataCollection",
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "equivalentProperty": "cr:equivalentProperty",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract",
    "field": "cr:field",
    "fileObject": "cr:fileObject",
    "fileProperty": "cr:fileProperty",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "isArray": "cr:isArray",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "parentField": "cr:parentField",
    "path": "cr:path",
    "personalSensitiveInformation": "cr:personalSensitiveInformation",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "samplingRate": "cr:samplingRate",
    "sc": "https://schema.org/",
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}

_ROWS = 500
_FRAME_SCHEMA = pa.schema(
    [
        ("frame_id", pa.int64()),
        ("split", pa.string()),
        ("group", pa.string()),
        ("image", pa.string()),
        ("width_px", pa.int64()),
        ("height_px", pa.int64()),
        *[(name, pa.float64()) for name in ("fx_px", "skew_px", "cx_px", "fy_px", "cy_px")],
        ("distortion_model", pa.string()),
        ("distortion", pa.string()),
    ]
)
_FLAT = [f for f in TRUTH_SCHEMA if not pa.types.is_list(f.type)]
_MARKER_SCHEMA = pa.schema([*_FLAT[:2], ("diameter_m", pa.float64()), *_FLAT[2:]])
_KINDS = {"int64": "sc:Integer", "double": "sc:Float", "string": "sc:Text", "bool": "sc:Boolean"}


class _Table:
    """A Parquet file, written some rows at a time."""

    def __init__(self, stack: ExitStack, out: Output, name: str, schema: pa.Schema) -> None:
        self._rows: list[dict[str, Any]] = []
        self._writer = stack.enter_context(
            pq.ParquetWriter(stack.enter_context(out.open(name)), schema, compression="zstd")
        )
        self._schema = schema

    def add(self, row: dict[str, Any]) -> None:
        """Add a row."""
        self._rows.append(row)
        if len(self._rows) == _ROWS:
            self.flush()

    def flush(self) -> None:
        """Write what is waiting."""
        if self._rows:
            self._writer.write_table(pa.Table.from_pylist(self._rows, schema=self._schema))
            self._rows = []


def write_croissant(frames: Iterator[Frame], out: Output, splits: tuple[str, ...], about: dict[str, Any]) -> None:
    """Write images as shards of tar, their frames and markers as Parquet, and croissant.json, which describes them."""
    # The client keeps what it extracts by the name alone: those of two exports must differ.
    tag = hashlib.sha256(json.dumps(about["identity"], sort_keys=True).encode()).hexdigest()[:8]
    with ExitStack() as stack:
        shards = {split: stack.enter_context(TarShards(out, f"images/{split}-{tag}")) for split in splits}
        frame_rows = _Table(stack, out, FRAMES, _FRAME_SCHEMA)
        marker_rows = _Table(stack, out, MARKERS, _MARKER_SCHEMA)
        for frame in frames:
            name = f"{frame.frame_id:06d}{frame.suffix}"
            shards[frame.split].next_frame()
            shards[frame.split].add(name, frame.image_bytes)
            frame_rows.add(_frame_row(frame, name))
            for marker in frame.markers:
                marker_rows.add({**{f.name: marker.truth.get(f.name) for f in _FLAT}, "diameter_m": marker.diameter_m})
        frame_rows.flush()
        marker_rows.flush()
    names = [FRAMES, MARKERS, *(name for shard in shards.values() for name in shard.names)]
    out.write(METADATA, (json.dumps(_metadata(names, out, about), indent=1) + "\n").encode())


def _frame_row(frame: Frame, name: str) -> dict[str, Any]:
    k = frame.camera.K
    numbers = {"fx_px": k[0, 0], "skew_px": k[0, 1], "cx_px": k[0, 2], "fy_px": k[1, 1], "cy_px": k[1, 2]}
    return {
        "frame_id": frame.frame_id,
        "split": frame.split,
        "group": frame.group,
        "image": name,
        "width_px": frame.camera.width_px,
        "height_px": frame.camera.height_px,
        **{key: float(value) for key, value in numbers.items()},
        "distortion_model": frame.record.get("distortion_model", "opencv"),
        "distortion": json.dumps([float(v) for v in frame.camera.distortion]),
    }


def _metadata(names: list[str], out: Output, about: dict[str, Any]) -> dict[str, Any]:
    meanings = {name: f"{c.meaning}{f' [{c.unit}]' if c.unit else ''}" for c in TRUTH_COLUMNS for name in c.names}
    tars = [name for name in names if name.endswith(".tar")]
    distribution: list[dict[str, Any]] = [_file(name, out) for name in names]
    distribution.append(
        {
            "@type": "cr:FileSet",
            "@id": "images",
            "name": "images",
            "containedIn": [{"@id": name} for name in tars],
            "encodingFormat": ["image/png", "image/jpeg"],
            "includes": ["*.png", "*.jpg"],
        }
    )
    return {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "name": about["name"],
        "description": f"{about['description']} {CONVENTION}",
        "conformsTo": "http://mlcommons.org/croissant/1.1",
        "license": about["licence_url"],
        "url": about["url"],
        "version": "1.0.0",
        "creator": {"@type": "sc:Organization", "name": "Roundel"},
        "citeAs": about["cite_as"],
        "isLiveDataset": False,
        "distribution": distribution,
        "recordSet": [
            _table_set("frames", FRAMES, _FRAME_SCHEMA, {}),
            _table_set("markers", MARKERS, _MARKER_SCHEMA, meanings),
            _image_set(),
        ],
    }


def _file(name: str, out: Output) -> dict[str, Any]:
    digest, size = out.listed(name)
    kind = "application/x-tar" if name.endswith(".tar") else "application/x-parquet"
    return {
        "@type": "cr:FileObject",
        "@id": name,
        "name": name,
        "contentUrl": name,
        "contentSize": f"{size} B",
        "encodingFormat": kind,
        "sha256": digest,
    }


def _table_set(name: str, file: str, schema: pa.Schema, meanings: dict[str, str]) -> dict[str, Any]:
    fields = [
        {
            "@type": "cr:Field",
            "@id": f"{name}/{f.name}",
            "name": f"{name}/{f.name}",
            "description": meanings.get(f.name, f.name),
            "dataType": _KINDS[str(f.type)],
            "source": {"fileObject": {"@id": file}, "extract": {"column": f.name}},
        }
        for f in schema
    ]
    key = [{"@id": f"{name}/frame_id"}, *([{"@id": f"{name}/marker_id"}] if name == "markers" else [])]
    return {"@type": "cr:RecordSet", "@id": name, "name": name, "key": key, "field": fields}


def _image_set() -> dict[str, Any]:
    fields = [
        {
            "@type": "cr:Field",
            "@id": f"images/{name}",
            "name": f"images/{name}",
            "dataType": kind,
            "source": {"fileSet": {"@id": "images"}, "extract": {"fileProperty": extract}},
        }
        for name, kind, extract in (("name", "sc:Text", "filename"), ("content", "sc:ImageObject", "content"))
    ]
    return {"@type": "cr:RecordSet", "@id": "images_of_frames", "name": "images_of_frames", "field": fields}


def read_croissant(folder: Path) -> Iterator[ReadFrame]:
    """The frames that croissant.json describes, held against the checksums that it gives.

    Raises
    ------
    DataError
        If a file is missing, or another one than is described; or the description is not as the format has it.
    """
    path = folder / METADATA
    about = read_json(path, dict)
    try:
        if about["conformsTo"] != "http://mlcommons.org/croissant/1.1":
            raise DataError(f"{path}: conforms to {about['conformsTo']}, not to Croissant 1.1")
        missing = [key for key in ("name", "description", "license", "url", "creator") if not about.get(key)]
        if missing or about["@context"] != _CONTEXT:
            raise DataError(f"{path}: lacks {missing[0] if missing else 'a part of its @context'}")
        files = {d["@id"]: d for d in about["distribution"] if d["@type"] == "cr:FileObject"}
        data = {name: _checked(folder, d) for name, d in files.items()}
        _check_fields(path, about, data)
        images = _images(folder, data)
        markers: dict[int, list[ReadMarker]] = {}
        for row in pq.read_table(pa.BufferReader(data[MARKERS])).to_pylist():
            pose = np.array([row[f"camera_from_marker_{i}{j}"] for i in range(4) for j in range(4)]).reshape(4, 4)
            mine = ReadMarker(row["marker_id"], pose=pose, diameter_m=row["diameter_m"])
            markers.setdefault(row["frame_id"], []).append(mine)
        for row in pq.read_table(pa.BufferReader(data[FRAMES])).to_pylist():
            fx, skew, cx, fy, cy = (row[f"{n}_px"] for n in ("fx", "skew", "cx", "fy", "cy"))
            yield ReadFrame(
                row["frame_id"],
                row["split"],
                k=np.array([[fx, skew, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]),
                distortion=tuple(json.loads(row["distortion"])),
                size_px=(row["width_px"], row["height_px"]),
                image=images[row["image"]],
                markers=markers.get(row["frame_id"], []),
            )
    except (KeyError, ValueError, TypeError, pa.ArrowException, tarfile.TarError) as error:
        raise DataError(f"{path}: is not as Croissant has it: {type(error).__name__} at {first_line(error)}") from error


def _checked(folder: Path, listed: dict[str, Any]) -> bytes:
    data = read_bytes(folder / listed["contentUrl"])
    if hashlib.sha256(data).hexdigest() != listed["sha256"]:
        raise DataError(f"{folder / listed['contentUrl']}: is another file than {METADATA} describes (sha256)")
    return data


def _check_fields(path: Path, about: dict[str, Any], data: dict[str, bytes]) -> None:
    """Every column that a record set names is in its file."""
    columns = {name: set(pq.read_schema(pa.BufferReader(data[name])).names) for name in (FRAMES, MARKERS)}
    for records in about["recordSet"]:
        for f in records["field"]:
            file = f["source"].get("fileObject", {}).get("@id")
            if file is not None and f["source"]["extract"]["column"] not in columns[file]:
                raise DataError(f"{path}: {f['@id']}: {file} has no column {f['source']['extract']['column']}")


def _images(folder: Path, data: dict[str, bytes]) -> dict[str, bytes]:
    out: dict[str, bytes] = {}
    for name, content in data.items():
        if name.endswith(".tar"):
            with tarfile.open(fileobj=io.BytesIO(content)) as tar:
                for member in tar:
                    file = tar.extractfile(member)
                    out[member.name] = file.read() if file else b""
    return out
