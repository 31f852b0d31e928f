"""Which of the two candidates moves like a body: evidence that accumulates from frame to frame.

The false candidate is the true normal mirrored at the line of sight. A marker that moves across the view without
turning has one normal that rests and one that turns, by up to twice the angle that the line of sight swings. A marker
that stands still, or turns in place, has two candidates that move equally well: then nothing is learned, and the
probabilities stay where they are.

A hypothesis is a sequence of candidates, with a Kalman filter of its normal and its angular velocity. The velocity is
an Ornstein-Uhlenbeck process around zero; how fast markers turn is not known, so that each hypothesis is followed for
several spreads of it, and their likelihoods decide. Where both candidates meet (the marker seen along its normal) all
continuations are followed, and the smooth ones win. A normal that no prediction explains changes no filter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Standard deviations of each component of the angular velocity, rad/s: at rest, by hand, spinning.
SPEEDS = np.array([0.02, 0.2, 1.5])
_MEMORY_S = 2.0  # over which the angular velocity changes
# Share of a frame's log likelihood that counts. Bodies turn more regularly than the process, so that its frames tell
# less than it claims: with 1, the false candidate is chosen more often than its probability says.
_COUNTS = 0.3
_OUTLIER = 0.01  # fraction of frames whose normal is anywhere; it bounds what a single frame can decide
_LOG_VISIBLE = -math.log(2.0 * math.pi)  # uniform density over the normals that face the camera, per steradian
_FAR = 25.0  # squared distance, in sigmas, from which a normal is an outlier for a filter
_MIN_SIGMA = math.radians(0.05)  # of a measured normal: errors of neighbouring frames are not independent
_KEPT = 4  # hypotheses for each candidate and speed
_BOUND = 12.0  # log odds are bounded, so that a wrong choice can be corrected within a second or so
_NEXT, _AFTER = [1, 2, 0], [2, 0, 1]  # axes of a cross product
_SAME = (1e-3, 0.02)  # differences of normal and angular velocity of two hypotheses that are one


@dataclass(frozen=True, eq=False)
class _Hypotheses:
    """K hypotheses: log likelihood, last candidate, speed, and the filter of each.

    The filter's error is a rotation vector of the normal and the error of the angular velocity, in the camera frame.
    """

    log: Array  # (K,)
    cue: Array  # (K,) log odds for its candidates from knowledge, averaged over the memory
    last: NDArray[np.int64]  # (K,)
    speed: NDArray[np.int64]  # (K,)
    normal: Array  # (K, 3)
    turn: Array  # (K, 3) rad/s
    cov: Array  # (K, 6, 6)

    def take(self, index: NDArray[np.int64]) -> _Hypotheses:
        return _Hypotheses(*(getattr(self, name)[index] for name in self.__dataclass_fields__))


class NormalMotion:
    """The probability of each candidate of one marker, given all its frames so far."""

    def __init__(self) -> None:
        self._all: _Hypotheses | None = None

    @property
    def probability(self) -> tuple[float, float]:
        """Of the candidates of the last frame."""
        if self._all is None:
            return 0.5, 0.5
        total = self._all.log + self._all.cue
        weight = np.exp(total - total.max())
        first = float(weight[self._all.last == 0].sum() / weight.sum())
        return first, 1.0 - first

    def update(self, normal: Array, cov: Array, after_s: float, log_odds: float = 0.0) -> None:
        """Take up a frame.

        Parameters
        ----------
        normal : (2, 3) array
            Both candidates.
        cov : (2, 3, 3) array
            Their covariances.
        after_s : float
            Time since the last frame.
        log_odds : float
            Odds of candidate 0 from knowledge. It is the same knowledge in every frame, and is averaged, not summed.
        """
        if self._all is None:
            self._all = _begun(normal, cov, log_odds)
            return
        before = _predicted(self._all, after_s)
        share = min(1.0, after_s / _MEMORY_S)
        continued, far = zip(*(_measured(before, normal[c], cov[c], c) for c in (0, 1)), strict=True)
        parts = []
        for candidate, sign in ((0, 0.5), (1, -0.5)):
            own, other = far[candidate], far[1 - candidate]
            # Where both are outliers, the nearer one is that of the hypothesis.
            kept = np.flatnonzero((own <= _FAR) | ((other > _FAR) & (own <= other)))
            part = continued[candidate].take(kept)
            part.cue[:] = (1.0 - share) * part.cue + share * sign * log_odds
            if len(kept) == 0:  # every hypothesis is the other candidate
                part = _begun(normal, cov, log_odds)
                part = part.take(np.flatnonzero(part.last == candidate))
                part.log[:] = -_BOUND + max(float(np.max(one.log)) for one in continued)
            parts.append(part)
        names = _Hypotheses.__dataclass_fields__
        joined = _Hypotheses(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))
        self._all = _pruned(joined)


def _begun(normal: Array, cov: Array, log_odds: float) -> _Hypotheses:
    last, speed = (grid.ravel() for grid in np.meshgrid([0, 1], np.arange(len(SPEEDS)), indexing="ij"))
    p = np.zeros((len(last), 6, 6))
    p[:, :3, :3] = _rotation_cov(normal, cov)[last]
    p[:, 3:, 3:] = (SPEEDS[speed] ** 2)[:, None, None] * np.eye(3)
    cue = np.where(last == 0, 0.5, -0.5) * log_odds
    return _Hypotheses(np.zeros(len(last)), cue, last, speed, normal[last], np.zeros((len(last), 3)), p)


def _rotation_cov(normal: Array, cov: Array) -> Array:
    """Covariance (..., 3, 3) of the rotation vector of a normal; the unobservable turn about it is not in it."""
    cross = _cross_matrix(normal)
    return cross @ cov @ np.swapaxes(cross, -1, -2) + _MIN_SIGMA**2 * np.eye(3)


def _predicted(h: _Hypotheses, dt: float) -> _Hypotheses:
    keep = math.exp(-dt / _MEMORY_S)
    along = _MEMORY_S * (1.0 - keep)  # rotation by the mean angular velocity, per unit of it
    step = along * h.turn
    f = np.zeros((6, 6))
    f[:3, :3], f[:3, 3:], f[3:, 3:] = np.eye(3), along * np.eye(3), keep * np.eye(3)
    # Noise of an Ornstein-Uhlenbeck velocity and of its integral.
    q = np.array(
        [
            [2 * dt * _MEMORY_S - _MEMORY_S**2 * (3 - 4 * keep + keep**2), _MEMORY_S * (1 - keep) ** 2],
            [_MEMORY_S * (1 - keep) ** 2, 1 - keep**2],
        ]
    )
    noise = np.kron(q, np.eye(3)) * (SPEEDS[h.speed] ** 2)[:, None, None]
    return _Hypotheses(h.log, h.cue, h.last, h.speed, _rotated(h.normal, step), keep * h.turn, f @ h.cov @ f.T + noise)


def _measured(h: _Hypotheses, normal: Array, cov: Array, candidate: int) -> tuple[_Hypotheses, Array]:
    """Each hypothesis continued by one candidate, and its squared distance (K,) from the prediction."""
    # Tangent basis at the measured normal: the residual is the rotation that takes the predicted normal to it.
    u = _cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    u /= np.linalg.norm(u)
    tangent = np.stack([u, _cross(normal, u)])
    residual = _cross(h.normal, normal) @ tangent.T
    own = tangent @ _rotation_cov(normal, cov) @ tangent.T
    ph = h.cov[:, :, :3] @ tangent.T  # (K, 6, 2)
    s = tangent @ ph[:, :3] + own
    inverse = np.linalg.inv(s)
    gain = ph @ inverse
    # Opposite normals have no cross product either.
    behind = h.normal @ normal < 0
    far = np.where(behind, np.inf, np.einsum("ki,kij,kj->k", residual, inverse, residual))
    likely = _COUNTS * (-0.5 * (far + np.log(np.linalg.det(s))) - math.log(2.0 * math.pi))
    log = np.logaddexp(math.log(1.0 - _OUTLIER) + likely, math.log(_OUTLIER) + _LOG_VISIBLE)
    change = np.einsum("kij,kj->ki", gain, residual)
    moved = _rotated(h.normal, change[:, :3])
    turn, after = h.turn + change[:, 3:], h.cov - gain @ np.swapaxes(ph, -1, -2)
    after = 0.5 * (after + np.swapaxes(after, -1, -2))  # otherwise rounding grows fourfold in each frame
    lost = far > _FAR
    moved[lost], turn[lost], after[lost] = h.normal[lost], h.turn[lost], h.cov[lost]
    return _Hypotheses(h.log + log, h.cue, np.full_like(h.last, candidate), h.speed, moved, turn, after), far


def _pruned(h: _Hypotheses) -> _Hypotheses:
    """The most likely ones of each candidate and speed; equal ones are one."""
    log = h.log - h.log.max()
    for candidate in (0, 1):
        members = h.last == candidate
        log[members] += max(0.0, -_BOUND - float(log[members].max()))
    kept: list[int] = []
    for candidate in (0, 1):
        for speed in range(len(SPEEDS)):
            own: list[int] = []
            members = np.flatnonzero((h.last == candidate) & (h.speed == speed))
            for i in members[np.argsort(-log[members], kind="stable")]:
                same = next(
                    (
                        j
                        for j in own
                        if np.max(np.abs(h.normal[i] - h.normal[j])) < _SAME[0]
                        and np.max(np.abs(h.turn[i] - h.turn[j])) < _SAME[1]
                    ),
                    None,
                )
                if same is not None:
                    log[same] = np.logaddexp(log[same], log[i])
                elif len(own) < _KEPT:
                    own.append(int(i))
            kept += own
    index = np.array(kept)
    out = h.take(index)
    out.log[:] = log[index]
    return out


def _rotated(normal: Array, vector: Array) -> Array:
    """Normals (K, 3) turned by rotation vectors (K, 3), to second order and scaled to unit length."""
    once = _cross(vector, normal)
    turned = normal + once + 0.5 * _cross(vector, once)
    return np.asarray(turned / np.linalg.norm(turned, axis=-1, keepdims=True))


def _cross(a: Array, b: Array) -> Array:
    """Cross products (..., 3); NumPy's own function takes longer to find its axes than to multiply."""
    return np.asarray(a[..., _NEXT] * b[..., _AFTER] - a[..., _AFTER] * b[..., _NEXT])


def _cross_matrix(v: Array) -> Array:
    """The matrices (..., 3, 3) of v x."""
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return out
