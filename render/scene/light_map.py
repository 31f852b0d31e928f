"""Environment maps: an OpenEXR or Radiance HDR file to a Mitsuba emitter, decoded once."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.render.assets.decoding import two_threads
from roundel.scenes.errors import DataError
from roundel.scenes.world.frame import Frame
from roundel.scenes.world.lamps import LUMINANCE, camera_from_level


def map_emitter(mi: Any, frame: Frame) -> Any:
    """The emitter of a frame's map, rotated and scaled for the frame; `Emitter` of the current variant.

    Mitsuba's map has its middle at +z and up at +y; half a turn about +z moves up to -y and keeps the middle.

    Raises
    ------
    DataError
        If the file is missing, changed or truncated, or does not hold valid radiance.
    """
    import drjit as dr

    section = frame.settings.light.map
    assert section is not None
    assert section.sha256 is not None  # the study fills it in when it is read
    emitter = _emitter(mi.variant(), str(frame.folder / section.file), section.sha256)
    turned = mi.ScalarTransform4f(camera_from_level(frame)) @ mi.ScalarTransform4f().rotate([0, 1, 0], section.turn_deg)
    parameters = mi.traverse(emitter)
    placed = mi.AffineTransform4f(turned @ mi.ScalarTransform4f().rotate([0, 0, 1], 180))
    # Opaque to the tracer, so that frames share one kernel.
    dr.make_opaque(placed)
    parameters["scale"], parameters["to_world"] = dr.opaque(mi.Float, section.scale), placed
    parameters.update()
    return emitter


@lru_cache(maxsize=1)
def _emitter(variant: str, path: str, sha256: str) -> Any:
    """Cache of one emitter: building its sampling tables takes longer than rendering a small frame."""
    import mitsuba as mi

    pixels = read_map(path, sha256)
    if mi.Spectrum(0.0).shape[0] == 1:
        pixels = (pixels @ np.array(LUMINANCE, dtype=np.float32))[..., None]
    return mi.load_dict({"type": "envmap", "bitmap": mi.Bitmap(np.ascontiguousarray(pixels)), "sampling_weight": 1.0})


def read_map(path: str | Path, sha256: str) -> NDArray[np.float32]:
    """Linear red, green and blue (H, W, 3) of a map.

    Parameters
    ----------
    path : path
    sha256 : str
        Checksum of the file recorded by the study.

    Raises
    ------
    DataError
        If the file is missing, changed or truncated, or does not hold valid radiance.
    """
    import mitsuba as mi

    path = Path(path)
    if not path.is_file():
        raise DataError(f"{path}: this environment map is missing; put it beside the study")
    try:
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        if digest != sha256:
            raise DataError(f"{path}: is not the map recorded by the study (sha256 {digest[:12]}, not {sha256[:12]})")
        with two_threads():
            bitmap: Any = mi.Bitmap(str(path))
        names = [field.name for field in bitmap.struct_()]
        pixels = np.array(bitmap, dtype=np.float32).reshape(bitmap.height(), bitmap.width(), -1)
    except (OSError, RuntimeError, MemoryError) as error:
        raise DataError(f"{path}: this environment map is truncated or corrupt; get the file again") from error
    if all(name in names for name in "RGB"):
        pixels = pixels[..., [names.index(name) for name in "RGB"]]
    elif "Y" in names:
        pixels = np.repeat(pixels[..., [names.index("Y")]], 3, axis=-1)
    else:
        raise DataError(f"{path}: an environment map needs the channels R, G, B, or Y; it has {', '.join(names)}")
    if not np.isfinite(pixels).all():
        raise DataError(f"{path}: this environment map holds NaN or infinity; repair it")
    if pixels.min() < 0:
        raise DataError(f"{path}: this environment map holds negative light; clip it at 0")
    if pixels.max() <= 0:
        raise DataError(f"{path}: this environment map is black; use another one")
    return pixels
