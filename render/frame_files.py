"""Files of a frame on disk, and its journal line."""

from __future__ import annotations

from typing import Any

from roundel.datasets.flags import frame_flags
from roundel.datasets.layout import files, journal
from roundel.datasets.layout.radiance import Planes, coverage_channel
from roundel.datasets.store.store import Store
from roundel.datasets.store.writing import sha256
from roundel.render.sensor.develop import Developed
from roundel.render.sensor.encode import jpeg_bytes, png_bytes
from roundel.scenes.study.identity import frame_digest
from roundel.scenes.truth.truth import truth_of
from roundel.scenes.world.frame import Frame


def image_file(frame: Frame, developed: Developed) -> dict[str, bytes]:
    """The image as {name: bytes}."""
    sensor = frame.settings.sensor
    if sensor.jpeg_quality is None:
        data = png_bytes(developed.image, sensor.bits)
    else:
        data = jpeg_bytes(developed.image, sensor.jpeg_quality)
    return {files.image_name(frame.frame_id, sensor.image_suffix): data}


def write_frame(folder: Store, written: dict[str, bytes]) -> dict[str, dict[str, Any]]:
    """Write the files of a frame into the folder of its shard; return their entries for the journal."""
    for name, data in written.items():
        folder.write(name, data)
    return {name: {"sha256": sha256(data), "bytes": len(data)} for name, data in written.items()}


def entry_of(
    frame: Frame,
    developed: Developed,
    planes: Planes,
    fidelity: dict[str, Any],
    listed: dict[str, dict[str, Any]],
    backend: str,
) -> journal.Entry:
    """The frame's journal line: checksums of files and numbers, backend, sensor, exposure, flags, photometry, fidelity.

    Parameters
    ----------
    frame : Frame
    developed : Developed
    planes : dict
        At least the coverage of each circle.
    fidelity : dict
        Fidelity of each circle, measured when the frame was rendered.
    listed : dict
        Result of `write_frame`.
    backend : str
        Backend of the renderer.
    """
    return {
        "frame_id": frame.frame_id,
        "group": frame.group,
        "numbers_sha256": frame_digest(frame),
        "backend": backend,
        "files": listed,
        "exposure_e": developed.exposure_e,
        "saturated_fraction": developed.saturated_fraction,
        "sensor": developed.record(),
        "flags": frame_flags(developed.flags, (row["visible_fraction"] for row in truth_of(frame))),
        "photometry": {
            str(part.marker_id): developed.edge(planes[coverage_channel(part.marker_id)])
            for view in frame.views()
            for part in view.sheet.parts
            if part.radius_m is not None and part.inked
        },
        "fidelity": fidelity,
    }
