"""Coded crowns (CCTag): identity, image of the centre, unique pose and focal length from one marker.

Source: L. Calvet, P. Gurdjos, C. Griwodz, S. Gasparini, Detection and accurate localization of circular fiducials under
highly challenging conditions, CVPR (2016). The steps are theirs: an outer ellipse; the image of the centre as the point
for which the image, rectified by the homography of ellipse and centre, looks alike along all cuts from the centre to
the rim; the identity as the nearest profile of a bank. From ellipse C and centre o follow the vanishing line v ~ C o,
the normal K^T v, and the focal length by the circular points, where v meets C (`views.dual_circular_points`).

Three things are ours. The outer ellipses come from Roundel's detector, or else from outlines of ink, instead of voting
along gradients. The cuts are made to agree by Gauss-Newton from the best of a coarse grid, where the paper shrinks a
grid. Once the identity is known, homography, blur and levels are fitted to all pixels of the print together, which
gives a covariance: poses and focal length are those of least squares with it (`homography_pose`). Bank and print are
`scenes.markers.ring_codes`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.geometry.conic import conic_of_ellipse
from roundel.scenes.markers.ring_codes import CELLS, ring_code_radii, ring_code_words
from roundel.solver.methods.plugin import Found, MethodFailure, View
from roundel.solver.views.circles_of_view import circles_of_view, require_kind
from roundel.solver.views.disc_coverage import coverage_of
from roundel.solver.views.disc_pattern import PatternFit, Pixels, fit_pattern, unexplained
from roundel.solver.views.homography_pose import homography_of
from roundel.solver.views.ink_blobs import ink_outlines
from roundel.solver.views.marker_pixels import LightImage, found_of, light_image, pixels_inside

Array = NDArray[np.float64]

KINDS = ("ring_code",)

_CUTS, _STEPS = 48, 24
_GRID = np.array([-0.12, -0.06, 0.0, 0.06, 0.12])  # centres tried, in semi-axes about that of the ellipse
_ROUNDS = 12
_REACH = 1.12  # of the pixels that are compared, in outer radii
_LEAST_CONFIDENCE = 0.2
_OUTLINES = 12
_DECISIVE = 20.0  # log-likelihood by which the best word must beat every other


@dataclass(frozen=True, eq=False)
class RingReading:
    """One marker as read: its identity, and the fit of its print."""

    identity: int
    fit: PatternFit


def centre_by_cuts(image: LightImage, conic: Array) -> Array | None:
    """Image of the centre, (2,): where rectified cuts from the centre to the rim agree best; None if they never do."""
    turn = np.arange(_CUTS) * (2 * np.pi / _CUTS)
    radius = (np.arange(_STEPS) + 0.5) / _STEPS
    plane = np.stack(
        [np.outer(radius, np.cos(turn)), np.outer(radius, np.sin(turn)), np.ones((_STEPS, _CUTS))], axis=-1
    )
    middle = homography_of(conic, _middle(conic))

    def disagreement(w: Array) -> Array:
        point = middle @ np.array([w[0], w[1], 1.0])
        px = plane @ homography_of(conic, point[:2] / point[2]).T
        levels = image.at(px[..., :2] / px[..., 2:])
        return np.asarray(levels - levels.mean(axis=1, keepdims=True)).ravel()

    tried = [(x, y) for x in _GRID for y in _GRID]
    costs = [float(np.sum(disagreement(np.array(w)) ** 2)) for w in tried]
    if not np.any(np.isfinite(costs)):
        return None
    w = np.array(tried[int(np.nanargmin(costs))])
    left = disagreement(w)
    for _ in range(_ROUNDS):
        jacobian = np.stack([(disagreement(w + d) - disagreement(w - d)) / 0.01 for d in 0.005 * np.eye(2)], axis=1)
        if not np.all(np.isfinite(jacobian)):  # a step further the cuts leave the image
            break
        step = np.clip(-np.linalg.lstsq(jacobian, left, rcond=None)[0], -0.03, 0.03)
        while np.abs(step).max() > 1e-5:
            ahead = disagreement(w + step) if np.hypot(*(w + step)) < 0.5 else np.full_like(left, np.inf)
            if ahead @ ahead < left @ left:
                w, left = w + step, ahead
                break
            step = step / 2
        else:
            break
    point = middle @ np.array([w[0], w[1], 1.0])
    return np.asarray(point[:2] / point[2])


def _middle(conic: Array) -> Array:
    return np.asarray(-np.linalg.solve(conic[:2, :2], conic[:2, 2]))


def read_profile(pixels: Pixels, matrix: Array, variance: float) -> tuple[int, float]:
    """The word of the bank that explains the pixels best, and the log-likelihood by which it beats the others."""
    words = ring_code_words().astype(np.float64)
    radii = (CELLS - np.arange(CELLS)) / CELLS
    discs = np.stack([np.zeros(CELLS), np.zeros(CELLS), radii], axis=1)
    covered = coverage_of(pixels.places, matrix, discs, variance, derivatives=False).covered
    # Cell k is the disc of radius k less the next one inward.
    cells = covered - np.concatenate([covered[:, 1:], np.zeros((len(covered), 1))], axis=1)
    left, contrast = unexplained(pixels, cells @ words.T)
    left = np.where(np.sign(contrast) == np.sign(contrast[np.argmin(left)]), left, 1.0)
    first, second = np.argsort(left)[:2]
    return int(first), 0.5 * len(pixels.values) * math.log(max(left[second], 1e-12) / max(left[first], 1e-12))


def read_crowns(image: LightImage, conic: Array, variance: float) -> RingReading | str:
    """Read the marker whose outer circle has this image; a reason if none of the bank is there."""
    centre = centre_by_cuts(image, conic)
    if centre is None:
        return "a circle reaches beyond the image"
    matrix = homography_of(conic, centre)
    pixels = pixels_inside(image, conic, _REACH)
    if pixels is None:
        return "a circle reaches beyond the image, or has too few pixels"
    identity, margin = read_profile(pixels, matrix, variance)
    if margin < _DECISIVE:
        return "the widths of the crowns do not decide between two identities"
    radii = ring_code_radii(identity)
    discs = np.stack([np.zeros(len(radii)), np.zeros(len(radii)), radii], axis=1)
    weights = np.where(np.arange(len(radii)) % 2 == 0, 1.0, -1.0)
    fit = fit_pattern(pixels, matrix, discs, weights, variance, turns=False)
    if fit is None or not fit.describes(image.noise_dn):
        return "the widths of the crowns are those of no identity of the bank"
    return RingReading(identity, fit)


def _candidates(view: View, image: LightImage, read: list[Found]) -> Iterator[tuple[Array, float]]:
    """Conics that may be the image of an outer circle, with a variance of the blur: outlines only if no circle is read.

    A thin outer crown at high tilt is no circle with one edge for the detector.
    """
    for circle in circles_of_view(view, least_confidence=_LEAST_CONFIDENCE):
        yield circle.conic, max(float(getattr(circle.fit, "blur_px", 0.6)) ** 2, 0.05)
    for light in (False, True):
        if not read:
            for ellipse in ink_outlines(image.levels, image.noise_dn, light)[:_OUTLINES]:
                yield conic_of_ellipse(ellipse), 0.25


def find(view: View) -> list[Found]:
    """Coded crowns of a view: identity, unique pose, focal length.

    Raises
    ------
    MethodFailure
        If another kind of marker is printed, or no circle holds an identity of the bank.
    """
    require_kind(view, *KINDS)
    image = light_image(view)
    out: list[Found] = []
    reasons: list[str] = []
    for conic, variance in _candidates(view, image, out):
        read = read_crowns(image, conic, variance)
        if isinstance(read, str):
            reasons.append(read)
        else:
            out.append(found_of(view, read.fit.homography, read.identity, min(max(read.fit.explained, 0.0), 1.0)))
    if reasons and not out:
        raise MethodFailure(f"no coded crowns are read: {reasons[0]}")
    return out
