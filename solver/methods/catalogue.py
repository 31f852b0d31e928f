"""The methods that come with Roundel beside its own fits: their markers, what they return, and their papers."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Listed:
    """A method of the catalogue.

    Attributes
    ----------
    name, at : str
        Its name, and its callable as `module:function`.
    markers : tuple of str
        The kinds of marker that it reads, as in a study.
    about, returns, paper : str
        What it is, what it returns, and its source.
    """

    name: str
    at: str
    markers: tuple[str, ...]
    about: str
    returns: str
    paper: str = ""


def _related(name: str, markers: str, about: str, returns: str, paper: str) -> Listed:
    return Listed(name, f"roundel.solver.related.{name}:find", tuple(markers.split()), about, returns, paper)


CATALOGUE: tuple[Listed, ...] = (
    Listed(
        "blobs",
        "roundel.solver.related.opencv_centres:blobs",
        ("disc",),
        "dark blobs by cv2.SimpleBlobDetector",
        "centres",
    ),
    Listed(
        "circles_grid",
        "roundel.solver.related.opencv_centres:circles_grid",
        ("circle_grid",),
        "a grid of dots by cv2.findCirclesGrid",
        "centres",
    ),
)


def listed(name: str) -> Listed | None:
    """The entry of a name; None if it is not in the catalogue."""
    return next((entry for entry in CATALOGUE if entry.name == name), None)
