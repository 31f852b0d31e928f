"""Begin or continue a dataset: its folder, its study, and what is known of the environments of its frames."""

from __future__ import annotations

from collections.abc import Iterable

from roundel.datasets.environment import Environment, key_of
from roundel.datasets.layout import files, journal
from roundel.datasets.layout.manifest import read_manifest, read_shard
from roundel.datasets.layout.shards import Shard
from roundel.datasets.records import study_bytes
from roundel.datasets.store.addresses import Address, store_at
from roundel.datasets.store.folder import Folder
from roundel.datasets.store.store import Store
from roundel.scenes.errors import DataError, RoundelError, UsageError
from roundel.scenes.study.study import Study, load_study


def prepare(study: Study, dataset: Address) -> Store:
    """The folder of a dataset, new or one that holds this study.

    Raises
    ------
    UsageError
        If the folder holds another study's dataset, or something else.
    DataError
        If its study is corrupt, or it was begun by an older version.
    """
    folder = store_at(dataset)
    if isinstance(folder, Folder) and folder.path.exists() and not folder.path.is_dir():
        raise UsageError(f"{dataset}: is a file; name a folder for the dataset")
    if folder.size(files.STUDY) is not None:
        digest = held_study(folder).digest()
        if digest != study.digest():
            raise UsageError(
                f"{dataset}: holds frames of another study (dataset_id {digest[:12]}, not {study.digest()[:12]}); "
                "name another folder, remove this one, or restore the study"
            )
        if _begun_by_version_1(folder):
            raise DataError(
                f"{dataset}: was begun by an older version of Roundel; finish it with that version, or render into "
                "another folder"
            )
        folder.clear_leftovers()
        return folder
    folder.clear_leftovers()
    # Others may have begun it in this moment.
    if folder.is_occupied() and folder.size(files.STUDY) is None:
        raise UsageError(f"{dataset}: is not empty and not a dataset; name another folder")
    if not folder.write_new(files.STUDY, study_bytes(study)):
        raise UsageError(f"{dataset}: another study was just begun there; name another folder")
    return folder


def _begun_by_version_1(folder: Store) -> bool:
    """Whether a dataset without a manifest has a journal whose lines have no checksums."""
    if folder.size(files.JOURNAL) is None or folder.size(files.MANIFEST) is not None:
        return False
    first = folder.read(files.JOURNAL).split(b"\n", 1)[0]
    return journal.is_old(first)


def refuse_imported(folder: Store) -> None:
    """Refuse what needs frames that were rendered.

    Raises
    ------
    UsageError
        If the dataset holds imported photographs.
    """
    if folder.size(files.REFERENCE) is not None:
        raise UsageError(
            f"{folder}: holds imported photographs, of which nothing was rendered: they cannot be rendered, developed, "
            "joined or repaired; run `roundel import` again"
        )


def held_study(folder: Store) -> Study:
    """The study of a dataset that was rendered.

    Raises
    ------
    DataError
        If it is missing or corrupt.
    UsageError
        If the dataset holds imported photographs.
    """
    refuse_imported(folder)
    place = folder.place(files.STUDY)
    data = folder.read(files.STUDY, most=files.MOST_STUDY_BYTES)  # refuses links and devices
    try:
        # Read from the folder where it lies: files that it names are relative to it.
        with folder.on_disk(files.STUDY, data) as path:
            return load_study(path)
    except RoundelError as error:
        raise DataError(f"{place}: corrupt ({error}); name another folder, or remove this one") from error


def recorded_environments(folder: Store, shard: Shard) -> dict[str, Environment]:
    """Environments of a shard's frames that its record, or the manifest, tells; empty if neither can be read."""
    try:
        if shard.folder:
            found = read_shard(folder, shard, None)
            return {} if found is None else dict(found[0]["environments"])
        record, manifest = read_manifest(folder)
    except DataError:
        return {}
    if manifest.environments is not None:
        return dict(record["environments"])
    one = {"environment": manifest.environment, "versions": manifest.versions}
    return {key_of(one): one}


def backend_to_resume(dataset: str, entries: Iterable[journal.Entry], asked: str) -> str:
    """The backend of finished frames, with which a dataset is continued.

    Raises
    ------
    UsageError
        If another one is asked for.
    """
    begun = next((str(entry.get("backend", "llvm")) for entry in entries), asked)
    if asked not in (begun, "auto"):
        raise UsageError(
            f"{dataset}: its frames were rendered with --backend {begun}; continue with that, "
            f"or render with --backend {asked} into another folder"
        )
    return begun
