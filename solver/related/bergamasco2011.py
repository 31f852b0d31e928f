"""Dots on rings (RUNE-Tag): identity by a cyclic code, pose by the dots' centres, focal length if it is not known.

Source: F. Bergamasco, A. Albarelli, E. Rodola, A. Torsello, RUNE-Tag: a high accuracy fiducial marker with strong
occlusion resilience, CVPR (2011). The steps are theirs: ellipses of dots; every pair of them is a hypothesis of the
ring's plane and rotation; the other dots vote; the cyclic code is decoded; the pose follows from the dots' centres.
Code and print are `scenes.markers.dot_codes`.

A dot's moments give its image up to a rotation, and the moments of all dots that of the plane (weak perspective); in
the plane two dots that are k sectors apart on the outer ring determine its centre, size and rotation. The homography of
the best hypotheses is then refined with the dots that fit.

The image of a dot's centre is not the centre of its ellipse: `homography_of_dots` compares the measured centres with
those of the ellipses that it predicts. Once the code is read, homography, blur and levels are fitted to all pixels of
the print together, which gives a covariance. Pose and focal length are those of least squares with it
(`homography_pose`), where the paper runs a perspective-n-point solver, and a search for an unknown focal length.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.markers.dot_codes import (
    BOTH,
    INNER,
    LEAST_DISTANCE,
    OUTER,
    OUTER_DOT,
    OUTER_RING,
    SECTORS,
    dot_code_words,
    dot_places,
    inked_places,
)
from roundel.solver.methods.plugin import Found, MethodFailure, View
from roundel.solver.pose.direct_homography import homography
from roundel.solver.views.circles_of_view import require_kind
from roundel.solver.views.disc_coverage import coverage_of
from roundel.solver.views.disc_pattern import Pixels, fit_pattern, levels_columns
from roundel.solver.views.homography_pose import MeasuredHomography, moved
from roundel.solver.views.ink_blobs import Blobs, ink_blobs
from roundel.solver.views.marker_pixels import (
    LightImage,
    conic_of_homography,
    found_of,
    light_image,
    pixels_inside,
)

Array = NDArray[np.float64]

KINDS = ("dot_code",)

_FEWEST_DOTS = 11
_MOST_DOTS = 60  # blobs of a dot's size within a marker's reach: three times as many as its places are a texture
_SMALLEST, _LARGEST = 0.6, 1.6  # size of a ring by a pair of dots over that by a dot's own size
_NEAR = 0.13  # outer radii: less than half the distance between two places
_HYPOTHESES = 12
_ALIKE = 0.1  # distance of two centres, outer radii
_REACH = 1.1
_ROUNDS = 12
_SETTLED, _ROUGHLY = 1e-10, 1e-3
_PRESENT = 0.5  # of the contrast between ink and paper
_UNSURE = 0.12  # around it a place is an erasure
# Twice the errors plus the erasures; below the
# distance 5 of the code the nearest word is unique; up to 2 it is almost surely right.
_MOST_DAMAGE = 2


@dataclass(frozen=True, eq=False)
class DotReading:
    """One marker as read.

    Attributes
    ----------
    identity : int
    homography : MeasuredHomography
        Its rotation is that of the decoded word.
    damage : int
        Twice the wrong sectors plus the unreadable ones.
    dots : (N,) array of int
        The blobs that are its dots.
    """

    identity: int
    homography: MeasuredHomography
    damage: int
    dots: NDArray[np.int64]


def ring_hypotheses(blobs: Blobs, places: Array) -> list[Array]:
    """Homographies (affine) from pairs of dots, those that most dots vote for first.

    Parameters
    ----------
    blobs : Blobs
    places : (22, 3) array
        See `dot_places`.
    """
    count = len(blobs.centre)
    out: list[tuple[float, Array]] = []
    if count < _FEWEST_DOTS:
        return []
    sizes = blobs.size
    angle = 2 * np.pi / SECTORS
    for i in range(count):
        # The neighbours within the diameter of a marker whose outer dot this is, and their common shape.
        whole = sizes[i] / OUTER_DOT
        shape = blobs.spread[i] / math.sqrt(float(np.linalg.det(blobs.spread[i])))
        local = _root(shape)
        away = (blobs.centre - blobs.centre[i]) @ np.linalg.inv(local).T / whole
        near = np.flatnonzero((np.hypot(*away.T) < 2.6) & (sizes < 1.6 * sizes[i]) & (sizes > 0.4 * sizes[i]))
        if not _FEWEST_DOTS <= len(near) <= _MOST_DOTS:
            continue
        shapes = blobs.spread[near] / np.sqrt(np.linalg.det(blobs.spread[near]))[:, None, None]
        # Large dots have the better shapes.
        shape = np.einsum("n,nij->ij", sizes[near] ** 2, shapes)
        local = _root(shape / math.sqrt(float(np.linalg.det(shape))))
        flat = (blobs.centre[near] - blobs.centre[i]) @ np.linalg.inv(local).T
        turns = np.arange(1, SECTORS // 2 + 1) * angle
        # Their distance on the ring gives its size, which has to be that of the dot.
        chord = np.abs(OUTER_RING * (np.exp(1j * turns) - 1)) * whole
        scale = np.hypot(*flat.T)[:, None] / chord
        for j, k in np.argwhere((scale > _SMALLEST) & (scale < _LARGEST)).tolist():
            out += _votes(flat[j], float(turns[k]), flat, places, blobs.centre[i], local)
    out.sort(key=lambda pair: -pair[0])
    kept: list[Array] = []
    for _, matrix in out:
        # Rotations by whole sectors are one hypothesis: the code says which.
        size = math.sqrt(abs(float(np.linalg.det(matrix[:2, :2]))))
        if all(np.hypot(*(matrix[:2, 2] - other[:2, 2])) > _ALIKE * size for other in kept):
            kept.append(matrix)
        if len(kept) == _HYPOTHESES:
            break
    return kept


def _votes(other: Array, turn: float, flat: Array, places: Array, at: Array, local: Array) -> list[tuple[float, Array]]:
    """The ring on which a dot at the origin is followed by one at `other`, turn radians further, with its votes."""
    z = complex(other[0], -other[1])  # Y up
    first = OUTER_RING
    # The similarity X -> s X + c with s first = -c and s first e^(i turn) = z - c.
    s = z / (first * (np.exp(1j * turn) - 1))
    c = -s * first
    plane = ((flat[:, 0] - 1j * flat[:, 1]) - c) / s
    place = places[:, 0] + 1j * places[:, 1]
    distance = np.abs(plane[:, None] - place[None]).min(axis=1)
    inside = np.abs(plane) < 1.0
    votes = float(np.sum(distance[inside] < _NEAR) - np.sum(distance[inside] >= _NEAR) - distance[inside].sum())
    if votes < _FEWEST_DOTS / 2:
        return []
    similarity = np.array([[s.real, -s.imag, c.real], [-s.imag, -s.real, -c.imag], [0.0, 0.0, 1.0]])
    affine = np.eye(3)
    affine[:2, :2], affine[:2, 2] = local, at
    return [(votes, affine @ similarity)]


def _root(shape: Array) -> Array:
    value, vector = np.linalg.eigh(shape)
    return np.asarray((vector * np.sqrt(value)) @ vector.T)


def matched(blobs: Blobs, matrix: Array, places: Array) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
    """A homography refined with the blobs that fit it; they and their places, each place once."""
    here = there = np.empty(0, dtype=np.int64)
    for tolerance in (_NEAR, _NEAR, 0.1, 0.07):
        rays = np.column_stack([blobs.centre, np.ones(len(blobs.centre))]) @ np.linalg.inv(matrix).T
        plane = rays[:, :2] / rays[:, 2:]
        distance = np.linalg.norm(plane[:, None] - places[None, :, :2], axis=2)
        here = np.flatnonzero((distance.min(axis=1) < tolerance) & (rays[:, 2] > 0))
        there = distance[here].argmin(axis=1)
        order = np.lexsort((distance[here, there], there))
        keep = order[np.concatenate([[True], np.diff(there[order]) > 0])] if len(order) else order
        here, there = here[keep], there[keep]
        if len(here) < _FEWEST_DOTS:
            return matrix, here[:0], there[:0]
        try:
            matrix = homography(places[there, :2], blobs.centre[here])
        except ValueError:
            return matrix, here[:0], there[:0]
    return matrix, here, there


def decode(present: NDArray[np.bool_], unsure: NDArray[np.bool_]) -> tuple[int, int, int] | None:
    """Identity, sectors by which the word is turned, and damage, from the 22 places; None if no word is near enough.

    Parameters
    ----------
    present : (22,) array of bool
        Whether there is a dot, in the order of `dot_places`.
    unsure : (22,) array of bool
        Places that could not be told.
    """
    outer, inner = present[:SECTORS].astype(int), present[SECTORS:].astype(int)
    erased = unsure[:SECTORS] | unsure[SECTORS:] | (outer + inner == 0)
    seen = np.where(outer == 0, INNER, np.where(inner == 0, OUTER, BOTH))
    # Rotations of what is seen, instead of those of all words.
    turns = (np.arange(SECTORS)[:, None] + np.arange(SECTORS)) % SECTORS
    differ = (np.array(dot_code_words())[:, None] != seen[turns]) & ~erased[turns]
    errors = differ.sum(axis=2)
    identity, turn = (int(v) for v in np.unravel_index(int(np.argmin(errors)), errors.shape))
    damage = 2 * int(errors[identity, turn]) + int(erased.sum())
    if damage > _MOST_DAMAGE or damage >= LEAST_DISTANCE:
        return None
    return identity, turn, damage


def presence(pixels: Pixels, matrix: Array, places: Array, variance: float) -> Array:
    """Ink at each of the 22 places by least squares of the pixels: about 1 for a dot, 0 for paper."""
    covered = coverage_of(pixels.places, matrix, places, variance, derivatives=False).covered
    ground = levels_columns(pixels.places, np.zeros(len(covered)))[:, :3]
    columns = np.concatenate([ground, -covered], axis=1)
    levels = np.linalg.lstsq(columns, pixels.values, rcond=None)[0]
    depth = levels[3:]
    # Every word has eleven dots or more, dark or light: the largest depths are those of dots.
    full = float(np.median(depth[np.argsort(np.abs(depth))[-8:]]))
    return np.asarray(depth / full if full != 0 else depth)


def _told(ink: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    return ink > _PRESENT, np.abs(ink - _PRESENT) < _UNSURE


def homography_of_dots(centres_px: Array, dots: Array, start: Array) -> Array | None:
    """The homography under which the images of the dots are ellipses with these centres.

    The centre of such an ellipse, -C_2x2^-1 c of its conic, is not the image of the dot's centre; it is compared with
    what was measured, so that exact ellipses give the exact homography.

    Parameters
    ----------
    centres_px : (N, 2) array
        Centres of the dots' ellipses, undistorted px.
    dots : (N, 3) array
        x, y, radius, in outer radii; four or more, no three on a line.
    start : (3, 3) array

    Returns
    -------
    (3, 3) array or None
        None if it does not settle.
    """
    matrix = start
    for _ in range(_ROUNDS):
        left = (centres_px - _ellipse_centres(matrix, dots)).ravel()
        rates = np.stack(
            [
                (_ellipse_centres(moved(matrix, e), dots) - _ellipse_centres(moved(matrix, -e), dots)).ravel() / 2e-6
                for e in 1e-6 * np.eye(8)
            ],
            axis=1,
        )
        delta, _, rank, _ = np.linalg.lstsq(rates, left, rcond=1e-10)
        if rank < 8 or not np.all(np.isfinite(delta)) or np.abs(delta).max() > 0.5:
            return None
        matrix = moved(matrix, np.asarray(delta, dtype=np.float64))
        matrix = matrix / matrix[2, 2]
        if np.abs(delta).max() < _SETTLED:
            return np.asarray(matrix)
    return np.asarray(matrix) if np.abs(delta).max() < _ROUGHLY else None


def _ellipse_centres(matrix: Array, dots: Array) -> Array:
    """Centres (N, 2) of the images of the dots, by the dual conics H diag(r^2, r^2, -1) H^T about each dot."""
    x, y, r = dots.T
    about = np.zeros((len(dots), 3, 3))
    about[:, 0, 0] = about[:, 1, 1] = r**2
    about -= np.einsum("ni,nj->nij", *(np.stack([x, y, np.ones_like(x)], axis=1),) * 2)
    dual = matrix @ about @ matrix.T
    return np.asarray(dual[:, :2, 2] / dual[:, 2, 2, None])


def _away_from(pixels: Pixels, matrix: Array, places: Array) -> Pixels:
    """The pixels that see none of some places, with half a dot's radius around them."""
    if not len(places):
        return pixels
    rays = np.column_stack([pixels.places, np.ones(len(pixels.places))]) @ np.linalg.inv(matrix).T
    plane = rays[:, :2] / rays[:, 2:]
    distance = np.linalg.norm(plane[:, None] - places[None, :, :2], axis=2)
    keep = np.all(distance > 1.5 * places[:, 2], axis=1)
    return Pixels(pixels.places[keep], pixels.values[keep])


def _turned(matrix: Array, sectors: int) -> Array:
    angle = 2 * np.pi * sectors / SECTORS
    c, s = math.cos(angle), math.sin(angle)
    return np.asarray(matrix @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))


def read_dots(image: LightImage, blobs: Blobs) -> DotReading | str:
    """The marker that most dots of an image vote for; a reason if there is none, or its code is not of the bank."""
    if len(blobs.centre) < _FEWEST_DOTS:
        return f"{len(blobs.centre)} dots are found; a marker has {_FEWEST_DOTS} or more"
    places = dot_places()
    reason = "the dots are on no ring of the code"
    tried: list[tuple[int, Array, NDArray[np.int64], NDArray[np.int64]]] = []
    for hypothesis in ring_hypotheses(blobs, places):
        matrix, here, there = matched(blobs, hypothesis, places)
        if len(here):
            tried.append((len(here), matrix, here, there))
    tried.sort(key=lambda one: -one[0])
    for _, matrix, here, there in tried:
        pixels = pixels_inside(image, conic_of_homography(matrix), _REACH)
        if pixels is None:
            reason = "its dots reach beyond the image"
            continue
        variance = float(np.median(blobs.variance[here])) - 1.0 / 12.0
        variance = min(max(variance, 0.05), 25.0)
        corrected = homography_of_dots(blobs.centre[here], places[there], matrix)
        if corrected is None:
            continue
        present, unsure = _told(presence(pixels, corrected, places, variance))
        read = decode(present, unsure)
        if read is None:
            reason = "the dots' code is no word of the bank"
            continue
        identity, turn, damage = read
        # From the sectors as they were found to those of the word.
        present, unsure = (np.roll(v.reshape(2, SECTORS), -turn, axis=1).ravel() for v in (present, unsure))
        word = inked_places(dot_code_words()[identity])
        bad = unsure | (present != word)
        matrix, dots = _turned(corrected, turn), places[word & ~bad]
        pixels = _away_from(pixels, matrix, places[bad])
        fit = fit_pattern(pixels, matrix, dots, np.ones(len(dots)), variance, turns=True)
        if fit is None or not fit.describes(image.noise_dn):
            reason = "the dots are not as they are printed"
            continue
        return DotReading(identity, fit.homography, damage, here)
    return reason


def find(view: View) -> list[Found]:
    """Dot codes of a view: identity, unique pose, focal length.

    Raises
    ------
    MethodFailure
        If another kind of marker is printed, there are too few dots, or none of the codes is a word of the bank.
    """
    require_kind(view, *KINDS)
    image = light_image(view)
    reasons: list[str] = []
    for light in (False, True):
        blobs = ink_blobs(image.levels, image.noise_dn, light)
        out: list[Found] = []
        while isinstance(read := read_dots(image, blobs), DotReading):
            out.append(found_of(view, read.homography, read.identity, 1.0 - read.damage / LEAST_DISTANCE))
            left = np.setdiff1d(np.arange(len(blobs.centre)), read.dots)
            blobs = Blobs(blobs.centre[left], blobs.spread[left], blobs.variance[left])
        if out:
            return out
        reasons.append(read)
    raise MethodFailure(f"no dot code is read: {reasons[0]}")
