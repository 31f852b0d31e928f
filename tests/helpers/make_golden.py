"""Regenerate tests/golden: only if SAMPLING_VERSION was raised, or for a new study or a new key with its default."""

import json

from helpers_golden import GOLDEN, STUDIES, record_of, schema_defaults


def main() -> None:
    GOLDEN.mkdir(exist_ok=True)
    for old in GOLDEN.glob("*.json"):
        old.unlink()
    records = {name: record_of(name) for name in STUDIES} | {"_defaults": schema_defaults()}
    for name, record in records.items():
        (GOLDEN / f"{name}.json").write_text(json.dumps(record, indent=1, sort_keys=True) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
