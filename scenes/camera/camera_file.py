"""Camera files: the camera keys of `cameras.json`, with the covariance of a calibration, as JSON or YAML."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from roundel.scenes.errors import DataError, UsageError, first_line

YAML_SUFFIXES = (".yaml", ".yml")
SUFFIXES = (".json", *YAML_SUFFIXES)


def camera_file_text(record: dict[str, Any], path: str | Path) -> str:
    """The text of a camera file: YAML if its name says so, else JSON."""
    if Path(path).suffix.lower() not in YAML_SUFFIXES:
        return json.dumps(record, indent=2) + "\n"
    import yaml

    return str(yaml.safe_dump(json.loads(json.dumps(record)), sort_keys=False, default_flow_style=None, width=120))


def read_camera_record(path: str | Path) -> dict[str, Any]:
    """The content of a camera file; JSON is YAML, too.

    Raises
    ------
    UsageError
        If there is no such file.
    DataError
        If it is no mapping in JSON or YAML.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
        record = _parsed(text, path)
    except FileNotFoundError as error:
        raise UsageError(f"{path}: no such camera file; `roundel calibrate` writes one") from error
    except (OSError, ValueError, RecursionError) as error:
        raise DataError(f"{path}: not a camera file: {first_line(error)}") from error
    if not isinstance(record, dict):
        raise DataError(f"{path}: not a camera file: it needs width_px, height_px and K")
    return record


def _parsed(text: str, path: Path) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        if path.suffix.lower() not in YAML_SUFFIXES:
            raise
    # JSON is tried first under either name: PyYAML takes its 1e-05 for a string.
    import yaml

    try:
        return yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise ValueError(first_line(error)) from error
