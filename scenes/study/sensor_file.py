"""A `sensor:` section from its own file, applied to every group of a study.

Only processing after the colour filters can change: gain, noise, exposure, bits, colours, the file. Keys that determine
the rays (fill factor, mosaic) or the set of frames (grids) cannot. A `sweep:` in the file repeats every frame at each
level of one key of the sensor.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from roundel.scenes.errors import StudyError, did_you_mean
from roundel.scenes.study.schema import GroupSection, SweepSection, put_level
from roundel.scenes.study.section import Section
from roundel.scenes.study.sensor_section import SensorSection
from roundel.scenes.study.study import Study, validated
from roundel.scenes.study.values import Spread
from roundel.scenes.study.yaml_reader import Marks, read_yaml

# Keys of the sensor that the rays depend on.
RAY_KEYS = ("fill_factor", "mosaic")

_EXPOSURES = ("exposure_e", "exposure_ph")


def study_with_sensor(study: Study, path: str | Path, keep_radiance: bool = True) -> Study:
    """The study with the keys of a file overriding the sensor of each of its groups.

    Parameters
    ----------
    study : Study
    path : path
        YAML: the keys of a `sensor:` section, with or without the `sensor:` key. `null` restores a key's default.
        Beside them `sweep:`, as in a study: each group with images then has every frame once per level. The group from
        which the study calibrates its camera has one level, without the swept key.
    keep_radiance : bool
        Whether its frames keep their radiance, if they do in the study.

    Raises
    ------
    StudyError
        If the file is not a sensor, or changes what needs rendering; with the position in the file.
    """
    path = Path(path)
    raw, sweep, marks = _keys_of(path)
    if sweep is not None:
        _check_key(path, marks, sweep, raw)
    groups: dict[str, GroupSection] = {}
    for name, group in study.groups.items():
        own = sweep if group.mode == "images" and name != study.solve.calibrate_from else None
        sensor = _sensor(path, marks, raw, own, name, group)
        section = {**group.model_dump(exclude_none=True), "sensor": sensor.model_dump(exclude_none=True)}
        if not keep_radiance:
            section["render"]["radiance"] = False
        if own is not None:
            if group.sweep is not None:
                raise _error(
                    path,
                    marks,
                    "sweep",
                    f"group {name} sweeps {group.sweep.key}, and a group has one sweep; leave it out",
                )
            section["sweep"] = own.model_dump()
        # Validate again rather than copy: a copy would keep the section's cached values.
        groups[name] = GroupSection.model_validate(section)
    if sweep is not None and all(group.sweep is None for group in groups.values()):
        raise _error(path, marks, "sweep", "no group has images to repeat, except for those of the calibration")
    return replace(study, groups=groups)


def _sensor(
    path: Path, marks: Marks, raw: dict[str, Any], sweep: SweepSection | None, name: str, group: GroupSection
) -> SensorSection:
    """The sensor of a group with the file's keys; checked at every level of the sweep."""
    base = group.sensor.model_dump(exclude_none=True)
    own = {k: v for k, v in raw.items() if v is not None or k not in SensorSection.model_fields}
    merged = {**{k: v for k, v in base.items() if k not in raw}, **own}
    swept = None if sweep is None else str(sweep.path[1])
    given = {key for key, value in raw.items() if value is not None} | ({swept} if swept else set())
    fixed = given & set(_EXPOSURES)
    if fixed:
        # A new exposure in electrons replaces one in photons, and vice versa.
        merged = {k: v for k, v in merged.items() if k not in _EXPOSURES or k in fixed}
    elif "white_level" in given and any(key in merged for key in _EXPOSURES):
        message = f"group {name} has a fixed exposure; add {_null_of(merged)}"
        raise _error(path, marks, "white_level" if "white_level" in raw else "sweep", message)
    sensor: SensorSection = validated(SensorSection, merged, path, marks, None)
    _check(path, marks, raw, name, group, sensor)
    if sweep is not None:
        if _has_grid(getattr(group.sensor, str(swept))):
            raise _error(path, marks, "sweep", f"group {name} has a grid of {sweep.key}; sweep another key")
        for i in range(len(sweep.levels)):
            _check_level(path, marks, sweep, i, sensor)
    return sensor


def _keys_of(path: Path) -> tuple[dict[str, Any], SweepSection | None, Marks]:
    """The keys of a sensor in a file, its sweep, and where they are."""
    raw, marks = read_yaml(path)
    sweep = None
    if isinstance(raw, dict) and "sweep" in raw:
        raw = dict(raw)
        given = {"sweep": raw.pop("sweep")}
        sweep = validated(_SweepAlone, given, path, marks, None).sweep
    if isinstance(raw, dict) and list(raw) == ["sensor"]:
        inner = {where[1:]: place for where, place in marks.items() if where[:1] == ("sensor",)}
        raw, marks = raw["sensor"], {**{k: v for k, v in marks.items() if k[:1] == ("sweep",)}, **inner}
    if not isinstance(raw, dict):
        raise StudyError("expected a mapping with the keys of a `sensor:` section", path, *marks.get((), (1, 1)))
    return raw, sweep, marks


class _SweepAlone(Section):
    """For messages that name the key in full."""

    sweep: SweepSection


def _check_key(path: Path, marks: Marks, sweep: SweepSection, raw: dict[str, Any]) -> None:
    """Refuse a sweep over what needs rendering, or over a key that the file also gives."""
    known = [key for key in SensorSection.model_fields if key not in RAY_KEYS]
    first, *rest = sweep.path
    if first != "sensor" or not rest:
        message = f"write sensor.{sweep.key}" if first in known else "needs rendering"
    elif rest[0] in RAY_KEYS:
        message = "determines which rays are traced, and needs rendering"
    elif rest[0] not in known:
        hint = did_you_mean(str(rest[0]), known)
        message = "no such key" + (f", {hint}" if hint else "")
    elif sweep.key.removeprefix("sensor.") in raw:
        raise _error(path, marks, str(rest[0]), "is swept as well; leave it out, or sweep another key")
    else:
        return
    text = f"sweep.key: {sweep.key}: {message}; these keys of the sensor can be re-exposed: {', '.join(known)}"
    raise StudyError(text, path, *marks.get(("sweep", "key"), (1, 1)))


def _check_level(path: Path, marks: Marks, sweep: SweepSection, i: int, sensor: SensorSection) -> None:
    """Refuse a level that the sensor cannot have."""
    level = sweep.levels[i]
    keys = sensor.model_dump(exclude_none=True)
    try:
        put_level(keys, sweep.path[1:], level)
    except (KeyError, IndexError, TypeError) as error:
        place = marks.get(("sweep", "key"), (1, 1))
        raise StudyError(f"sweep.key: no key {sweep.key!r} in this sensor", path, *place) from error
    try:
        validated(SensorSection, keys, path, {}, None)
    except StudyError as error:
        place = marks.get(("sweep", "levels", i), marks.get(("sweep",), (1, 1)))
        shown = level if isinstance(level, str) else f"{level:g}"
        raise StudyError(f"sweep.levels: {shown}: {error.reason}", path, *place) from error


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
