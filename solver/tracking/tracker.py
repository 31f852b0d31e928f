"""`Tracker`: the markers of a video or a camera, frame after frame, each with its identity.

Between two frames in which all of the image is searched, a marker is measured where its motion predicts it. What the
motion says about the choice between both poses accumulates, see `normal_motion`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.blas_threads import one_blas_thread
from roundel.scenes.camera.model import Camera
from roundel.scenes.camera.response_curve import UNKNOWN, ResponseCurve, parse_curve
from roundel.solver.ambiguity.disambiguation import Knowledge, check_knowledge
from roundel.solver.detect.confidence import confidence_of, is_circle_image
from roundel.solver.detect.contours import visible_fraction
from roundel.solver.detect.detect import Detection
from roundel.solver.detect.grey_image import noise_dn
from roundel.solver.estimates import Estimate, EstimateKey
from roundel.solver.fit.edges import edge_points
from roundel.solver.fit.ellipse import EllipseFit, FailedFit
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera
from roundel.solver.methods.fit_poses import poses_of_fits
from roundel.solver.methods.locate import camera_of_image, checked_diameter
from roundel.solver.methods.pose_estimate import estimate_of
from roundel.solver.methods.roundel_fits import (
    DEFAULT_METHOD,
    Detections,
    detect_circles,
    fit_detection,
    with_estimated_curve,
)
from roundel.solver.methods.shutter_motion import motions_of
from roundel.solver.photometry.image_levels import EQUAL, averaged_rounding, grey_levels
from roundel.solver.photometry.photometry import Photometry, level_step
from roundel.solver.tracking.assignment import assign, same_contour
from roundel.solver.tracking.ellipse_motion import EllipseMotion
from roundel.solver.tracking.normal_motion import NormalMotion

Array = NDArray[np.float64]

_RATE_HZ = 30.0  # of frames without a time
_CONFIDENT = 0.5  # a doubtful contour starts no track
_CONFIRMED = 3  # frames in which a marker was measured, before its track may outlive a frame without it
_SETTLED = 0.9  # probability from which a candidate is chosen
_ROUGH_PX = 0.05  # error of edge points that have not converged
_SEARCH_S = 0.1  # between two searches of the whole image while a marker is out of sight
_CERTAIN = 20.0  # log odds that count as certain


@dataclass(frozen=True, eq=False)
class TrackedMarker:
    """One marker in one frame.

    Attributes
    ----------
    identity : int
        The same from frame to frame; never given again.
    estimate : Estimate or None
        Both poses; probability and choice from all frames so far. None if it was not measured in this frame.
    ellipse : (5,) array
        x_px, y_px, a_px, b_px, angle_deg in the image: measured, or predicted if there is no estimate.
    frames : int
        Number of frames in which it was measured.
    unseen_s : float
        Time since it was measured.
    """

    identity: int
    estimate: Estimate | None
    ellipse: Array
    frames: int
    unseen_s: float = 0.0

    @property
    def confirmed(self) -> bool:
        """Whether it was measured in at least three frames; before, it may be a false positive of one image."""
        return self.frames >= _CONFIRMED


@dataclass(eq=False)
class _Track:
    identity: int
    dark: bool
    motion: EllipseMotion
    seen_s: float
    normals: NormalMotion = field(default_factory=NormalMotion)
    frames: int = 0
    estimate: Estimate | None = None


class Tracker:
    """Follow the markers of a video.

    - Birth: a contour with a confidence of at least 0.5 that belongs to no track.
    - Measured: where it is predicted; a marker that is not found there, among the circles of the whole image.
    - Death: after `memory_s` out of sight; before it was measured three times, after one frame.
    - The whole image is searched every `search_every` frames, in every frame while there is no track or one that is not
      confirmed, and ten times a second while a marker is out of sight.

    Parameters
    ----------
    diameter_m : float
        Outer diameter of the printed circles; pass 1 if it is unknown to get lengths in diameters.
    camera : Camera or UncertainCamera, optional
        As for `locate`.
    curve : str or ResponseCurve, optional
        As for `locate`; estimated from the circles until they tell it, and then kept for all further frames.
    knowledge : str, Evidence, a sequence of them, or None
        Further knowledge of the pose, see `choose`; it is taken as the same knowledge in every frame.
    memory_s : float
        How long a marker that is out of sight keeps its identity.
    search_every : int
    weights : (float, float, float)
        Of the channels of a colour image, in their order.

    Examples
    --------
    >>> import numpy as np
    >>> import roundel
    >>> tracker = roundel.Tracker(diameter_m=0.08)
    >>> y, x = np.mgrid[:120, :160]
    >>> for shift in range(3):
    ...     disc = np.where(np.hypot((x - 70 - shift) / 1.2, y - 60) < 30, 40, 200).astype(np.uint8)
    ...     markers = tracker.update(disc, time_s=shift / 30)
    >>> [(m.identity, m.frames, m.estimate.chosen) for m in markers]
    [(0, 3, None)]
    """

    def __init__(
        self,
        diameter_m: float,
        camera: Camera | UncertainCamera | None = None,
        curve: ResponseCurve | str | None = None,
        knowledge: Knowledge = None,
        *,
        memory_s: float = 1.0,
        search_every: int = 10,
        weights: tuple[float, float, float] = EQUAL,
    ) -> None:
        self._diameter_m = checked_diameter(diameter_m)
        check_knowledge(knowledge)
        self._camera, self._knowledge, self._weights = camera, knowledge, weights
        wanted = parse_curve(curve) if isinstance(curve, str) else curve
        self._curve = wanted if wanted is not None and wanted.known else None
        self._memory_s, self._search_every = memory_s, search_every
        self._tracks: list[_Track] = []
        self._next = 0
        self._frame = -1
        self._time_s = 0.0
        self._search = -search_every
        self._search_s = -math.inf

    @one_blas_thread()
    def update(self, image: NDArray[Any], time_s: float | None = None) -> list[TrackedMarker]:
        """Take up the next frame.

        Parameters
        ----------
        image : (H, W) or (H, W, C) array
            As for `locate`.
        time_s : float, optional
            Time of the frame, of any origin; default: 1/30 s after the last one.

        Returns
        -------
        list of TrackedMarker
            In the order of their identities; those out of sight included, without an estimate.

        Raises
        ------
        ValueError
            If the image or the camera is invalid, or the time is not after that of the last frame.
        """
        grey, full_scale_dn, photometry = self._grey(image)
        label, uncertain = camera_of_image(self._camera, grey.shape[1], grey.shape[0])
        after_s = self._advanced(time_s)
        for track in self._tracks:
            track.motion, track.estimate = track.motion.after(after_s), None
        seen = Detections(grey, full_scale_dn, self._followed(grey, full_scale_dn), photometry)
        if self._should_search(len(seen.detections)):
            seen = self._searched(image, seen)
        tracks, detections = self._tracks, seen.detections
        pairs = assign(
            [t.motion for t in tracks],
            [t.dark for t in tracks],
            [d.edges.ellipse for d in detections],
            [_is_dark(d) for d in detections],
        )
        known = {j: tracks[i] for i, j in pairs.items()}
        measured = 0
        for j, detection in enumerate(detections):
            own = known.get(j)
            if own is None and detection.confidence < _CONFIDENT:
                continue
            if own is None:
                motion = EllipseMotion.begin(detection.edges.ellipse, float(uncertain.camera.K[0, 0]))
                own = _Track(self._next, _is_dark(detection), motion, self._time_s)
                self._next += 1
                tracks.append(own)
            key = EstimateKey(self._frame, measured, DEFAULT_METHOD, label)
            self._measure(own, seen, detection, uncertain, key)
            measured += 1
        self._tracks = [t for t in tracks if self._lives(t)]
        return [self._told(track) for track in self._tracks]

    def _grey(self, image: NDArray[Any]) -> tuple[NDArray[np.float32], float, Photometry]:
        """Grey levels, the level at which they saturate, and how they came about."""
        curve, pixels = self._curve or UNKNOWN, np.asarray(image)
        grey, full_scale_dn = grey_levels(pixels, curve, weights=self._weights)
        rounding = level_step(pixels, full_scale_dn), averaged_rounding(pixels, self._weights)
        return grey, full_scale_dn, Photometry(curve, full_scale_dn, *rounding)

    def _searched(self, image: NDArray[Any], followed: Detections) -> Detections:
        """The markers of the whole image beside those that were followed; they may tell the curve."""
        self._search, self._search_s = self._frame, self._time_s
        found = list(followed.detections)
        for one in detect_circles(followed.grey, followed.full_scale_dn, own_ellipses=False).detections:
            if not any(same_contour(one.edges.ellipse, other.edges.ellipse) for other in found):
                found.append(one)
        seen = replace(followed, detections=found)
        if self._curve is None and found:
            seen = with_estimated_curve(seen, lambda curve: grey_levels(image, curve, weights=self._weights))
            self._curve = seen.photometry.curve if seen.photometry.curve.known else None
        return seen

    def _advanced(self, time_s: float | None) -> float:
        first = self._frame < 0
        now = self._time_s + (0.0 if first else 1.0 / _RATE_HZ) if time_s is None else float(time_s)
        if not math.isfinite(now) or (not first and now <= self._time_s):
            raise ValueError(
                f"the time of a frame must be after that of the last one ({self._time_s} s), not {time_s!r}"
            )
        after_s = 0.0 if first else now - self._time_s
        self._frame, self._time_s = self._frame + 1, now
        return after_s

    def _followed(self, grey: NDArray[Any], full_scale_dn: float) -> list[Detection]:
        """The contours at the predicted ellipses."""
        out: list[Detection] = []
        noise = noise_dn(grey) if self._tracks else 0.0
        for track in self._tracks:
            predicted = track.motion.ellipse
            if predicted is None:
                continue
            edges = edge_points(grey, predicted, full_scale_dn, polish=False)
            if isinstance(edges, FailedFit) or not is_circle_image(edges, noise, full_scale_dn, _ROUGH_PX):
                continue
            if not any(same_contour(edges.ellipse, one.edges.ellipse) for one in out):
                visible = visible_fraction(edges.ellipse, grey.shape)
                confidence = confidence_of(edges, noise, full_scale_dn, visible)
                out.append(Detection(edges, confidence=confidence, visible=visible))
        return out

    def _should_search(self, followed: int) -> bool:
        if self._frame - self._search >= self._search_every:
            return True
        if not self._tracks or any(t.frames < _CONFIRMED for t in self._tracks):
            return True
        return followed < len(self._tracks) and self._time_s - self._search_s >= _SEARCH_S

    def _measure(
        self, track: _Track, seen: Detections, detection: Detection, uncertain: UncertainCamera, key: EstimateKey
    ) -> None:
        motion = motions_of(uncertain, detection.edges.ellipse[None], self._diameter_m / 2)[0]
        fit = fit_detection(seen, detection, uncertain.camera, DEFAULT_METHOD, motion)
        (posed,) = poses_of_fits([fit], uncertain, self._diameter_m / 2)
        estimate = estimate_of(fit, posed, uncertain, self._knowledge, key, detection, seen)
        shape_cov = fit.shape_cov if isinstance(fit, EllipseFit) and np.all(np.isfinite(fit.shape_cov)) else None
        if track.frames:
            track.motion = track.motion.seen(detection.edges.ellipse, shape_cov)
        if estimate and estimate.normal is not None and estimate.cov is not None:
            known = estimate.probability or (0.5, 0.5)
            odds = min(max(math.log(max(known[0], 1e-9) / max(known[1], 1e-9)), -_CERTAIN), _CERTAIN)
            after_s = self._time_s - track.seen_s
            track.normals.update(estimate.normal, self._noise_of(fit, estimate.cov, uncertain), after_s, odds)
            estimate = _chosen(estimate, track.normals.probability, self._knowledge is not None)
        track.seen_s, track.frames = self._time_s, track.frames + 1
        track.estimate = replace(estimate, track_id=track.identity)

    def _noise_of(self, fit: EllipseFit | FailedFit, cov: Array, uncertain: UncertainCamera) -> Array:
        """Covariance (2, 3, 3) of both normals by this frame's noise: the camera's errors are those of all frames."""
        if isinstance(fit, EllipseFit) and not uncertain.is_exact:
            (posed,) = poses_of_fits([fit], uncertain.as_exact(), self._diameter_m / 2)
            cov = cov if isinstance(posed, FailedFit) or posed[1] is None else posed[1]
        return cov[:, 3:, 3:]

    def _lives(self, track: _Track) -> bool:
        if track.motion.ellipse is None:
            return False
        return self._time_s - track.seen_s <= (self._memory_s if track.frames >= _CONFIRMED else 0.0)

    def _told(self, track: _Track) -> TrackedMarker:
        ellipse = track.motion.ellipse
        assert ellipse is not None, "such a track has ended"
        return TrackedMarker(track.identity, track.estimate, ellipse, track.frames, self._time_s - track.seen_s)


def _is_dark(detection: Detection) -> bool:
    return detection.edges.contrast_dn > 0


def _chosen(estimate: Estimate, probability: tuple[float, float], informed: bool) -> Estimate:
    best = int(probability[1] > probability[0])
    source = "the motion so far and what was declared" if informed else "the motion so far"
    if probability[best] < _SETTLED:
        basis = f"the candidates are not told apart by {source}"
        return replace(estimate, probability=probability, chosen=None, choice_basis=basis)
    basis = f"from {source}; the other candidate turns less smoothly"
    return replace(estimate, probability=probability, chosen=best, choice_basis=basis)
