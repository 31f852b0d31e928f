"""Bundle adjustment of a camera and the poses of its boards, from corners, with covariance.

Gauss-Newton on the normal equations, whose poses are eliminated by the Schur complement (B. Triggs, P. McLauchlan,
R. Hartley, A. Fitzgibbon, Bundle adjustment - a modern synthesis, 2000), from the camera of `cv2.calibrateCamera`. The
noise of the corners is measured by their residuals, in each photograph: the corners of a distant or blurred board
scatter more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera
from roundel.scenes.camera.parameter_covariance import parameter_names

Array = NDArray[np.float64]

POSE = 6

_MOST_STEPS = 30
# Steps so small, in standard deviations of the result, change nothing that anyone can measure.
_SMALL_STEP = 1e-6
# Rounds of measuring the noise of each photograph; the third changes it by less than a percent.
_ROUNDS = 3
# Degrees of freedom with which the noise of all photographs counts for that of one: a board of six corners, which has
# six itself, is not taken for exact by chance. More would make the pose of a sharp photograph less certain than it is.
_POOLED = 2.0
# An excess of this many standard deviations of a chi-square per degree of freedom is no chance.
_CHANCE = 3.0


@dataclass(frozen=True, eq=False)
class BoardCorners:
    """Corners of a board and their images.

    Attributes
    ----------
    points_m : (N, 3) array
        In the board's frame: origin at its centre, Z out of the print.
    pixels : (N, 2) array
        In the image as it is stored.
    """

    points_m: Array
    pixels: Array


@dataclass(frozen=True, eq=False)
class BoardFit:
    """A camera and the poses of its boards.

    Attributes
    ----------
    camera : Camera
    parameters : tuple of str
        Names of the camera's parameters: fx, fy, cx, cy in px, then coefficients of distortion.
    covariance : (c, c) array
        Of the parameters; zero if they are taken as exact.
    poses : (V, 4, 4) array
        `camera_from_board`.
    pose_covariance : (V, 6, 6) array
        Of each pose: rotation about the axes of the camera's frame (rad), then origin of the board (m). The errors of
        all poses share that of the camera.
    sigma_px : (V,) array
        Noise of a coordinate of a corner in each photograph.
    rms_px : (V,) array
        Root mean square distance of the corners from the model, in each photograph.
    widened : float
        Factor by which the standard deviations were widened, because the photographs contradict each other by more
        than their noise.
    """

    camera: Camera
    parameters: tuple[str, ...]
    covariance: Array
    poses: Array
    pose_covariance: Array
    sigma_px: Array
    rms_px: Array
    widened: float = 1.0


def adjusted_camera(boards: Sequence[BoardCorners], camera: Camera, poses: Array) -> BoardFit:
    """The camera and poses of least chi-square, from a start.

    Parameters
    ----------
    boards : sequence of BoardCorners
        Of one camera.
    camera : Camera
        OpenCV's lens model; every coefficient that it has is fitted.
    poses : (V, 4, 4) array
    """
    state = _State(camera, poses, np.ones(len(boards)))
    for _ in range(_ROUNDS):
        state = _least(boards, state, free=True)
        state = replace(state, sigma_px=_noise(boards, state, free=True))
    state = _least(boards, state, free=True)
    system = _System.of(boards, state)
    covariance = system.covariance()
    excess, freedom = system.shared_error(covariance)
    raised = excess if excess > 1.0 + _CHANCE * np.sqrt(2.0 / freedom) else 1.0
    return _fit(boards, state, covariance * raised, system, raised)


def adjusted_poses(boards: Sequence[BoardCorners], camera: Camera, poses: Array, covariance: Array) -> BoardFit:
    """The poses of least chi-square for a given camera.

    Parameters
    ----------
    boards : sequence of BoardCorners
    camera : Camera
    poses : (V, 4, 4) array
        To start from.
    covariance : (c, c) array
        Of the camera's parameters, c = 4 and its number of coefficients; its errors are independent of the corners'.
    """
    state = _State(camera, poses, np.ones(len(boards)))
    for _ in range(_ROUNDS):
        state = _least(boards, state, free=False)
        state = replace(state, sigma_px=_noise(boards, state, free=False))
    state = _least(boards, state, free=False)
    return _fit(boards, state, covariance, _System.of(boards, state), 1.0)


def least_squares_covariance(boards: Sequence[BoardCorners], camera: Camera, poses: Array) -> tuple[Array, float]:
    """Covariance (c, c) of a camera that was fitted by least squares with all corners alike, as OpenCV does.

    For the information I_v of each photograph v per squared pixel, its noise s_v, and C = (sum I_v)^-1, the covariance
    of that fit is C (sum s_v^2 I_v) C. It is widened where the photographs contradict each other by more than their
    noise, see `_System.shared_error`: corners have errors that they share.

    Parameters
    ----------
    boards : sequence of BoardCorners
    camera : Camera
        The fit. The covariance is that of all its parameters.
    poses : (V, 4, 4) array
        `camera_from_board` of the fit.

    Returns
    -------
    covariance : (c, c) array
        In the order of `parameter_names`; infinite if the photographs do not determine the camera.
    widened : float
        Factor on the standard deviations; 1 for none.
    """
    state = _State(camera, poses, np.ones(len(boards)))
    system = _System.of(boards, state)
    inverse = system.covariance()
    if not np.isfinite(inverse).all():
        return inverse, 1.0
    variance = _noise(boards, state, free=True) ** 2
    noise = np.einsum("V,Vij->ij", variance, system.information)
    excess, freedom = system.shared_error(inverse, variance)
    raised = excess if excess > 1.0 + _CHANCE * np.sqrt(2.0 / freedom) else 1.0
    return inverse @ noise @ inverse * raised, float(np.sqrt(raised))


def corner_information(points_m: Array, camera: Camera, pose: Array, sigma_px: float) -> Array:
    """Information (c, c) on a camera's parameters of one photograph of a board, whose pose is not known.

    Parameters
    ----------
    points_m : (N, 3) array
        Corners in the board's frame.
    camera : Camera
    pose : (4, 4) array
        `camera_from_board`.
    sigma_px : float
        Noise of a coordinate of a corner.
    """
    board = BoardCorners(points_m, np.zeros((len(points_m), 2)))
    _, by_camera, by_pose = (m / sigma_px for m in _linearised(board, camera, pose))
    mixed = by_camera.T @ by_pose
    return np.asarray(by_camera.T @ by_camera - mixed @ np.linalg.solve(by_pose.T @ by_pose, mixed.T))


@dataclass(frozen=True, eq=False)
class _State:
    """A camera, poses, and the noise of each photograph."""

    camera: Camera
    poses: Array
    sigma_px: Array

    def moved(self, camera: Array, poses: Array) -> _State:
        """With all parameters changed: camera (c,), poses (V, 6)."""
        k = self.camera.K.copy()
        k[[0, 1, 0, 1], [0, 1, 2, 2]] += camera[:4]
        lens = tuple(float(v) for v in np.array(self.camera.distortion) + camera[4:])
        changed = self.poses.copy()
        for pose, step in zip(changed, poses, strict=True):
            pose[:3, :3] = cv2.Rodrigues(step[:3])[0] @ pose[:3, :3]
            pose[:3, 3] += step[3:]
        return replace(self, camera=replace(self.camera, K=k, distortion=lens), poses=changed)


def _linearised(board: BoardCorners, camera: Camera, pose: Array) -> tuple[Array, Array, Array]:
    """Residuals (2N,) of corners, measured minus predicted, and derivatives by camera (2N, c) and pose (2N, 6)."""
    turned = board.points_m @ pose[:3, :3].T
    # OpenCV's derivatives are exact in float64; of a turn by nothing they are those by the camera's own frame.
    still = np.zeros(3)
    lens = np.array(camera.distortion) if camera.distortion else np.zeros(4)
    px, jacobian = cv2.projectPoints(np.ascontiguousarray(turned + pose[:3, 3]), still, still, camera.K, lens)
    by_place = jacobian[:, 3:6].reshape(-1, 2, 3)
    # A turn w moves a corner by w x (R X).
    cross = np.zeros((len(turned), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = turned[:, 2], -turned[:, 1], turned[:, 0]
    cross -= np.swapaxes(cross, 1, 2)
    by_pose = np.concatenate([by_place @ cross, by_place], axis=-1).reshape(-1, POSE)
    by_camera = jacobian[:, 6 : 10 + len(camera.distortion)]
    return (board.pixels - px.reshape(-1, 2)).ravel(), np.asarray(by_camera, dtype=np.float64), by_pose


@dataclass(frozen=True, eq=False)
class _System:
    """Normal equations with the poses eliminated: one pose meets no other.

    Attributes
    ----------
    cost : (V,) array
        Chi-square of each photograph.
    information : (V, c, c) array
        Of each photograph on the camera.
    gradient : (V, c) array
        Downhill, of half the chi-square; they add up to zero at the minimum.
    carried : (V, c, 6) array
        Mixed block of camera and pose, times the inverse of the pose's.
    pose_inverse : (V, 6, 6) array
        Covariance of each pose for a known camera.
    pose_gradient : (V, 6) array
    """

    cost: Array
    information: Array
    gradient: Array
    carried: Array
    pose_inverse: Array
    pose_gradient: Array

    @staticmethod
    def of(boards: Sequence[BoardCorners], state: _State) -> _System:
        blocks: list[tuple[Array, ...]] = []
        for board, pose, sigma in zip(boards, state.poses, state.sigma_px, strict=True):
            residual, by_camera, by_pose = (m / sigma for m in _linearised(board, state.camera, pose))
            inverse = np.linalg.inv(by_pose.T @ by_pose)
            carried = by_camera.T @ by_pose @ inverse
            downhill = by_pose.T @ residual
            information = by_camera.T @ by_camera - carried @ by_pose.T @ by_camera
            gradient = by_camera.T @ residual - carried @ downhill
            blocks.append((np.sum(residual**2), information, gradient, carried, inverse, downhill))
        return _System(*(np.array(column) for column in zip(*blocks, strict=True)))

    def covariance(self) -> Array:
        """Covariance (c, c) of the camera; infinite if the photographs do not determine it."""
        information = self.information.sum(axis=0)
        scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
        values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
        if not values[0] > 1e-14 * values[-1]:
            return np.full_like(information, np.inf)
        return np.asarray((vectors / values) @ vectors.T / np.outer(scale, scale))

    def step(self, free: bool) -> tuple[Array, Array, float]:
        """Gauss-Newton step of camera and poses, and its length in standard deviations."""
        camera = np.zeros(self.gradient.shape[1])
        if free:
            covariance = self.covariance()
            camera = covariance @ self.gradient.sum(axis=0) if np.isfinite(covariance).all() else camera
        poses = np.einsum("Vij,Vj->Vi", self.pose_inverse, self.pose_gradient) - np.einsum(
            "Vcj,c->Vj", self.carried, camera
        )
        promised = float(camera @ self.gradient.sum(axis=0)) + float(
            np.einsum("Vi,Vij,Vj->", self.pose_gradient, self.pose_inverse, self.pose_gradient)
        )
        return camera, poses, float(np.sqrt(max(promised, 0.0)))

    def shared_error(self, inverse: Array, variance: Array | None = None) -> tuple[float, float]:
        """Variance of the photographs' pulls on the camera over that of the noise, and its degrees of freedom.

        At the minimum the gradients g_v of the photographs add up to zero. If the errors of their corners, of variance
        s_v^2, are independent, the mean of the sum of g_v^T M^-1 g_v is known, for M = sum s_v^2 I_v, the informations
        I_v and their inverse sum C: g_v has the covariance s_v^2 (I_v - I_v C I_v - I_v C I_v) + I_v C M C I_v. Errors
        that the corners of a photograph share, as on a bent sheet, make it larger.

        Parameters
        ----------
        inverse : (c, c) array
            C.
        variance : (V,) array, optional
            s_v^2, in units of the residuals'; 1 for all without it.
        """
        weights = np.ones(len(self.gradient)) if variance is None else variance
        own = self.information
        pull = own @ inverse
        noise = np.einsum("V,Vij->ij", weights, own)
        scatter = weights[:, None, None] * (own - 2.0 * pull @ own) + pull @ noise @ np.swapaxes(pull, 1, 2)
        to_unit = np.linalg.pinv(noise)
        freedom = float(np.einsum("ij,Vji->", to_unit, scatter))
        return float(np.einsum("Vi,ij,Vj->", self.gradient, to_unit, self.gradient)) / freedom, freedom


def _least(boards: Sequence[BoardCorners], state: _State, free: bool) -> _State:
    """The minimum next to a start; the camera stays unless it is free."""
    now = _System.of(boards, state)
    for _ in range(_MOST_STEPS):
        camera, poses, length = now.step(free)
        if length < _SMALL_STEP:
            break
        for part in (1.0, 0.3, 0.1):
            trial = state.moved(part * camera, part * poses)
            after = _System.of(boards, trial)
            if after.cost.sum() <= now.cost.sum():
                state, now = trial, after
                break
        else:
            break
    return state


def _noise(boards: Sequence[BoardCorners], state: _State, free: bool) -> Array:
    """Standard deviation (V,) of a coordinate in each photograph, from the residuals and their degrees of freedom."""
    system = _System.of(boards, state)
    freedom = np.array([2.0 * len(board.pixels) - POSE for board in boards])
    if free:
        freedom -= np.einsum("ij,Vji->V", system.covariance(), system.information)
    freedom = np.maximum(freedom, 1e-3)
    squares = system.cost * state.sigma_px**2
    pooled = squares.sum() / freedom.sum()
    return np.asarray(np.sqrt((squares + _POOLED * pooled) / (freedom + _POOLED)))


def _fit(boards: Sequence[BoardCorners], state: _State, covariance: Array, system: _System, raised: float) -> BoardFit:
    # Both terms: the corners' noise for a known camera, and the camera's error.
    poses = raised * system.pose_inverse + np.einsum(
        "Vci,cd,Vdj->Vij", system.carried, np.where(np.isfinite(covariance), covariance, 0.0), system.carried
    )
    counts = np.array([len(board.pixels) for board in boards])
    rms = np.sqrt(system.cost * state.sigma_px**2 / counts)
    return BoardFit(
        state.camera,
        parameter_names(state.camera),
        covariance,
        state.poses,
        poses,
        state.sigma_px * np.sqrt(raised),
        rms,
        float(np.sqrt(raised)),
    )
