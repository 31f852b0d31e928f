"""`roundel card`: a dataset's data card, as a record for programs (card.json) and as a page (card.html)."""

from __future__ import annotations

import json
from importlib import resources
from typing import Any

from roundel.datasets.card.contact_sheet import sheet_of
from roundel.datasets.card.distributions import DEGREES, distributions_of, plot_of
from roundel.datasets.dataset import Dataset
from roundel.datasets.fidelity.summary import fidelity_lines
from roundel.datasets.stream.about import about_dataset
from roundel.scenes.display_text import NAME_LIMIT, TEXT_LIMIT, clean

SCHEMA = 1
RECORD, PAGE = "card.json", "card.html"

_MAX_SHOWN = 12


def card_of(dataset: Dataset, splits: dict[str, int] | None = None) -> dict[str, Any]:
    """The record of a dataset's card.

    Parameters
    ----------
    dataset : Dataset
    splits : dict, optional
        Number of frames of each split, of an export.
    """
    manifest = dataset.manifest
    about = about_dataset(dataset, splits or {"all": len(dataset)})
    kinds: dict[str, int] = {}
    for rows in dataset.truths():
        for kind in rows["kind"].to_pylist() if "kind" in rows.column_names else []:
            kinds[kind] = kinds.get(kind, 0) + 1
    return {
        "schema": SCHEMA,
        "name": manifest["name"],
        "description": about["description"],
        "dataset_id": manifest["dataset_id"],
        "images_sha256": dataset.images.images_sha256,
        "complete": dataset.images.complete,
        "poses": "reference" if dataset.reference else "truth",
        "licence": manifest["licence"],
        "licence_url": about["licence_url"],
        "cite_as": about["cite_as"],
        "counts": {
            "frames": len(dataset),
            "markers": sum(kinds.values()),
            "kinds": dict(sorted(kinds.items())),
            "groups": manifest["counts"]["groups"],
            "flags": manifest["counts"].get("flags", {}),
            "splits": splits or {},
        },
        "cameras": _cameras(dataset),
        "distributions": distributions_of(dataset),
        "fidelity": fidelity_lines(manifest.get("fidelity")),
        "versions": manifest.get("versions", {}),
        "environment": manifest.get("environment", {}),
        "seed": manifest["seed"],
        "reproduce": [
            *([] if dataset.reference else ["roundel render study.yaml DATASET"]),
            f"roundel verify --full DATASET    # dataset_id {manifest['dataset_id'][:12]}",
        ],
        "study": manifest["study"],
    }


def _cameras(dataset: Dataset) -> list[dict[str, Any]]:
    """Distinct image sizes and lens models, with the number of frames of each, the most frequent first."""
    counts: dict[tuple[int, int, str], int] = {}
    for record in dataset.images.records:
        model = str(record.get("distortion_model", "opencv")) if record.get("distortion") else "none"
        key = int(record["width_px"]), int(record["height_px"]), model
        counts[key] = counts.get(key, 0) + 1
    ordered = sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    return [{"width_px": w, "height_px": h, "distortion_model": m, "frames": n} for (w, h, m), n in ordered]


def card_json(card: dict[str, Any]) -> bytes:
    """The record as a file."""
    return (json.dumps(card, indent=1, sort_keys=True, allow_nan=False) + "\n").encode()


def card_page(card: dict[str, Any], dataset: Dataset) -> bytes:
    """The card as a page of its own: no script, nothing from a network.

    Parameters
    ----------
    card : dict
        From `card_of`.
    dataset : Dataset
        For its pictures.
    """
    from jinja2 import Environment, StrictUndefined
    from markupsafe import Markup

    room = resources.files("roundel.datasets.card")
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters["name"] = lambda text: clean(str(text), NAME_LIMIT)
    environment.filters["text"] = lambda text: clean(str(text), TEXT_LIMIT)
    titles = {degree.name: degree.title for degree in DEGREES}
    counts = card["counts"]
    page = environment.from_string((room / "card.html.j2").read_text(encoding="utf-8")).render(
        css=Markup((room / "card.css").read_text(encoding="utf-8")),
        card=card,
        groups=list(counts["groups"].items())[:_MAX_SHOWN],
        more_groups=max(0, len(counts["groups"]) - _MAX_SHOWN),
        cameras=card["cameras"][:_MAX_SHOWN],
        plots=[
            {"title": titles[name], "svg": Markup(plot_of(record)), **record}
            for name, record in card["distributions"].items()
            if len(record["counts"]) > 1
        ],
        same=[
            f"{titles[name]} {record['mean']:.4g}"
            for name, record in card["distributions"].items()
            if len(record["counts"]) == 1
        ],
        pictures=sheet_of(dataset),
    )
    return (page.strip() + "\n").encode()
