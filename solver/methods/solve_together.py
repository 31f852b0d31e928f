"""Estimates of the circles of an image after `coplanar`: one plane for all, one candidate chosen, a focal length."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.geometry.conic import other_candidate
from roundel.solver.ambiguity.coplanar import CoplanarCircles, CoplanarPoses, solve_together
from roundel.solver.ambiguity.disambiguation import Knowledge, pieces_of
from roundel.solver.estimates import Estimate
from roundel.solver.fit.ellipse import EllipseFit, FailedFit
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera

Array = NDArray[np.float64]

_ELSEWHERE = "not in the plane of the other circles: solved alone"


def with_one_plane(
    estimates: Sequence[Estimate],
    fits: Sequence[EllipseFit | FailedFit],
    knowledge: Knowledge,
    given: UncertainCamera,
    radius_m: float,
) -> list[Estimate]:
    """The estimates of one image, solved together if they are known to be coplanar; else as they are.

    Circles that do not fit into the plane keep their own poses and say so. If no plane is found, all do.

    Parameters
    ----------
    estimates : sequence of Estimate
        Of one method and camera, one for each fit.
    fits : sequence of EllipseFit or FailedFit
    knowledge : str, Evidence, a sequence of them, or None
    given : UncertainCamera
    radius_m : float
    """
    if not any(isinstance(piece, CoplanarCircles) for piece in pieces_of(knowledge)):
        return list(estimates)
    usable = [i for i, (e, fit) in enumerate(zip(estimates, fits, strict=True)) if _usable(e, fit)]
    if len(usable) < 2:
        return list(estimates)
    mine = [estimates[i] for i in usable]
    shapes = [fit for i in usable if isinstance(fit := fits[i], EllipseFit)]
    found = solve_together(
        np.array([fit.ellipse for fit in shapes]),
        np.array([fit.shape_cov for fit in shapes]),
        np.array([e.normal for e in mine]),
        np.array([e.centre_m for e in mine]),
        np.array([e.cov for e in mine]),
        given,
        radius_m,
    )
    out = list(estimates)
    if isinstance(found, FailedFit):
        for i in usable:
            out[i] = replace(out[i], caveats=(*out[i].caveats, f"{found.reason}: solved alone"))
        return out
    place = 0
    for i, member in zip(usable, found.members, strict=True):
        if member:
            out[i] = _member(out[i], found, place, given, radius_m)
            place += 1
        else:
            out[i] = replace(out[i], caveats=(*out[i].caveats, _ELSEWHERE))
    return out


def _usable(estimate: Estimate, fit: EllipseFit | FailedFit) -> bool:
    return bool(estimate) and isinstance(fit, EllipseFit) and estimate.cov is not None and estimate.normal is not None


def _member(estimate: Estimate, found: CoplanarPoses, place: int, given: UncertainCamera, radius_m: float) -> Estimate:
    """The estimate with the plane's normal as one candidate, and its mirror image as the other."""
    centre = found.centre_m[place]
    mirrored, beside = other_candidate(found.normal, centre, radius_m)
    normals, centres = np.stack([found.normal, mirrored]), np.stack([centre, beside])
    # In the order of the conventions: closer to fronto-parallel first; at a tie, the larger normal_x.
    first, second = sorted((0, 1), key=lambda k: (normals[k, 2], -normals[k, 0]))
    chosen = 0 if first == 0 else 1
    assert estimate.cov is not None
    cov = estimate.cov.copy()
    cov[chosen] = found.cov[place]
    sure = 0.5 * (1.0 + math.tanh(0.5 * found.log_odds))
    measured = math.isfinite(found.focal_sigma_px)
    return replace(
        estimate,
        camera=found.camera,
        normal=normals[[first, second]],
        centre_m=centres[[first, second]],
        cov=cov,
        probability=(sure, 1.0 - sure) if chosen == 0 else (1.0 - sure, sure),
        chosen=chosen,
        choice_basis=f"{len(found.centre_m)} circles in one plane",
        focal_px=found.focal_px if measured else None,
        focal_sigma_px=found.focal_sigma_px if measured else None,
    )
