"""Records of shards and of the dataset: counts, environments, fidelity and checksums over the frames that are there."""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import yaml

from roundel.datasets.environment import Environment
from roundel.datasets.fidelity.summary import join_summaries, summarise
from roundel.datasets.flags import count_flags, flags_of_rows
from roundel.datasets.layout import files, journal
from roundel.datasets.layout.contents import images_digest, joined_digest
from roundel.datasets.layout.developed import Developed, developed_of
from roundel.datasets.layout.shards import Shard
from roundel.datasets.store.records import document_of
from roundel.datasets.store.store import Listed, Store
from roundel.datasets.store.writing import sha256
from roundel.scenes.study.identity import SAMPLING_VERSION
from roundel.scenes.study.study import Study
from roundel.scenes.world.frame import total_frames

# Keys of the manifest that the study alone determines.
IDENTITY = (
    "tool", "name", "licence", "study", "study_sha256", "dataset_id", "sampling_version", "seed", "groups",
)  # fmt: skip


@dataclass(frozen=True)
class Rows:
    """What a shard's record counts: camera records, rows of the truth, journal lines, and what made the frames."""

    cameras: Sequence[Mapping[str, Any]]
    truth: Sequence[dict[str, Any]]
    entries: Mapping[int, journal.Entry]
    environments: Mapping[str, Environment]


def shard_record(
    dataset_id: str,
    shard: Shard,
    complete: bool,
    rows: Rows,
    listed: Mapping[str, dict[str, Any]],
    developed: Developed | None = None,
) -> dict[str, Any]:
    """The record of a shard.

    Parameters
    ----------
    dataset_id : str
    shard : Shard
    complete : bool
        Whether no frame is missing.
    rows : Rows
    listed : dict
        `{sha256, bytes}` of each file, by name within the shard.
    developed : Developed, optional
        See `finish_shard`.
    """
    used = {str(entry["environment"]) for entry in rows.entries.values() if "environment" in entry}
    measured = [m for i in sorted(rows.entries) for m in rows.entries[i]["fidelity"].values() if m]
    record = {
        "schema": 2,
        "dataset_id": dataset_id,
        "first_frame": shard.frames.start,
        "complete": complete,
        "counts": {
            "frames": len(rows.cameras),
            "images": len(rows.entries),
            "markers": len(rows.truth),
            "groups": _counted(str(camera["group"]) for camera in rows.cameras),
            "flags": count_flags(flags_of_rows(rows.truth)),
        },
        "environments": {key: rows.environments[key] for key in sorted(used)},
        "fidelity": summarise(measured),
        "files": dict(sorted(listed.items())),
        "images_sha256": images_digest(dict(listed)),
    }
    return record if developed is None else {**record, **developed.record()}


def slim(record: dict[str, Any], listed: Listed) -> dict[str, Any]:
    """The record of a shard without its files, and with its own size and checksum: the manifest's share of it."""
    bare = {name: value for name, value in record.items() if name != "files"}
    return {**bare, "document": {"bytes": listed.bytes, "sha256": listed.sha256}}


def _counted(names: Iterable[str]) -> dict[str, int]:
    counts: dict[str, int] = {}
    for name in names:
        counts[name] = counts.get(name, 0) + 1
    return counts


def study_bytes(study: Study) -> bytes:
    """The resolved study as YAML."""
    sink = io.StringIO()
    yaml.safe_dump(study.resolved(), sink, sort_keys=False, width=120)
    return sink.getvalue().encode()


def identity_of(study: Study, data: bytes) -> dict[str, Any]:
    """Keys of the manifest that the study alone determines; `data` is its file."""
    about = "roundel", study.name, study.licence, study.resolved(), sha256(data)
    return dict(zip(IDENTITY, (*about, study.digest(), SAMPLING_VERSION, study.seed, list(study.groups)), strict=True))


def manifest_record(
    identity: Mapping[str, Any],
    study_file: Listed,
    shards: list[tuple[Shard, dict[str, Any]]],
    total: int,
    own: Environment,
) -> dict[str, Any]:
    """The manifest of a dataset, from the records of its shards.

    Parameters
    ----------
    identity : dict
        See `identity_of`.
    study_file : Listed
    shards : list of (Shard, dict)
        The shards that are there, with their records.
    total : int
        Frames of the study.
    own : dict
        The environment of this process: that of a dataset without a rendered frame.
    """
    environments: dict[str, Environment] = {}
    for _, record in shards:
        environments |= record["environments"]
    main = next(iter(_in_frame_order(shards)), own)
    counts = [record["counts"] for _, record in shards]
    single = len(shards) == 1 and not shards[0][0].folder
    manifest: dict[str, Any] = {
        "schema": 2,
        **identity,
        **main,
        "counts": {
            **{name: sum(c[name] for c in counts) for name in ("frames", "images", "markers")},
            "groups": _summed(identity["groups"], [c["groups"] for c in counts]),
            "flags": _summed((), [c["flags"] for c in counts]),
        },
        "complete": sum(c["frames"] for c in counts) == total and all(r["complete"] for _, r in shards),
        "fidelity": shards[0][1]["fidelity"] if single else join_summaries([r["fidelity"] for _, r in shards]),
        "files": {files.STUDY: {"sha256": study_file.sha256, "bytes": study_file.bytes}},
        "images_sha256": joined_digest([(shard.folder, r["images_sha256"]) for shard, r in shards]),
    }
    if len(environments) > 1:
        manifest["environments"] = dict(sorted(environments.items()))
    developed = [found for _, r in shards if (found := developed_of(r)) is not None]
    if developed:
        manifest |= min(developed, key=lambda one: one.dataset_id).record()
    if single:
        manifest["files"] = dict(sorted({**manifest["files"], **shards[0][1]["files"]}.items()))
    else:
        manifest["shards"] = [_part(shard, record) for shard, record in shards]
    return manifest


def _in_frame_order(shards: list[tuple[Shard, dict[str, Any]]]) -> Iterator[Environment]:
    """Environments of the shards, the first shard's first; of several in a shard the first by key."""
    for _, record in shards:
        yield from record["environments"].values()


def _summed(names: Iterable[str], counts: list[dict[str, int]]) -> dict[str, int]:
    every = dict.fromkeys([*names, *(name for each in counts for name in each)], 0)
    for each in counts:
        for name, number in each.items():
            every[name] += number
    return every


def _part(shard: Shard, record: dict[str, Any]) -> dict[str, Any]:
    return {
        "folder": shard.folder,
        "frames": [shard.frames.start, record["counts"]["frames"]],
        **record["document"],
        "images_sha256": record["images_sha256"],
    }


def write_manifest(
    study: Study, folder: Store, shards: list[tuple[Shard, dict[str, Any]]], own: Environment
) -> dict[str, Any]:
    """Write the manifest of a study's dataset, and return it; see `manifest_record`.

    Raises
    ------
    DataError
        If it cannot be written.
    """
    data = study_bytes(study)
    if folder.size(files.STUDY) != len(data) or folder.read(files.STUDY) != data:
        folder.write(files.STUDY, data)
    listed = Listed(len(data), sha256(data))
    manifest = manifest_record(identity_of(study, data), listed, shards, total_frames(study), own)
    folder.write(files.MANIFEST, document_of(manifest))
    return manifest
