"""The keys of a study, from its pydantic models: type, default and meaning of each."""

from __future__ import annotations

import json
import re
from typing import Any

from pydantic import BaseModel

from roundel.scenes.study.schema import GroupSection, Head, json_schema

_INTRODUCTION = """# Keys of a study

A study is a YAML file. `roundel check STUDY` prints it with every default; `roundel check --schema` prints a JSON
Schema for editors. Wherever a *value* is asked for, a number or a distribution may stand:

| value | each frame gets |
|---|---|
| `1280` | this number |
| `{grid: [15, 30, 45]}` | one of these; every combination of all grids is a cell |
| `{choice: [1.8, 2.8]}` | one of these, all equally likely |
| `{uniform: [15, 45]}` | a number between these |
| `{loguniform: [5, 50]}` | the same, uniform in the logarithm |
| `{normal: [1.0, 0.1]}` | mean and standard deviation, cut at 4 standard deviations |

Keys of a group may stand at the top of the file, where all groups share them, or under `groups: {NAME: ...}`. Units
are in the keys' names.

| key beside the sections | meaning |
|---|---|
| `groups` | groups of frames by name, each with keys that replace the shared ones |
| `variants` | repeats every group with the keys of each variant over its own, as `GROUP.VARIANT`, on the same draws |

```yaml
schema: 1
name: example
camera: {width_px: 1280, height_px: 720, focal_px: 1280}
marker: {kind: disc, diameter_m: 0.08}
pose:
  distance_D: {grid: [10, 20]}
  tilt_deg: {uniform: [15, 45]}
frames: 8
```
"""

_NAMES = {"Head": "The study", "GroupSection": "A group"}


def study_page() -> str:
    """The page as Markdown: a table for each section, in the order in which sections name each other."""
    schema = json_schema()
    found: dict[str, type[BaseModel]] = {}

    def walk(model: type[BaseModel]) -> None:
        if model.__name__ in found:
            return
        found[model.__name__] = model
        for field in model.model_fields.values():
            for inner in _models(field.annotation):
                walk(inner)

    for model in (Head, GroupSection):
        walk(model)
    definitions = schema["$defs"]
    lines = [_INTRODUCTION]
    for name, model in found.items():
        properties = definitions.get(name, {}).get("properties") or model.model_json_schema(by_alias=True)["properties"]
        lines += [f"({_anchor(name)})=", f"## {title_of(name)}", "", _sentence(model), ""]
        lines += ["| key | type | default | meaning |", "|---|---|---|---|"]
        for key, field in model.model_fields.items():
            shown = field.alias or key
            about = properties[shown]
            default = "required" if field.is_required() else _default(field.get_default(call_default_factory=True))
            lines.append(
                f"| `{shown}` | {_type(field.annotation, about)} | {default} | {_text(about['description'])} |"
            )
        lines.append("")
    return "\n".join(lines)


def title_of(name: str) -> str:
    """Heading of a section: `CameraSection` is "camera"."""
    if name in _NAMES:
        return _NAMES[name]
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name.removesuffix("Section").removesuffix("Keys")).lower()
    return words.capitalize()


def _anchor(name: str) -> str:
    return f"keys-{name.lower()}"


def _models(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for inner in getattr(annotation, "__args__", ()) for model in _models(inner)]


def _sentence(model: type[BaseModel]) -> str:
    return " ".join((model.__doc__ or "").split())


def _text(text: str) -> str:
    return text.replace("|", "\\|").replace("*", "\\*").replace("<", "&lt;").replace("_", "\\_")


def _default(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, BaseModel):
        return "its own defaults"
    return f"`{json.dumps(value)}`"


def _type(annotation: Any, about: dict[str, Any]) -> str:
    models = _models(annotation)
    if models:
        links = ", ".join(f"[{title_of(m.__name__).lower()}](#{_anchor(m.__name__)})" for m in models)
        return f"list of {links}" if about.get("type") == "array" else links
    return _plain_type(about)


def _plain_type(about: dict[str, Any]) -> str:
    if "const" in about:
        return f"`{about['const']}`"
    if "enum" in about:
        return ", ".join(f"`{value}`" for value in about["enum"])
    options = [o for o in about.get("anyOf", ()) if o.get("type") != "null"]
    if any("uniform" in o.get("properties", {}) for o in options):
        return "value"
    if options:
        return " or ".join(dict.fromkeys(_plain_type(o) for o in options))
    if about.get("type") == "array":
        return f"list of {_plain_type(about.get('items', {}))}s".replace("texts", "text")
    names = {
        "integer": "whole number",
        "number": "number",
        "string": "text",
        "boolean": "`true` or `false`",
        "object": "mapping",
    }
    return names.get(about.get("type", ""), "text")
