"""Depth and coverage of a frame's markers: from its radiance, or from masks/ where the radiance is not kept.

Both tell the truth of a frame: no solver may read them.
"""

from __future__ import annotations

from functools import lru_cache

from roundel.datasets.layout import files
from roundel.datasets.layout.contents import Contents, Part
from roundel.datasets.layout.manifest import read_manifest
from roundel.datasets.layout.radiance import Planes, decode_planes, decode_radiance
from roundel.datasets.store.store import Store

# Key of an environment. Before version 2, Z was the mean over a pixel's rays: along an edge no surface's depth.
RENDERING_VERSION = "rendering_version"
_DEPTH_OF_SURFACES = 2

_COVERAGE = "coverage."


def only_masks(planes: Planes) -> Planes:
    """Those of a frame's planes that masks/ has: depth, and the coverage of each marker."""
    return {name: plane for name, plane in planes.items() if name == "Z" or name.startswith(_COVERAGE)}


def decode_masks(data: bytes, place: str) -> Planes:
    """Planes of a file of masks/ from its bytes; `place` is its address, for messages.

    Raises
    ------
    DataError
        If it is truncated, or has no depth.
    """
    return decode_planes(data, place, "Z", "depth")


def masks_of(contents: Contents, part: Part, frame_id: int) -> Planes | None:
    """Depth and coverage of a frame, held against the checksum of their file.

    Returns
    -------
    dict or None
        `Z`, metres, see `roundel.datasets.layout.radiance`, and `coverage.<marker_id>`, 0 to 1, each (H, W) float32;
        without `Z` if an older version of Roundel rendered the dataset. None if neither was kept.

    Raises
    ------
    DataError
        If the file is missing or was altered.
    """
    listed = contents.files_of(part)
    for name, decode in ((files.masks_name(frame_id), decode_masks), (files.radiance_name(frame_id), decode_radiance)):
        if name in listed:
            place = contents.folder.place(part.shard.name(name))
            planes = only_masks(decode(contents.read(part, name), place))
            if not _has_depth_of_surfaces(contents.folder, contents.images_sha256):
                del planes["Z"]
            return planes
    return None


@lru_cache(maxsize=4)
def _has_depth_of_surfaces(folder: Store, images_sha256: str) -> bool:
    """Whether all frames have the depth of one surface in each pixel; the checksum tells datasets in a folder apart."""
    _, manifest = read_manifest(folder)
    made = [known.environment for known in (manifest.environments or {}).values()] or [manifest.environment]
    return all(environment.get(RENDERING_VERSION, 1) >= _DEPTH_OF_SURFACES for environment in made)
