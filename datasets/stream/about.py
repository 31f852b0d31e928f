"""Facts of a dataset that exports and cards state: name, licence, how it was made, how to cite and to reproduce it."""

from __future__ import annotations

from typing import Any

from roundel.datasets.dataset import Dataset

_LICENCES = {"CC0-1.0": "https://creativecommons.org/publicdomain/zero/1.0/"}


def licence_url(spdx: str) -> str:
    """The address of a licence's text."""
    return _LICENCES.get(spdx, f"https://spdx.org/licenses/{spdx}.html")


def about_dataset(dataset: Dataset, counts: dict[str, int], url: str = "") -> dict[str, Any]:
    """Facts of a dataset, as texts.

    Parameters
    ----------
    dataset : Dataset
    counts : dict
        Number of frames of each split.
    url : str
        Where it is published; default: its identity as a URN.
    """
    manifest = dataset.manifest
    version = manifest.get("versions", {}).get("roundel", "")
    frames = sum(counts.values())
    if manifest.get("reference"):
        made = "imported"
        description = (
            f"{frames} photographs of a circular marker. Its poses are no truth: they are measured from the board "
            f"beside it in each photograph, and imported by Roundel {version}."
        )
    else:
        made = "rendered"
        description = (
            f"{frames} ray-traced images of circular markers with the exact truth of each pose, rendered by Roundel "
            f"{version} from the study {manifest['name']!r}."
        )
    cite = f"Dataset {manifest['name']}, {made} by Roundel {version}, dataset_id {manifest['dataset_id'][:12]}."
    return {
        "name": manifest["name"],
        "licence": manifest["licence"],
        "licence_url": licence_url(manifest["licence"]),
        "dataset_id": manifest["dataset_id"],
        "description": description,
        "cite_as": cite,
        "url": url or f"urn:sha256:{manifest['dataset_id']}",
        "card": f"# {manifest['name']}\n\n{description}\n\nCite as: {cite}\n",
    }
