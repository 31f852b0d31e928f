"""A `sensor:` section from its own file, applied to every group of a study.

Only processing after the colour filters can change: gain, noise, exposure, bits, colours, the file. Keys that determine
the rays (fill factor, mosaic) or the set of frames (grids, a sweep) cannot.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from roundel.scenes.errors import StudyError
from roundel.scenes.study.schema import GroupSection
from roundel.scenes.study.section import Section
from roundel.scenes.study.sensor_section import SensorSection
from roundel.scenes.study.study import Study, validated
from roundel.scenes.study.values import Spread
from roundel.scenes.study.yaml_reader import Marks, read_yaml

# Keys of the sensor that the rays depend on.
RAY_KEYS = ("fill_factor", "mosaic")

_EXPOSURES = ("exposure_e", "exposure_ph")


def study_with_sensor(study: Study, path: str | Path) -> Study:
    """The study with the keys of a file overriding the sensor of each of its groups.

    Parameters
    ----------
    study : Study
    path : path
        YAML: the keys of a `sensor:` section, with or without the `sensor:` key. `null` restores a key's default.

    Raises
    ------
    StudyError
        If the file is not a sensor, or changes what needs rendering; with the position in the file.
    """
    path = Path(path)
    raw, marks = _keys_of(path)
    groups: dict[str, GroupSection] = {}
    for name, group in study.groups.items():
        base = group.sensor.model_dump(exclude_none=True)
        own = {k: v for k, v in raw.items() if v is not None or k not in SensorSection.model_fields}
        merged = {**{k: v for k, v in base.items() if k not in raw}, **own}
        fixed = [key for key in _EXPOSURES if raw.get(key) is not None]
        if fixed:
            # A new exposure in electrons replaces one in photons, and vice versa.
            merged = {k: v for k, v in merged.items() if k not in _EXPOSURES or k in fixed}
        elif raw.get("white_level") is not None and any(key in merged for key in _EXPOSURES):
            raise _error(path, marks, "white_level", f"group {name} has a fixed exposure; add {_null_of(merged)}")
        sensor: SensorSection = validated(SensorSection, merged, path, marks, None)
        _check(path, marks, raw, name, group, sensor)
        # Validate again rather than copy: a copy would keep the section's cached values.
        groups[name] = GroupSection.model_validate(
            {**group.model_dump(exclude_none=True), "sensor": sensor.model_dump(exclude_none=True)}
        )
    return replace(study, groups=groups)


def _keys_of(path: Path) -> tuple[dict[str, Any], Marks]:
    raw, marks = read_yaml(path)
    if isinstance(raw, dict) and list(raw) == ["sensor"]:
        raw, marks = raw["sensor"], {where[1:]: place for where, place in marks.items() if where[:1] == ("sensor",)}
    if not isinstance(raw, dict):
        raise StudyError("expected a mapping with the keys of a `sensor:` section", path, *marks.get((), (1, 1)))
    return raw, marks


def _error(path: Path, marks: Marks, key: str, message: str) -> StudyError:
    return StudyError(f"{key}: {message}", path, *marks.get((key,), (1, 1)))


def _null_of(merged: dict[str, Any]) -> str:
    return next(f"`{key}: null` to expose for the sheet's white" for key in _EXPOSURES if key in merged)


def _has_grid(value: Any) -> bool:
    values = [getattr(value, name) for name in type(value).model_fields] if isinstance(value, Section) else [value]
    return any(isinstance(v, Spread) and v.kind == "grid" for v in values)


def _check(
    path: Path, marks: Marks, raw: dict[str, Any], name: str, group: GroupSection, sensor: SensorSection
) -> None:
    """Refuse keys that would need different rays or different frames."""
    for key in RAY_KEYS:
        if getattr(sensor, key) != getattr(group.sensor, key):
            raise _error(
                path,
                marks,
                key,
                f"determines which rays are traced; render group {name} again to change it, or leave it out",
            )
    for key in raw:
        old, new = getattr(group.sensor, key), getattr(sensor, key)
        if old != new and (_has_grid(old) or _has_grid(new)):
            raise _error(
                path,
                marks,
                key,
                f"a grid determines the number of frames in group {name}; use another distribution",
            )
        if group.sweep is not None and group.sweep.key.split(".")[:2] == ["sensor", key]:
            raise _error(path, marks, key, f"is swept in group {name}, and the levels would override it; leave it out")
