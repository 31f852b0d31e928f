"""The verbs that look after datasets: verify, repair, merge, pull, browse; and reading one that is not finished."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from roundel.cli.progress import progress
from roundel.scenes.errors import DataError, UsageError

if TYPE_CHECKING:
    from roundel.datasets.store.store import Store
    from roundel.datasets.verify import Finding

_SHOWN = 20


def found_problems(findings: list[Finding], what: str) -> DataError:
    """Print the first of the findings; the error that they end with."""
    for finding in findings[:_SHOWN]:
        print(finding)
    return DataError(f"{what}; problems found: {len(findings)}")


def _warn(line: str) -> None:
    print(f"roundel: warning: {line}", file=sys.stderr)


def readable(address: str) -> str:
    """The address of a dataset; of one that is not finished, the frames there are are indexed first, with a warning."""
    from roundel.datasets.layout.files import MANIFEST, STUDY
    from roundel.datasets.layout.manifest import read_manifest
    from roundel.datasets.store.addresses import store_at

    folder = store_at(address)
    if folder.size(MANIFEST) is None and folder.size(STUDY) is not None:
        from roundel.datasets.environment import environment_of
        from roundel.datasets.index import index_frames

        done, total = index_frames(address, environment_of({"variant": None}))
        if done < total:
            _warn(f"{address}: not finished: {done} of {total} frames are there, and are used")
    elif folder.size(MANIFEST) is not None and not read_manifest(folder)[1].complete:
        _warn(f"{address}: not finished: some frames are missing; those that are indexed are used")
    return address


def warn_of_unfinished(study: Any, out: str, wanted: range | None) -> None:
    """One line on stderr if frames of a dataset that is not finished are flagged."""
    from roundel.datasets.flags import warning_of
    from roundel.datasets.index import progress_of
    from roundel.datasets.store.addresses import store_at
    from roundel.datasets.work import shards_within
    from roundel.scenes.world.frame import total_frames

    total = total_frames(study)
    flagged: list[tuple[int, list[str]]] = []
    for shard in shards_within(total, wanted or range(total)):
        entries = progress_of(store_at(out), shard, study).entries
        flagged += [(i, entry.get("flags", [])) for i, entry in entries.items()]
    line = warning_of(flagged, len(flagged))
    if line:
        _warn(line)


def _there(address: str) -> Store:
    """A dataset that must be there."""
    from roundel.datasets.store.addresses import store_at

    folder = store_at(address)
    absence = folder.absence()
    if absence:
        raise DataError(f"{folder}: not a dataset: {absence}")
    return folder


def do_verify(arguments: argparse.Namespace) -> int:
    """Compare a dataset with its manifest."""
    from roundel.datasets.export.output import MANIFEST as EXPORT
    from roundel.datasets.fidelity.summary import fidelity_lines
    from roundel.datasets.layout.contents import read_contents
    from roundel.datasets.layout.manifest import read_manifest
    from roundel.datasets.verify import verify_dataset

    if "://" not in arguments.dataset and (Path(arguments.dataset) / EXPORT).is_file():
        return verify_export(Path(arguments.dataset), arguments.against)
    if arguments.against:
        raise UsageError(f"--against: {arguments.dataset} is not an export")
    path = _there(arguments.dataset)
    manifest, _ = read_manifest(path)
    with progress("verify") as show:
        findings = verify_dataset(arguments.dataset, arguments.full, show)
    if findings:
        raise found_problems(findings, f"{path}: the dataset is damaged")
    if not manifest.get("complete", True):
        _warn(f"{path}: not finished: some frames are missing")
    depth = "all checksums match" if arguments.full else "sizes match; --full compares checksums"
    number = sum(1 for _ in read_contents(path).listed())
    print(f"{path}: {number} files, {depth}; dataset_id {manifest['dataset_id'][:12]}")
    print("\n".join(fidelity_lines(manifest.get("fidelity"))))
    if manifest.get("reference"):
        print(f"poses: a reference measured from the {manifest['reference']['board']} in each photograph, no truth")
    return 0


def verify_export(folder: Path, dataset: str | None) -> int:
    """Hold an export against its checksums, and against its dataset if that is given."""
    from roundel.datasets.dataset import open_dataset
    from roundel.datasets.export.check import check_against, check_files, read_export

    record = read_export(folder)
    findings = check_files(folder, record)
    if dataset is not None:
        findings += check_against(folder, record, open_dataset(dataset))
    if findings:
        raise found_problems(findings, f"{folder}: the export is damaged")
    held = "all checksums match" + (f", and every frame is that of {dataset}" if dataset else "")
    print(f"{folder}: {record['format']}, {record['frames']} frames, {record['files']} files: {held}")
    return 0


def do_repair(arguments: argparse.Namespace) -> int:
    """Restore what `verify --full` finds."""
    from roundel.datasets.repair import study_to_repair, take_away_damage
    from roundel.render.run import render_study

    folder = _there(arguments.dataset)
    study = study_to_repair(folder, arguments.study)
    with progress("verify") as show:
        found = take_away_damage(folder, study, show)
    for note in found.notes:
        _warn(note)
    if found.developed and found.frames:
        raise DataError(
            f"{folder}: {len(found.frames)} frames are damaged and were taken out (the first is {found.frames[0]}); "
            "run the `roundel develop` that made this dataset again to restore them"
        )
    with progress("render") as show:
        dataset = render_study(
            study, arguments.dataset, backend="auto", mix_environments=arguments.mix_environments, progress=show
        )
    assert dataset is not None, "all frames were wanted"
    counts = (len(found.frames), len(found.records), len(found.litter))
    what = ("frames rendered anew", "shards written anew", "leftovers removed")
    done = ", ".join(f"{number} {name}" for number, name in zip(counts, what, strict=True) if number)
    print(f"{folder}: {done or 'nothing to repair'}; dataset_id {dataset.manifest['dataset_id'][:12]}")
    return 0


def do_merge(arguments: argparse.Namespace) -> int:
    """Join datasets that hold parts of the same study."""
    from roundel.datasets.merge import merge_datasets

    with progress("merge") as show:
        missing, total = merge_datasets(
            [str(_there(part)) for part in arguments.parts], arguments.out, arguments.mix_environments, show
        )
    state = "complete" if not missing else f"{missing} frames are still missing"
    print(f"{arguments.out}: {total - missing} of {total} frames, {state}")
    return 0


def do_pull(arguments: argparse.Namespace) -> int:
    """Fetch a dataset, or some of its frames."""
    from roundel.datasets.pull import pull_dataset

    with progress("pull") as show:
        pulled = pull_dataset(str(_there(arguments.dataset)), arguments.out, arguments.frames, show)
    state = "the whole dataset" if pulled.complete else "a part of the dataset"
    print(f"{arguments.out}: {pulled.frames} frames, {pulled.fetched} files of frames fetched: {state}")
    return 0


def do_browse(arguments: argparse.Namespace) -> int:
    """Write a page of all frames."""
    from roundel.validate.browse.page import browse_dataset

    out = Path(arguments.out)
    with progress("browse") as show:
        frames = browse_dataset(readable(arguments.dataset), out, arguments.report, arguments.images, show)
    print(f"{out / 'index.html'}: {frames} frames")
    return 0


def do_import(arguments: argparse.Namespace) -> int:
    """Make a dataset from photographs."""
    from roundel.cli.ingest.import_verb import import_photographs

    return import_photographs(arguments)
