"""A study: what is rendered, solved and validated, read from YAML into checked sections.

`load_study` is the only entry point: whatever it returns is complete, finite and consistent. An invalid study raises a
one-line error with the position in the file.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from roundel.scenes.assets.light_map import map_sha256
from roundel.scenes.camera.intrinsics_label import IntrinsicsLabel
from roundel.scenes.errors import StudyError, did_you_mean
from roundel.scenes.study.identity import study_digest
from roundel.scenes.study.layers import deep_merge, preset, preset_names, with_variants
from roundel.scenes.study.light_section import LAMPS, LightSection
from roundel.scenes.study.marker_section import CALIBRATION_BOARDS
from roundel.scenes.study.marker_section import KINDS as MARKERS
from roundel.scenes.study.sampling import frame_count
from roundel.scenes.study.schema import (
    SCHEMA_VERSION,
    GroupSection,
    Head,
    SolveSection,
    ValidateSection,
)
from roundel.scenes.study.section import Section
from roundel.scenes.study.world_files import has_own_lights, recorded
from roundel.scenes.study.yaml_reader import Marks, read_yaml

DEFAULT_GROUP = "main"
_SHARED = (
    "preset",
    "world",
    "mode",
    "frames",
    "frames_per_cell",
    "camera",
    "marker",
    "pose",
    "markers",
    "motion",
    "light",
    "occluders",
    "sensor",
    "render",
    "points",
    "sweep",
)
_HEAD = ("schema", "name", "seed", "licence", "solve", "validate")


@dataclass(frozen=True)
class Study:
    """A resolved study: every group is complete, with all defaults filled in."""

    path: Path
    name: str
    seed: int
    licence: str
    groups: dict[str, GroupSection]
    solve: SolveSection
    validate: ValidateSection
    marks: Marks

    def resolved(self) -> dict[str, Any]:
        """The study as plain values with all defaults, as in `study.yaml` of a dataset."""
        return {
            "schema": SCHEMA_VERSION,
            "name": self.name,
            "seed": self.seed,
            "licence": self.licence,
            "groups": {name: group.model_dump(mode="json", exclude_none=True) for name, group in self.groups.items()},
            "solve": self.solve.model_dump(mode="json", exclude_none=True),
            "validate": self.validate.model_dump(mode="json", exclude_none=True),
        }

    def digest(self) -> str:
        """The dataset_id: sha256 of everything that determines the frames; see `scenes.study.identity`."""
        return study_digest(self)

    def error(self, message: str, group: str, *keys: str | int) -> StudyError:
        """A StudyError at the position of a group's key (or of its nearest parent)."""
        line, column = _place(self.marks, group, keys)
        return StudyError(message, self.path, line, column)


def _place(marks: Marks, group: str | None, keys: tuple[str | int, ...]) -> tuple[int, int]:
    """Position of a key: in the group if it is there, else in the shared part, else its nearest parent."""
    for cut in range(len(keys), -1, -1):
        tail = keys[:cut]
        if group is not None and tail and ("groups", group, *tail) in marks:
            return marks["groups", group, *tail]
        if tail and tail in marks:
            return marks[tail]
    return marks.get(("groups", group) if group is not None else (), (1, 1))


# Unions of sections are discriminated by `kind`; pydantic then adds the tag to its error locations.
_KINDS: dict[str, dict[str, type[Section]]] = {"marker": MARKERS, "kinds": MARKERS, "lamps": LAMPS}


def _models_of(annotation: Any) -> list[type[BaseModel]]:
    """The sections in an annotation such as `list[Section] | None`."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for inner in getattr(annotation, "__args__", ()) for model in _models_of(inner)]


def _keys_at(model: type[BaseModel], location: tuple[Any, ...]) -> list[str]:
    """The valid keys of the section at `location`, for suggestions."""
    known: type[BaseModel] | None = model
    kinds: dict[str, type[Section]] = {}
    for part in location:
        if isinstance(part, int):
            continue
        if part in kinds:
            known, kinds = kinds[part], {}
            continue
        if known is None:
            return []
        kinds = _KINDS.get(part, {})
        annotation = next((f.annotation for n, f in known.model_fields.items() if part in (n, f.alias)), None)
        known = next(iter(_models_of(annotation)), None)
    return [] if known is None or kinds else [f.alias or n for n, f in known.model_fields.items()]


def _nearest(word: str, known: list[str]) -> str:
    hint = did_you_mean(word, known) or (f"use one of {', '.join(sorted(known))}" if known else "")
    return f"; {hint}" if hint else ""


def _in_file(raw: tuple[Any, ...]) -> tuple[Any, ...]:
    """Convert a pydantic error location to a key path in the file, dropping union tags."""
    kept: list[Any] = []
    kinds: dict[str, type[Section]] = {}
    for part in raw:
        if isinstance(part, int):
            kept.append(part)
        elif part in kinds:
            kinds = {}
        elif part == "others" and kept == ["markers"]:
            continue  # a list is short for it
        elif part.isidentifier() and part not in ("constrained-int", "int"):
            kinds = _KINDS.get(part, {})
            kept.append(part)
    return tuple(kept)


# Replacements for pydantic's messages, which name Python types.
_EXPECTED = {
    "model_type": "a mapping of keys",
    "dict_type": "a mapping of keys",
    "list_type": "a list, as in [a, b]",
    "string_type": "a string",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
}


def _sentence(error: Any, model: type[BaseModel]) -> tuple[str, tuple[Any, ...]]:
    """One pydantic error as (message, location in the section)."""
    raw = error["loc"]
    location = _in_file(raw)
    kinds = list(next((_KINDS[p] for p in reversed(location) if p in _KINDS), {}))
    dotted = ".".join(str(p) for p in location)
    context = error.get("ctx", {})
    if error["type"] == "extra_forbidden":
        # A key that is no identifier is no part of a location.
        shown = dotted if location and location[-1] == raw[-1] else ".".join(filter(None, (dotted, repr(raw[-1])[:80])))
        return f"{shown}: unknown key{_nearest(str(raw[-1]), _keys_at(model, raw[:-1]))}", location
    if error["type"] == "missing":
        return f"{dotted}: required key is missing; add it", location
    if error["type"] == "union_tag_invalid":
        return f"{dotted}.kind: unknown kind {context.get('tag')!r}{_nearest(str(context.get('tag')), kinds)}", (
            *location,
            "kind",
        )
    if error["type"] == "union_tag_not_found":
        return f"{dotted}.kind: required key is missing; one of {', '.join(kinds)}", location
    text = str(context["error"]) if "error" in context else error["msg"][0].lower() + error["msg"][1:]
    given = error.get("input")
    if error["type"] in _EXPECTED:
        text = f"give {_EXPECTED[error['type']]}"
        if error["type"] == "string_type" and isinstance(given, bool):
            return (
                f'{dotted}: YAML reads this word as a boolean; put it in quotes: "{str(given).lower()}"',
                location,
            )
    shown = f", not {given!r}" if "error" not in context and isinstance(given, str | int | float | bool | None) else ""
    return f"{dotted}: {text}{shown}" if dotted else text, location


def validated(model: type[Any], raw: dict[str, Any], path: Path, marks: Marks, group: str | None) -> Any:
    """Validate raw keys into a section; errors carry their position in the file."""
    try:
        return model.model_validate(raw)
    except ValidationError as error:
        # Report the first error in file order; the others often follow from it.
        found = [_sentence(e, model) for e in error.errors(include_url=False)]
        placed = sorted((_place(marks, group, location), message) for message, location in found)
        (line, column), message = placed[0]
        more = f" (and {len(placed) - 1} more)" if len(placed) > 1 else ""
        raise StudyError(message + more, path, line, column) from error


def load_study(path: str | Path) -> Study:
    """Read and check a study.

    Parameters
    ----------
    path : path
        A YAML file.

    Returns
    -------
    Study

    Raises
    ------
    StudyError
        With `.path`, `.line` and `.column`; its message is one line.
    """
    path = Path(path)
    raw, marks = read_yaml(path)
    if not isinstance(raw, dict):
        raise StudyError("a study is a mapping of keys", path)
    top = [*_HEAD, *_SHARED, "groups", "variants"]
    for key in raw:
        if key not in top:
            raise StudyError(f"{key}: unknown key{_nearest(key, top)}", path, *marks[(key,)])
    head: Head = validated(Head, {k: raw[k] for k in _HEAD if k in raw}, path, marks, None)
    shared = {k: raw[k] for k in _SHARED if k in raw}
    own = _named_sections(raw.get("groups", {DEFAULT_GROUP: {}}), "groups", path, marks)
    if "variants" in raw:
        variants = _named_sections(raw["variants"], "variants", path, marks)
        own, marks = with_variants(own, variants, marks)
    groups: dict[str, GroupSection] = {}
    for name, section in own.items():
        named = section.get("preset", shared.get("preset"))
        layers = [_preset(named, path, _place(marks, name, ("preset",))), shared, section]
        merged = reduce(deep_merge, layers)
        merged.pop("preset", None)
        groups[name] = validated(GroupSection, merged, path, marks, name)
    study = Study(path, head.name, head.seed, head.licence, groups, head.solve, head.validate_, marks)
    _check_references(study)
    _check_colours(study)
    return _with_checksums(study)


def _named_sections(raw: Any, what: str, path: Path, marks: Marks) -> dict[str, dict[str, Any]]:
    """Groups or variants by name, as written.

    Raises
    ------
    StudyError
        If they are not a mapping of names to keys.
    """
    one = what[:-1]
    if not isinstance(raw, dict) or not raw:
        raise StudyError(f"{what}: needs at least one {one}, as a mapping of names", path, *marks[(what,)])
    for name, section in raw.items():
        place = marks.get((what, name), (1, 1))
        # A dot joins a group and its variant, in the resolved study of a dataset.
        dots = what == "groups" and ("variants",) not in marks
        if not "".join(c for c in name if c not in ("-_." if dots else "-_")).isalnum():
            raise StudyError(f"{what}.{name}: a {one} name may contain only letters, digits, - and _", path, *place)
        if not isinstance(section, dict):
            raise StudyError(f"{what}.{name}: a {one} is a mapping of keys", path, *place)
    return raw


def _preset(name: Any, path: Path, place: tuple[int, int]) -> dict[str, Any]:
    if name is None:
        return {}
    if name not in preset_names():
        raise StudyError(f"preset: unknown preset {name!r}{_nearest(str(name), preset_names())}", path, *place)
    return preset(name)


def _with_checksums(study: Study) -> Study:
    """The study with the sha256 of each file it names, so that its digest covers their content, too."""
    return replace(study, groups={name: _recorded(study, name) for name in study.groups})


def _recorded(study: Study, name: str) -> GroupSection:
    group, folder = study.groups[name], study.path.parent
    found: dict[str, dict[str, Any]] = {}
    if group.light.map is not None:
        try:
            found["light"] = {"map": {"sha256": map_sha256(folder, group.light.map.file, group.light.map.sha256)}}
        except ValueError as error:
            raise study.error(f"light.map.file: {error}", name, "light", "map", "file") from error
    try:
        found["world"] = recorded(folder, group.world)
    except ValueError as error:
        raise study.error(
            f"world.{error}", name, "world", "pictures" if group.world.scene is None else "scene"
        ) from error
    if not any(found.values()):
        return group
    # Validate again rather than copy: a copy would keep the section's cached values.
    whole = GroupSection.model_validate(deep_merge(group.model_dump(exclude_none=True), found))
    if whole.light != LightSection() and has_own_lights(folder, whole.world):
        raise study.error(
            "light: the scene has lights of its own; leave out light, or remove its emitters", name, "light"
        )
    return whole


def _check_pair(study: Study, name: str, group: GroupSection) -> None:
    """Check that a group draws what its partner draws: the same number has to mean the same."""
    other = study.groups.get(group.paired_with or "")
    if other is None or group.paired_with == name:
        known = [known for known in study.groups if known != name]
        raise study.error(
            f"paired_with: no other group {group.paired_with!r}{_nearest(str(group.paired_with), known)}",
            name,
            "paired_with",
        )
    if other.paired_with is not None:
        raise study.error(
            f"paired_with: name {other.paired_with!r}, which {group.paired_with!r} has", name, "paired_with"
        )
    if group.spreads != other.spreads:
        ours, theirs = ({".".join(map(str, key)): spread for key, spread in g.spreads} for g in (group, other))
        differs = next((key for key in {**ours, **theirs} if ours.get(key) != theirs.get(key)), "their order")
        raise study.error(
            f"paired_with: group {group.paired_with!r} draws other values ({differs}); give both the same",
            name,
            "paired_with",
        )

    grids = any(spread.kind == "grid" for _, spread in group.spreads)
    if grids and (group.frames, group.frames_per_cell) != (other.frames, other.frames_per_cell):
        raise study.error("paired_with: with grids both groups need the same number of frames", name, "paired_with")


def _check_colours(study: Study) -> None:
    for name, group in study.groups.items():
        if group.camera.lateral_ca and group.sensor.mosaic == "none":
            message = "camera.lateral_ca: only colours are magnified differently; add sensor.mosaic, or leave it out"
            raise study.error(message, name, "camera", "lateral_ca")


def _check_references(study: Study) -> None:
    def fail(message: str, *keys: str) -> StudyError:
        return StudyError(message, study.path, *_place(study.marks, None, keys))

    for name in study.solve.groups or []:
        if name not in study.groups:
            raise fail(f"solve.groups: no group {name!r}{_nearest(name, list(study.groups))}", "solve", "groups")
    for name, group in study.groups.items():
        if group.paired_with is not None:
            _check_pair(study, name, group)
    source = study.solve.calibrate_from
    if source is not None:
        if source not in study.groups:
            raise fail(
                f"solve.calibrate_from: no group {source!r}{_nearest(source, list(study.groups))}",
                "solve",
                "calibrate_from",
            )
        if study.groups[source].marker.kind not in CALIBRATION_BOARDS:
            boards = " or ".join(CALIBRATION_BOARDS)
            raise fail(f"solve.calibrate_from: group {source!r} has no {boards}", "solve", "calibrate_from")
    for label in study.solve.intrinsics:
        views = IntrinsicsLabel.of(label).views
        if views is None and label != "calibrated":
            continue
        if source is None:
            message = f"solve.intrinsics: `{label}` needs solve.calibrate_from, a group of boards"
            raise fail(message, "solve", "intrinsics")
        try:
            there = frame_count(study.groups[source])
        except ValueError:
            # Frames that are not a multiple of the cells are reported elsewhere, at their own position.
            continue
        if views is not None and views > there:
            message = f"solve.intrinsics: `{label}` needs {views} views, but group {source!r} has {there}"
            raise fail(message, "solve", "intrinsics")
