"""`coplanar`: the circles of an image lie in one plane and have one size, and are solved together.

One circle has two poses. Of several circles of one plane the true normals agree, and the others do not; and only the
true focal length makes them agree, so that the focal length is measured, too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.focal_fusion import fused_focal_px, with_focal
from roundel.scenes.camera.model import Camera
from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic
from roundel.scenes.geometry.pose import camera_from_marker_of
from roundel.solver.ambiguity.observation import Observation, Verdict
from roundel.solver.fit.ellipse import FailedFit, shape_of_ellipse
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera
from roundel.solver.pose.coplanar_circles import CoplanarFit, fit_coplanar

Array = NDArray[np.float64]

# Squared distance, in sigmas, up to which a circle is taken into the plane of another one: the covariances of single
# circles are of first order, and what is left in by mistake raises chi2.
_CONSISTENT = 25.0
# Reduced chi-square beyond which the plane is refused: ten times the stated noise.
_WORST = 100.0
_SAME_PLANE = 1e-4  # of two normals, in radians: fits end within 1e-9 of their minimum
_STEP = 1e-6  # of numerical derivatives: the root of the rounding is 1e-8


@dataclass(frozen=True)
class CoplanarCircles:
    """Knowledge that all circles of an image lie in one plane and have one size."""

    def verdict(self, observation: Observation) -> Verdict:
        """No odds: a circle alone lies in some plane, whichever candidate is true."""
        return Verdict(0.0, "there is no other circle to be in one plane with")

    def problem(self) -> str:
        """Nothing can be wrong with it."""
        return ""


@dataclass(frozen=True, eq=False)
class CoplanarPoses:
    """Circles of one plane, solved together.

    Attributes
    ----------
    members : (n,) bool array
        Which circles are in the plane; the rest below is of the m members.
    normal : (3,) array
    centre_m : (m, 3) array
    cov : (m, 6, 6) array
        Covariance of (centre, normal), as in `Estimate`.
    camera : Camera
        With the focal length that the prior and the circles agree on.
    focal_px, focal_sigma_px : float
        Of the circles alone; infinite sigma if they do not tell, or the camera is exact.
    log_odds : float
        Against the plane of the other candidates.
    misfit : float
        Reduced chi-square; the covariance includes it where it is above 1.
    """

    members: NDArray[np.bool_]
    normal: Array
    centre_m: Array
    cov: Array
    camera: Camera
    focal_px: float
    focal_sigma_px: float
    log_odds: float
    misfit: float


def solve_together(
    ellipses: Array,
    shape_covs: Array,
    normal: Array,
    centre_m: Array,
    cov: Array,
    given: UncertainCamera,
    radius_m: float,
) -> CoplanarPoses | FailedFit:
    """One plane for circles of one size.

    Parameters
    ----------
    ellipses : (n, 5) array
    shape_covs : (n, 5, 5) array
    normal, centre_m : (n, 2, 3) array
        Both candidates of each circle.
    cov : (n, 2, 6, 6) array
        Their covariances.
    given : UncertainCamera
    radius_m : float

    Returns
    -------
    CoplanarPoses or FailedFit
        FailedFit if no two circles are in one plane.
    """
    members, picked = _largest_plane(normal, centre_m, cov)
    if np.count_nonzero(members) < 2:
        return FailedFit("no two circles lie in one plane")
    e, covs = ellipses[members], shape_covs[members]
    which = picked[members]
    rows = np.arange(len(which))
    both = (normal[members][rows, which], normal[members][rows, 1 - which])
    starts = [_unit(n.mean(axis=0)) for n in both]
    fits = [_fit(e, covs, start, given) for start in starts]
    ranked = sorted((fit for fit in fits if not isinstance(fit, FailedFit)), key=lambda fit: fit[1])
    if not ranked:
        first = fits[0]
        assert isinstance(first, FailedFit)
        return first
    best, cost = ranked[0]
    misfit = best.chi2 / max(best.freedom, 1)
    if misfit > _WORST:
        return FailedFit(
            f"the circles do not lie in one plane, or are not of one size: their ellipses differ from it by "
            f"{math.sqrt(misfit):.0f} times their noise"
        )
    scale = max(misfit, 1.0)
    # Both starts may lead to one plane: then there is no other.
    others = [other for fit, other in ranked[1:] if np.linalg.norm(fit.normal - best.normal) > _SAME_PLANE]
    log_odds = (others[0] - cost) / (2 * scale) if others else math.inf
    focal_sigma = best.focal_sigma * math.sqrt(scale)
    prior_px = float(given.camera.K[0, 0])
    focal_px, left = fused_focal_px(prior_px, given.focal_sigma, best.focal_px, best.focal_px * focal_sigma)
    camera = with_focal(given.camera, focal_px)
    if given.focal_sigma > 0:
        final = fit_coplanar(e, covs, camera.K, best.normal, relative_radii=np.ones(len(e)), focal_known=True)
        if isinstance(final, FailedFit):
            return final
        best = final
    centre = best.centre * (radius_m / best.radius)[:, None]
    known = replace(given, camera=camera, focal_sigma=left)
    pose_cov = _covariance(best.normal, centre, covs * scale, known, radius_m)
    measured = given.focal_sigma > 0 and math.isfinite(focal_sigma)
    return CoplanarPoses(
        members,
        best.normal,
        centre,
        pose_cov,
        camera,
        ranked[0][0].focal_px if measured else math.nan,
        ranked[0][0].focal_px * focal_sigma if measured else math.inf,
        log_odds,
        misfit,
    )


def _fit(e: Array, covs: Array, start: Array, given: UncertainCamera) -> tuple[CoplanarFit, float] | FailedFit:
    """The plane from a start, and its chi2 with that of the prior of the focal length."""
    exact = given.focal_sigma <= 0
    fit = fit_coplanar(e, covs, given.camera.K, start, relative_radii=np.ones(len(e)), focal_known=exact)
    if isinstance(fit, FailedFit) or exact:
        return fit if isinstance(fit, FailedFit) else (fit, fit.chi2)
    variance = given.focal_sigma**2 + fit.focal_sigma**2
    return fit, fit.chi2 + math.log(fit.focal_px / given.camera.K[0, 0]) ** 2 / variance


def _largest_plane(normal: Array, centre_m: Array, cov: Array) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """The most circles that have candidates in one plane, and those candidates.

    The plane of each candidate is tried: circle j is in that of candidate i if one of its candidates has the same
    normal, and the same distance along it, within the standard deviations of both.
    """
    n = len(normal)
    flat, spots = normal.reshape(-1, 3), centre_m.reshape(-1, 3)
    turn = np.trace(cov[..., 3:, 3:], axis1=-2, axis2=-1).ravel()
    best, least = None, (-1, math.inf)
    for i, (axis, spot) in enumerate(zip(flat, spots, strict=True)):
        angle2 = np.sum((flat - axis) ** 2, axis=-1)
        apart = spots - spot
        along = np.einsum("i,njkil,l->njk", axis, cov[..., None, :3, :3], axis).ravel()
        lever2 = np.sum(apart**2, axis=-1)
        spread = along + along[i] + lever2 * (turn + turn[i])
        distance = (angle2 / (turn + turn[i]) + (apart @ axis) ** 2 / spread).reshape(n, 2)
        picked = np.argmin(distance, axis=1)
        nearest = distance[np.arange(n), picked]
        members = nearest < _CONSISTENT
        rank = (int(np.count_nonzero(members)), -float(np.sum(nearest[members])))
        if rank > (least[0], -least[1]):
            best, least = (members, picked), (rank[0], -rank[1])
    assert best is not None
    return best


def _covariance(normal: Array, centre_m: Array, covs: Array, given: UncertainCamera, radius_m: float) -> Array:
    """Covariance (m, 6, 6) of (centre, normal): the inverse of the information of all ellipses, to first order.

    The unknowns that the circles share are two turns of the plane about the middle of the centres, its distance, log f
    and the principal point, with their priors; each circle has two of its own, its place in the plane, which are
    eliminated (Schur).
    """
    middle = centre_m.mean(axis=0)
    basis = np.linalg.svd(normal[None])[2]
    first, second = basis[1], basis[2]
    sized = radius_m if radius_m > 0 else 1.0

    def moved(turns: Array, distance: float, place: Array) -> tuple[Array, Array]:
        w = turns[0] * first + turns[1] * second
        arm = centre_m - middle
        return _unit(normal + np.cross(w, normal)), (
            centre_m + np.cross(w, arm) + sized * (distance * normal + place[0] * first + place[1] * second)
        )

    def shapes(x: Array) -> Array:
        axis, spots = moved(x[:2], x[2], x[6:8])
        k = with_focal(given.camera, given.camera.K[0, 0] * math.exp(x[3])).K.copy()
        k[:2, 2] += x[4:6]
        poses = np.stack([camera_from_marker_of(axis, spot) for spot in spots])
        return shape_of_ellipse(ellipse_of_conic(conic_of_circle(poses, radius_m, k)))

    steps = _STEP * np.eye(8)
    rates = np.stack([(shapes(s) - shapes(-s)) / (2 * _STEP) for s in steps], axis=-1)  # (m, 5, 8)
    weight = np.linalg.inv(covs)
    information = np.swapaxes(rates, -1, -2) @ weight @ rates  # (m, 8, 8)
    shared, cross, own = information[:, :6, :6], information[:, :6, 6:], information[:, 6:, 6:]
    gain = cross @ np.linalg.inv(own)
    total = np.sum(shared - gain @ np.swapaxes(cross, -1, -2), axis=0)
    # What is exact gets no room: its rows are left out.
    sigma = np.array([math.inf] * 3 + [given.focal_sigma] + [given.principal_sigma_px] * 2)
    free = sigma > 0
    prior = np.diag(1.0 / sigma[free] ** 2)
    cov_shared = np.zeros((6, 6))
    cov_shared[np.ix_(free, free)] = np.linalg.inv(total[np.ix_(free, free)] + prior)
    out = np.empty((len(centre_m), 6, 6))
    for i, arm in enumerate(centre_m - middle):
        whole = np.zeros((8, 8))
        whole[:6, :6] = cov_shared
        whole[6:, :6] = -gain[i].T @ cov_shared
        whole[:6, 6:] = whole[6:, :6].T
        whole[6:, 6:] = np.linalg.inv(own[i]) + gain[i].T @ cov_shared @ gain[i]
        map_ = np.zeros((6, 8))
        for j, w in enumerate((first, second)):
            map_[:3, j], map_[3:, j] = np.cross(w, arm), np.cross(w, normal)
        map_[:3, 2], map_[:3, 6], map_[:3, 7] = sized * normal, sized * first, sized * second
        out[i] = map_ @ whole @ map_.T
    return out


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector))
