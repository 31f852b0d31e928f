"""Golden record of a shipped study as plain values: its id, frame counts, and the values of some of its frames."""

from pathlib import Path
from typing import Any

from pydantic import BaseModel

from roundel.scenes.study.identity import SAMPLING_VERSION, frame_numbers
from roundel.scenes.study.schema import GroupSection
from roundel.scenes.study.study import load_study
from roundel.scenes.world.frame import frame_of, group_ranges

HOUSE = Path(__file__).resolve().parents[2]
GOLDEN = HOUSE / "tests" / "golden"
STUDIES = sorted(path.stem for path in (HOUSE / "configs").glob("*.yaml"))


# A study with more groups has its first frame of each recorded: two hundred numbers are enough to see a change.
_MANY_GROUPS = 40


def _chosen(ids: range, groups: int) -> list[int]:
    """Frames of a group to record: both ends, both sides of a block boundary of the sequence, and some between."""
    count = len(ids)
    places = {0, 1, 2, count // 3, count // 2, 255, 256, count - 1} if groups <= _MANY_GROUPS else {0}
    return [ids[i] for i in sorted(places) if 0 <= i < count]


def record_of(name: str) -> dict[str, Any]:
    """The golden record of a shipped study."""
    study = load_study(HOUSE / "configs" / f"{name}.yaml")
    ranges = group_ranges(study)
    return {
        "sampling_version": SAMPLING_VERSION,
        "dataset_id": study.digest(),
        "groups": {group: [ids.start, ids.stop] for group, ids in ranges.items()},
        "frames": {
            str(i): frame_numbers(frame_of(study, i)) for ids in ranges.values() for i in _chosen(ids, len(ranges))
        },
    }


def schema_defaults(model: type[BaseModel] = GroupSection) -> dict[str, Any]:
    """Default of every key of every section below a group, by Section.key: changing one changes the frames."""
    seen: dict[str, Any] = {}

    def models_in(annotation: Any) -> list[type[BaseModel]]:
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            return [annotation]
        return [m for inner in getattr(annotation, "__args__", ()) for m in models_in(inner)]

    def walk(section: type[BaseModel]) -> None:
        for key, field in section.model_fields.items():
            where = f"{section.__name__}.{key}"
            if where in seen:
                continue
            if field.is_required():
                seen[where] = "required"
            else:
                default = field.get_default(call_default_factory=True)
                seen[where] = default.model_dump(mode="json") if isinstance(default, BaseModel) else default
            for inner in models_in(field.annotation):
                walk(inner)

    walk(model)
    return seen
