"""All methods by name: Roundel's own, files (see `method_file`), and plug-ins from the entry points `roundel.methods`.

A package adds a method by an entry point, which is imported when the method is first requested by name:

    [project.entry-points."roundel.methods"]
    mine = "my_package.my_module:find"
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import EntryPoint, entry_points
from typing import Any

import numpy as np

from roundel.scenes.errors import UsageError, did_you_mean
from roundel.scenes.geometry.conic import Ellipse
from roundel.solver.ambiguity.disambiguation import Knowledge
from roundel.solver.catalogue import CATALOGUE, listed
from roundel.solver.estimates import NOT_FOUND, Estimate, EstimateKey
from roundel.solver.fit.ellipse import EllipseFit
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera
from roundel.solver.methods.fit_poses import poses_of_fits
from roundel.solver.methods.method_file import MethodFile
from roundel.solver.methods.plugin import Checked, Finder, MethodFailure, View, check_found
from roundel.solver.methods.pose_estimate import estimate_of
from roundel.solver.methods.roundel_fits import METHODS

GROUP = "roundel.methods"
NOTHING = "nothing found"


@dataclass(frozen=True)
class Method:
    """A method: its name, its source, what it does, how to load it (None: one of Roundel's fits), and its markers."""

    name: str
    source: str
    about: str
    entry: EntryPoint | None = None
    markers: tuple[str, ...] = ("circles",)
    returns: str = "both poses"
    paper: str = ""


def installed_methods() -> list[Method]:
    """All methods, Roundel's first, including duplicates from several packages; imports none."""
    ours = [Method(name, "roundel", about) for name, about in METHODS.items()]
    ours += [
        Method(m.name, "roundel", m.about, EntryPoint(m.name, m.at, GROUP), m.markers, m.returns, m.paper)
        for m in CATALOGUE
    ]
    theirs = []
    for entry in sorted(entry_points(group=GROUP), key=lambda e: (e.name, e.value)):
        source = f"{entry.dist.name} {entry.dist.version}" if entry.dist else "a package without a name"
        about = (entry.dist.metadata.json.get("summary") if entry.dist else None) or entry.value
        theirs.append(Method(entry.name, source, " ".join(str(about).split()), entry, (), ""))
    return ours + theirs


def method_lines() -> list[str]:
    """Lines per method: name, source, description; then its markers, what it returns, and its paper."""
    methods = installed_methods()
    widths = [max(len(getattr(m, part)) for m in methods) for part in ("name", "source")]
    lines = []
    for m in methods:
        lines.append(f"{m.name:<{widths[0]}}  {m.source:<{widths[1]}}  {m.about}")
        if m.markers:
            more = [f"reads {', '.join(m.markers)}; returns {m.returns}", *filter(None, [m.paper])]
            lines += [f"{'':<{sum(widths) + 4}}{text}" for text in more]
    return lines


def load_methods(methods: Sequence[str]) -> dict[str, Finder | None]:
    """The callable of each method by its name, None for Roundel's own; without duplicates, in the given order.

    Raises
    ------
    UsageError
        If no method is given, or one is unknown, ambiguous, or cannot be imported, or two have the same name.
    """
    if not methods:
        raise UsageError(f"no method given; use {', '.join(_names())}")
    given: dict[str, str] = {}
    for text in absolute_names(methods):
        file = MethodFile.of(text)
        name = file.name if file else text
        other = given.setdefault(name, text)
        if other != text or (file and any(m.name == name for m in installed_methods())):
            what = f"{other} is, too" if other != text else "that is an installed method"
            raise UsageError(f"method {text}: would be called {name!r}, and {what}; rename the function or the file")
    return {name: finder_of(text) for name, text in given.items()}


def absolute_names(methods: Sequence[str]) -> list[str]:
    """Methods as other processes understand them, whatever their folder: files have whole paths."""
    return [str(MethodFile.of(text) or text) for text in methods]


def finder_of(name: str) -> Finder | None:
    """The callable of a method; None if it is one of Roundel's fits.

    Raises
    ------
    UsageError
        If there is no such method, or more than one, or it cannot be imported.
    """
    if name in METHODS:
        return None
    file = MethodFile.of(name)
    if file:
        return file.load()
    # A package cannot override a name of Roundel.
    offered = [m for m in installed_methods() if m.name == name and (listed(name) is None or m.source == "roundel")]
    if not offered:
        hint = did_you_mean(name, _names()) or f"use {', '.join(_names())}"
        raise UsageError(f"unknown method {name!r}; {hint}")
    if len(offered) > 1:
        sources = " and ".join(m.source for m in offered)
        raise UsageError(f"method {name!r}: offered by {sources}; uninstall all but one of them")
    method = offered[0]
    assert method.entry is not None
    try:
        finder = method.entry.load()
    except (Exception, SystemExit) as error:
        raise UsageError(
            f"method {name!r} of {method.source} cannot be imported from {method.entry.value}: {_said(error)}"
        ) from error
    if not callable(finder):
        raise UsageError(f"method {name!r} of {method.source}: {method.entry.value} is not callable")
    return finder  # type: ignore[no-any-return]


def _names() -> list[str]:
    return list(dict.fromkeys(m.name for m in installed_methods()))


def run_plugin(
    name: str, finder: Finder, view: View, uncertain: UncertainCamera, knowledge: Knowledge, frame_id: int, label: str
) -> list[Estimate]:
    """Run a method on a view; returns records, and failed records with the reason for any error.

    Parameters
    ----------
    name, finder
        The method.
    view : View
    uncertain : UncertainCamera
        The view's camera; its standard deviations enter the covariance of poses computed from an ellipse.
    knowledge : str, Evidence, a sequence of them, or None
        See `choose`; it decides between poses computed from an ellipse.
    frame_id : int
    label : str
        Label of the intrinsics.
    """

    def failed(detection_id: int, reason: str) -> Estimate:
        return Estimate(frame_id, detection_id, name, label, "failed", f"{name}: {reason}", camera=uncertain.camera)

    try:
        answer: object = finder(view)
        found = list(answer) if isinstance(answer, Iterable) and not isinstance(answer, str | bytes) else None
    except (Exception, SystemExit) as error:  # third-party code: a failure affects only this frame
        return [failed(NOT_FOUND, _said(error, typed=not isinstance(error, MethodFailure)))]
    if found is None:
        return [failed(NOT_FOUND, f"it returned {type(answer).__name__}, not a list of Found")]
    if not found:
        return [failed(NOT_FOUND, NOTHING)]
    out = []
    for n, one in enumerate(found):
        try:
            checked = check_found(one, view)
        except MethodFailure as error:
            out.append(failed(n, _said(error, typed=False)))
            continue
        except ValueError as error:
            out.append(failed(n, f"detection {n}: {_said(error, typed=False)}"))
            continue
        out.append(
            plugin_estimate(checked, uncertain, view.diameter_m, knowledge, EstimateKey(frame_id, n, name, label))
        )
    return out


def plugin_estimate(
    found: Checked, uncertain: UncertainCamera, diameter_m: float, knowledge: Knowledge, key: EstimateKey
) -> Estimate:
    """The record of a detection; of an ellipse without a pose it has both poses."""
    also: dict[str, Any] = {
        "confidence": found.confidence,
        "centre_image": found.centre_px,
        "identity": found.identity,
        "focal_px": found.focal_px,
        "focal_sigma_px": found.focal_sigma_px,
    }
    uncertain = replace(uncertain, camera=found.camera)
    if found.normal is None and found.ellipse is not None:
        # Roundel computes both poses; the method gave no covariance for its ellipse.
        unknown = np.full((5, 5), np.nan)
        fit = EllipseFit(found.ellipse, unknown, float("nan"), 0, unknown, np.empty(0))
        (posed,) = poses_of_fits([fit], uncertain, diameter_m / 2)
        made = estimate_of(fit, posed, uncertain, knowledge, key)
        return replace(made, edge_points=None, edge_sigma_px=None, fit_used=key.method, **also)
    return Estimate(
        *key,
        status="ok",
        ellipse=None if found.ellipse is None else Ellipse.from_array(found.ellipse),
        camera=uncertain.camera,
        normal=found.normal,
        centre_m=found.centre_m,
        chosen=found.chosen if found.normal is not None else 0,
        choice_basis=f"chosen by {key.method}" if found.chosen is not None else "",
        focal_sigma=uncertain.focal_sigma,
        intrinsics_basis=uncertain.basis,
        fit_used=key.method,
        **also,
    )


def _said(error: BaseException, typed: bool = True) -> str:
    line = " ".join(str(error).split())[:300]
    return f"{type(error).__name__}: {line}" if typed and line else line or type(error).__name__
