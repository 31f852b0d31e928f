"""Integrity of a dataset: presence, size, checksum and readability of every file. Never writes."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from roundel.datasets.layout import files, journal
from roundel.datasets.layout.images import read_image
from roundel.datasets.layout.manifest import read_manifest
from roundel.datasets.layout.radiance import read_radiance
from roundel.datasets.numbers import other_numbers
from roundel.scenes.errors import DataError


@dataclass(frozen=True)
class Finding:
    """One problem: the file, what is wrong, and what to do."""

    name: str
    what: str

    def __str__(self) -> str:
        return f"{self.name}: {self.what}"


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _check_file(path: Path, name: str, size: int, digest: str, full: bool) -> str | None:
    file = path / name
    if not file.is_file():
        return "missing; run `roundel render` again to restore it"
    if file.stat().st_size != size:
        return f"{file.stat().st_size} bytes, but the manifest records {size}; run `roundel render` again to restore it"
    if full and _digest(file) != digest:
        return "its sha256 differs from the manifest's; delete it and run `roundel render` again"
    if full and name.endswith((".png", ".jpg", ".exr")):
        try:
            if name.endswith(".exr"):
                read_radiance(file)
            else:
                read_image(file)
        except DataError as error:
            return str(error).removeprefix(f"{file}: ")
    return None


def verify_dataset(path: str | Path, full: bool = False) -> list[Finding]:
    """Compare a dataset with its manifest.

    Parameters
    ----------
    path : path
    full : bool
        Also compute every sha256, decode every image and draw every frame's values again; otherwise sizes only.

    Returns
    -------
    list of Finding
        Empty if there are no problems.

    Raises
    ------
    DataError
        If there is no readable manifest.
    """
    path = Path(path)
    file = path / files.MANIFEST
    try:
        recorded = {n: (int(r["bytes"]), str(r["sha256"])) for n, r in read_manifest(path)["files"].items()}
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise DataError(f"{file}: its list of files is corrupt; run `roundel render` again to rewrite it") from error
    findings = []
    for name, (size, digest) in sorted(recorded.items()):
        wrong = _check_file(path, name, size, digest, full)
        if wrong is not None:
            findings.append(Finding(name, wrong))
    for folder in ("images", "radiance"):
        for extra in sorted((path / folder).glob("*")):
            name = f"{folder}/{extra.name}"
            if name not in recorded:
                findings.append(Finding(name, "not in the manifest; delete it"))
    try:
        entries = journal.read(path)
        if full:
            findings += [Finding(files.JOURNAL, what) for what in other_numbers(path, entries)]
        listed = {name for entry in entries.values() for name in entry["files"]}
        for name in sorted(n for n in recorded if n.startswith(("images/", "radiance/")) and n not in listed):
            findings.append(Finding(name, "listed in the manifest but not in the journal; run `roundel render` again"))
    except DataError as error:
        findings.append(Finding(files.JOURNAL, str(error)))
    return findings
