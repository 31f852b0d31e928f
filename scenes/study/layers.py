"""Layers of a study: a preset, then shared keys, then a group's own keys, then those of a variant."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

from roundel.scenes.study.values import is_spread
from roundel.scenes.study.yaml_reader import Marks, read_yaml

# Mutually exclusive keys: setting one removes the other from the inherited layer.
_EITHER = (
    {"frames", "frames_per_cell"},
    {"focal_px", "focal_mm"},
    {"f_number", "aperture_mm"},
    {"distance_m", "distance_D"},
    {"exposure_e", "exposure_ph"},
    {"map", "sky"},
)


def deep_merge(below: Any, own: Any) -> Any:
    """Merge `own` over `below` key by key; a distribution, a list or a section of another kind replaces."""
    if not (isinstance(below, dict) and isinstance(own, dict)) or is_spread(below) or is_spread(own):
        return own
    if None not in (_kind(own), _kind(below)) and _kind(own) != _kind(below):
        return own
    kept = {k: v for k, v in below.items() if not any(k in pair and (pair - {k}) & set(own) for pair in _EITHER)}
    return {**kept, **{k: deep_merge(kept[k], v) if k in kept else v for k, v in own.items()}}


def _kind(section: dict[str, Any]) -> Any:
    """The kind of a section; a world that names a scene needs no other."""
    return section.get("kind", "scene" if "scene" in section else None)


def with_variants(groups: dict[str, Any], variants: dict[str, Any], marks: Marks) -> tuple[dict[str, Any], Marks]:
    """Every group with the keys of every variant over its own, named `GROUP.VARIANT`.

    The groups of one origin share their draws: all but the first are `paired_with` it, so that variants are compared
    on the same poses.

    Parameters
    ----------
    groups, variants : dict
        By name, as written in the study.
    marks : dict
        Positions in the file; those of a group and of a variant also apply to the groups made of them.
    """
    made: dict[str, Any] = {}
    placed = dict(marks)
    first = next(iter(variants))
    for group, own in groups.items():
        for variant, keys in variants.items():
            name = f"{group}.{variant}"
            paired = {} if variant == first else {"paired_with": f"{group}.{first}"}
            made[name] = deep_merge(deep_merge(own, paired), keys)
            for origin in (("groups", group), ("variants", variant)):
                placed |= {("groups", name, *k[2:]): place for k, place in marks.items() if k[:2] == origin}
    return made, placed


@lru_cache(maxsize=1)
def _presets() -> dict[str, Any]:
    raw, _ = read_yaml(Path(__file__).with_name("presets.yaml"))
    assert isinstance(raw, dict)
    return raw


def preset_names() -> list[str]:
    """The presets that a study may name."""
    return list(_presets())


def preset(name: str) -> dict[str, Any]:
    """The keys of a preset, in the form of a study.

    Raises
    ------
    KeyError
        If there is no preset of this name.
    """
    return dict(_presets()[name])
