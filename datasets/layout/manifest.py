"""The manifest of a dataset, read and checked."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from roundel.datasets.layout import files
from roundel.scenes.errors import DataError


def read_manifest(path: Path) -> dict[str, Any]:
    """The manifest of a dataset.

    Raises
    ------
    DataError
        If it is missing or is not a manifest.
    """
    file = path / files.MANIFEST
    try:
        manifest = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise DataError(f"{file}: the manifest is missing; finish the dataset with `roundel render`") from error
    except (OSError, ValueError) as error:
        raise DataError(f"{file}: the manifest is corrupt; run `roundel render` again to rewrite it") from error
    needed = {"schema", "dataset_id", "study", "files", "counts"}
    if not isinstance(manifest, dict) or needed - set(manifest):
        raise DataError(f"{file}: not the manifest of a Roundel dataset")
    if manifest["schema"] != 1:
        raise DataError(f"{file}: schema {manifest['schema']} is not supported by this version; use a newer Roundel")
    return manifest
