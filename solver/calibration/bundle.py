"""Bundle adjustment of a camera and the poses of its boards, from ellipses with covariance.

Levenberg-Marquardt on the normal equations, whose poses are eliminated by the Schur complement: one view's pose meets
no other's. Source: B. Triggs, P. McLauchlan, R. Hartley, A. Fitzgibbon, Bundle adjustment - a modern synthesis (2000).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.solver.calibration.contour_model import POSE, Dots, Model, predicted_shapes

Array = NDArray[np.float64]

_MOST_STEPS = 100
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-3, 1e-14, 1e12
# Steps so small, in standard deviations of the result, change nothing that anyone can measure.
_SMALL_STEP = 1e-7
_SINGULAR = 1e-14  # ratio of the scaled information's eigenvalues: less is rounding


@dataclass(frozen=True, eq=False)
class Adjusted:
    """A bundle adjustment.

    Attributes
    ----------
    model : Model
    chi_square : (N,) array
        Of each dot: five residuals, whitened by the covariance of its ellipse.
    residual : (N, 5) array
        Measured minus predicted shape, px.
    information : (V, c, c) array
        Of each view on the camera's parameters, with its pose eliminated.
    gradient : (V, c) array
        Of half the chi-square of each view, downhill, with its pose eliminated: they add up to zero at the minimum.
    converged : bool
    """

    model: Model
    chi_square: Array
    residual: Array
    information: Array
    gradient: Array
    converged: bool

    def covariance(self) -> Array | None:
        """Covariance (c, c) of the camera's parameters; None if the views do not determine them."""
        information = self.information.sum(axis=0)
        scale = np.sqrt(np.maximum(np.diag(information), 0.0))
        if not np.all(scale > 0):
            return None
        values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
        if not values[0] > _SINGULAR * values[-1]:
            return None
        return np.asarray((vectors / values) @ vectors.T / np.outer(scale, scale))

    def shared_error(self, covariance: Array) -> tuple[float, float]:
        """Variance of the views' pulls on the camera over that of the noise, and its degrees of freedom.

        The pull of a view is its gradient g, of covariance I (its information) if the errors of its dots are
        independent; after the fit the mean of the sum of g^T C g is c - sum tr (C I)^2, with the covariance C of the
        camera. Errors that the dots of a view share, as on a bent board, make it larger, while the chi-square of the
        dots alone sees little of them.
        """
        expected = covariance @ self.information
        freedom = len(covariance) - float(np.einsum("Vij,Vji->", expected, expected))
        pulls = float(np.einsum("Vi,ij,Vj->", self.gradient, covariance, self.gradient))
        return pulls / freedom, freedom


def adjust(start: Model, dots: Dots) -> Adjusted:
    """The model of least chi-square, from a start.

    Parameters
    ----------
    start : Model
    dots : Dots
        Each view has at least one; a view needs two to determine its pose.
    """
    whitener = _whitener(dots.shape_cov)
    state = _Linearised.at(start, dots, whitener)
    damping, converged = _FIRST_DAMPING, False
    for _ in range(_MOST_STEPS):
        step = state.step(damping)
        trial = None if step is None else _Linearised.at(state.model.moved(*step), dots, whitener)
        if trial is None or not trial.cost <= state.cost:
            # At the minimum rounding alone decides whether a step is an improvement.
            if step is not None and state.size_of(*step) < 1e-3 and damping < 1e-6:
                converged = True
                break
            damping *= 10.0
            if damping > _MOST_DAMPING:
                break
            continue
        small = state.size_of(*step) < _SMALL_STEP if step is not None else False
        state, damping = trial, max(damping * 0.1, _LEAST_DAMPING)
        if small or state.cost < 1e-16 * len(dots):
            converged = True
            break
    square = np.einsum("Np,Np->N", state.white, state.white)
    return Adjusted(state.model, square, state.residual, *state.by_view(), converged)


def _whitener(cov: Array) -> Array:
    """L^-1 of each covariance L L^T."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(cov)))


@dataclass(frozen=True, eq=False)
class _Linearised:
    """A model with its residuals and normal equations."""

    model: Model
    residual: Array
    white: Array
    cost: float
    camera: Array  # (V, c, c)
    mixed: Array  # (V, c, 6)
    pose: Array  # (V, 6, 6)
    camera_gradient: Array  # (V, c)
    pose_gradient: Array  # (V, 6)

    @staticmethod
    def at(model: Model, dots: Dots, whitener: Array) -> _Linearised:
        shape, jacobian = predicted_shapes(model, dots)
        residual = dots.shape - shape
        white = np.einsum("Npq,Nq->Np", whitener, residual)
        cost = float(np.sum(white**2))
        rows = whitener @ jacobian
        c, views = jacobian.shape[2] - POSE, len(model.poses)
        by_camera, by_pose = rows[..., :c], rows[..., c:]
        first = np.searchsorted(dots.view, np.arange(views))
        mixed = np.add.reduceat(by_camera.transpose(0, 2, 1) @ by_pose, first)
        pose = np.add.reduceat(by_pose.transpose(0, 2, 1) @ by_pose, first)
        pose_gradient = np.add.reduceat(np.einsum("Npj,Np->Nj", by_pose, white), first)
        camera = np.add.reduceat(by_camera.transpose(0, 2, 1) @ by_camera, first)
        camera_gradient = np.add.reduceat(np.einsum("Npj,Np->Nj", by_camera, white), first)
        # A dot that the lens model does not image has no residual, and no cost that any other could be below.
        cost = cost if np.isfinite(cost) else np.inf
        return _Linearised(model, residual, white, cost, camera, mixed, pose, camera_gradient, pose_gradient)

    def by_view(self) -> tuple[Array, Array]:
        """Information (V, c, c) and gradient (V, c) of the camera with the poses eliminated; zero if they cannot be."""
        try:
            return self._reduced(0.0)[:2]
        except np.linalg.LinAlgError:  # a view whose dots lie on a line
            return np.zeros_like(self.camera), np.zeros_like(self.camera_gradient)

    def _reduced(self, damping: float) -> tuple[Array, Array, Array]:
        """As `by_view`, and the inverses of the poses' information."""
        index = np.arange(POSE)
        pose = self.pose.copy()
        pose[:, index, index] *= 1.0 + damping
        inverse = np.linalg.inv(pose)
        carried = self.mixed @ inverse
        information = self.camera - carried @ self.mixed.transpose(0, 2, 1)
        gradient = self.camera_gradient - np.einsum("Vcj,Vj->Vc", carried, self.pose_gradient)
        return np.asarray(information), np.asarray(gradient), np.asarray(inverse)

    def step(self, damping: float) -> tuple[Array, Array] | None:
        """The damped Gauss-Newton step; None if the damped equations are singular."""
        try:
            by_view, gradient, inverse = self._reduced(damping)
            diagonal = np.maximum(np.diag(self.camera.sum(axis=0)), 1e-300)
            information = by_view.sum(axis=0) + damping * np.diag(diagonal)
            scale = 1.0 / np.sqrt(diagonal)
            camera = scale * np.linalg.solve(information * np.outer(scale, scale), gradient.sum(axis=0) * scale)
        except np.linalg.LinAlgError:
            return None
        rest = self.pose_gradient - np.einsum("Vcj,c->Vj", self.mixed, camera)
        poses = np.einsum("Vij,Vj->Vi", inverse, rest)
        return (camera, poses) if np.isfinite(camera).all() and np.isfinite(poses).all() else None

    def size_of(self, camera: Array, poses: Array) -> float:
        """Length of a step in standard deviations of all parameters."""
        square = camera @ self.camera.sum(axis=0) @ camera + 2 * np.einsum("c,Vcj,Vj->", camera, self.mixed, poses)
        return float(np.sqrt(max(square + np.einsum("Vi,Vij,Vj->", poses, self.pose, poses), 0.0)))
