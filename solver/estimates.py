"""Estimates as records: one detection in memory, one row for each candidate in `estimates.parquet`.

The validator imports this module, so it imports no other module of the solver.
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from roundel.datasets.store.writing import sha256, write_file
from roundel.scenes.camera.model import Camera
from roundel.scenes.geometry.conic import Ellipse
from roundel.scenes.geometry.pose import tilt_azimuth_deg

if TYPE_CHECKING:
    import pyarrow as pa

Array = NDArray[np.float64]

ESTIMATES = "estimates.parquet"
CHECKSUM = ".sha256"  # ending of the file beside it with its checksum, as `sha256sum` writes it
METADATA = b"roundel_estimates"  # the file's metadata: {schema, dataset_id, images_sha256}
NOT_FOUND = -1  # the detection_id of a frame in which nothing was found

_COVARIANCE = [(i, j) for i in range(6) for j in range(i, 6)]
_POSE = ("normal_x", "normal_y", "normal_z", "centre_x_m", "centre_y_m", "centre_z_m")
_ELLIPSE = ("ellipse_x_px", "ellipse_y_px", "ellipse_a_px", "ellipse_b_px", "ellipse_angle_deg")
_CENTRE_IMAGE = ("centre_image_x_px", "centre_image_y_px")
_INTRINSICS = ("fx_px", "fy_px", "skew_px", "cx_px", "cy_px")


class EstimateKey(NamedTuple):
    """The identity of an estimate; the first fields of `Estimate`."""

    frame_id: int
    detection_id: int
    method: str
    intrinsics: str


@dataclass(frozen=True, eq=False, repr=False)
class Estimate:
    """The result of one method with one kind of intrinsics for one detection.

    Attributes
    ----------
    frame_id, detection_id : int
        `detection_id` is -1 if nothing was found in the frame.
    method, intrinsics : str
    status : str
        `ok` or `failed`; if failed, `reason` gives the cause, and unknown fields are None.
    ellipse : Ellipse or None
        In undistorted pixel coordinates of `camera`.
    camera : Camera or None
        The intrinsics that were used.
    normal, centre_m : (2, 3) array or None
        Both candidates, in the order of `CirclePoses`; (1, 3) from a method that gives one, None if it gives none.
    centre_image : (2,) array or None
        Image of the circle's centre in the delivered image, if the method gives it.
    probability : tuple of two floats, or None
    chosen : int or None
        The chosen candidate; None without prior knowledge.
    edge_points : int or None
    edge_sigma_px : float or None
        RMS of the fit's residual along the normal.
    blur_px, contrast_dn : float or None
        Gaussian sigma of the edge's blur excluding the pixel's aperture, and the step outside minus inside; only for
        estimates from an image.
    confidence : float or None
        Confidence that this is the image of a circle, 0 to 1; see `solver.detect`.
    clipped_fraction, rejected_fraction : float or None
        Fraction of the edge's pixels that are clipped, and of the contour that was left out because it does not follow
        the model (occluder, shadow, highlight).
    misfit : float or None
        Reduced chi-square of the edge's pixels: 1 if they deviate from the model by their noise alone. If it is more
        than chance, it is included in `cov`.
    fit_used : str
        The fit of the ellipse; if it is not the requested one, followed by the reason: `ml: too few pixels ...`.
    curve : str
        The response curve that was undone and how it is known: `srgb: estimated from the edges of 3 contours`.
    caveats : tuple of str
        What the model did not hold for, one short sentence each; in a table joined by semicolons.
    focal_sigma : float or None
        Standard deviation of the assumed focal length, as a fraction of it; included in `cov`.
    intrinsics_basis, choice_basis : str
        The basis of the camera and of the probabilities, as text.
    cov : (2, 6, 6) array or None
        Covariance of (centre x, y, z in m, normal x, y, z) of each candidate; rank 5.
    track_id : int or None
        Identity of the marker from frame to frame; only for estimates from a video.
    identity : int or None
        What the marker's code says.
    focal_px, focal_sigma_px : float or None
        Focal length that the method measured from the image alone, and its standard deviation.
    """

    frame_id: int
    detection_id: int
    method: str
    intrinsics: str
    status: str
    reason: str = ""
    ellipse: Ellipse | None = None
    camera: Camera | None = None
    normal: Array | None = None
    centre_m: Array | None = None
    probability: tuple[float, float] | None = None
    chosen: int | None = None
    edge_points: int | None = None
    edge_sigma_px: float | None = None
    cov: Array | None = None
    blur_px: float | None = None
    contrast_dn: float | None = None
    confidence: float | None = None
    focal_sigma: float | None = None
    intrinsics_basis: str = ""
    choice_basis: str = ""
    centre_image: Array | None = None
    clipped_fraction: float | None = None
    rejected_fraction: float | None = None
    misfit: float | None = None
    fit_used: str = ""
    curve: str = ""
    caveats: tuple[str, ...] = ()
    track_id: int | None = None
    identity: int | None = None
    focal_px: float | None = None
    focal_sigma_px: float | None = None

    def __bool__(self) -> bool:
        return self.status == "ok"

    def __repr__(self) -> str:
        """A line for the detection, and one for each candidate; as a notebook shows it."""
        where = f"frame {self.frame_id}, {self.method}, {self.intrinsics}"
        if not self:
            return f"<Estimate of {where}: {self.status}, {self.reason or 'no reason given'}>"
        lines = [f"<Estimate of {where}"]
        if self.ellipse is not None:
            x, y, a, b, angle = self.ellipse
            lines.append(f"  ellipse: centre ({x:.2f}, {y:.2f}) px, semi-axes {a:.2f} and {b:.2f} px, {angle:.1f} deg")
        if self.distance_m is not None and self.tilt_deg is not None:
            for i, (distance_m, tilt_deg) in enumerate(zip(self.distance_m, self.tilt_deg, strict=True)):
                likely = "" if self.probability is None else f", probability {self.probability[i]:.2g}"
                chosen = ", chosen" if self.chosen == i else ""
                lines.append(f"  pose {i}: distance {distance_m:.4g} m, tilt {tilt_deg:.2f} deg{likely}{chosen}")
        lines += [f"  caveat: {caveat}" for caveat in self.caveats]
        return "\n".join(lines) + ">"

    @property
    def distance_m(self) -> Array | None:
        """Distance of the circle's centre from the camera centre for each candidate, (2,) m; None without poses."""
        return None if self.centre_m is None else np.linalg.norm(self.centre_m, axis=1)

    @property
    def tilt_deg(self) -> Array | None:
        """Angle between -normal and the optical axis for each candidate, (2,) degrees; None without poses."""
        return None if self.normal is None else tilt_azimuth_deg(self.normal)[0]

    def rows(self) -> list[dict[str, Any]]:
        """Rows of `estimates.parquet`: one per candidate; one for a failure or an estimate without a pose."""
        count = len(self.normal) if self and self.normal is not None else 1
        return [self._row(candidate) for candidate in range(count)]

    def _row(self, candidate: int) -> dict[str, Any]:
        row: dict[str, Any] = {
            "frame_id": self.frame_id,
            "detection_id": self.detection_id,
            "method": self.method,
            "intrinsics": self.intrinsics,
            "candidate": candidate,
            "chosen": self.chosen == candidate,
            "probability": None if self.probability is None else self.probability[candidate],
            "edge_points": self.edge_points,
            "edge_sigma_px": self.edge_sigma_px,
            "blur_px": self.blur_px,
            "contrast_dn": self.contrast_dn,
            "confidence": self.confidence,
            "clipped_fraction": self.clipped_fraction,
            "rejected_fraction": self.rejected_fraction,
            "misfit": self.misfit,
            "fit_used": self.fit_used or None,
            "curve": self.curve or None,
            "caveats": "; ".join(self.caveats) or None,
            "focal_sigma": self.focal_sigma,
            "intrinsics_basis": self.intrinsics_basis,
            "choice_basis": self.choice_basis,
            "track_id": self.track_id,
            "identity": self.identity,
            "focal_px": self.focal_px,
            "focal_sigma_px": self.focal_sigma_px,
            "status": self.status,
            "reason": self.reason,
        }
        if self.normal is not None and self.centre_m is not None:
            row |= zip(_POSE, (*self.normal[candidate].tolist(), *self.centre_m[candidate].tolist()), strict=True)
        if self.ellipse is not None:
            row |= zip(_ELLIPSE, self.ellipse, strict=True)
        if self.centre_image is not None:
            row |= zip(_CENTRE_IMAGE, self.centre_image.tolist(), strict=True)
        if self.camera is not None:
            k = self.camera.K
            values = (k[0, 0], k[1, 1], k[0, 1], k[0, 2], k[1, 2])
            row |= zip(_INTRINSICS, map(float, values), strict=True)
            row["distortion"] = list(self.camera.distortion)
            row["distortion_model"] = self.camera.distortion_model
        if self.cov is not None and np.all(np.isfinite(self.cov[candidate])):
            row |= {f"cov_{i}{j}": float(self.cov[candidate, i, j]) for i, j in _COVARIANCE}
        return row


@cache
def estimates_schema(dataset_id: str | None = None, images_sha256: str | None = None) -> pa.Schema:
    """The schema, with the identity of the dataset and the checksum of its images as metadata, if there are any."""
    import pyarrow as pa  # as long to import as all of OpenCV, and `locate` writes no file

    schema = pa.schema(
        [
            pa.field("frame_id", pa.int64(), nullable=False),
            pa.field("detection_id", pa.int64(), nullable=False),
            pa.field("method", pa.string(), nullable=False),
            pa.field("intrinsics", pa.string(), nullable=False),
            pa.field("candidate", pa.int8(), nullable=False),
            pa.field("chosen", pa.bool_(), nullable=False),
            pa.field("probability", pa.float64()),
            *(pa.field(name, pa.float64()) for name in (*_POSE, *_ELLIPSE, *_CENTRE_IMAGE, *_INTRINSICS)),
            pa.field("distortion", pa.list_(pa.float64())),
            pa.field("distortion_model", pa.string()),
            pa.field("edge_points", pa.int64()),
            pa.field("edge_sigma_px", pa.float64()),
            pa.field("blur_px", pa.float64()),
            pa.field("contrast_dn", pa.float64()),
            pa.field("confidence", pa.float64()),
            pa.field("clipped_fraction", pa.float64()),
            pa.field("rejected_fraction", pa.float64()),
            pa.field("misfit", pa.float64()),
            pa.field("fit_used", pa.string()),
            pa.field("curve", pa.string()),
            pa.field("caveats", pa.string()),
            pa.field("focal_sigma", pa.float64()),
            pa.field("intrinsics_basis", pa.string()),
            pa.field("choice_basis", pa.string()),
            pa.field("track_id", pa.int64()),
            pa.field("identity", pa.int64()),
            pa.field("focal_px", pa.float64()),
            pa.field("focal_sigma_px", pa.float64()),
            *(pa.field(f"cov_{i}{j}", pa.float64()) for i, j in _COVARIANCE),
            pa.field("status", pa.string(), nullable=False),
            pa.field("reason", pa.string(), nullable=False),
        ]
    )
    if dataset_id is None:
        return schema
    about = {"schema": 1, "dataset_id": dataset_id}
    if images_sha256 is not None:
        about["images_sha256"] = images_sha256
    return schema.with_metadata({METADATA: json.dumps(about).encode()})


def estimates_table(estimates: Iterable[Estimate], dataset_id: str | None = None) -> pa.Table:
    """Estimates as a table with the columns of `estimates.parquet`."""
    import pyarrow as pa

    schema = estimates_schema(dataset_id)
    rows = [row for estimate in estimates for row in estimate.rows()]
    return pa.table({name: [row.get(name) for row in rows] for name in schema.names}, schema=schema)


def write_estimates(estimates: Iterable[Estimate], path: str | Path, dataset_id: str | None = None) -> None:
    """Write estimates as Parquet, atomically; those of a dataset with their checksum beside them.

    Parameters
    ----------
    estimates : iterable of Estimate
    path : path
    dataset_id : str, optional
        Identity of their dataset; stored in the file, so that they are scored only against that dataset.

    Raises
    ------
    DataError
        If the file cannot be written.
    """
    import pyarrow.parquet as pq

    buffer = io.BytesIO()
    pq.write_table(estimates_table(estimates, dataset_id), buffer)
    data, path = buffer.getvalue(), Path(path)
    write_file(path, data)
    if dataset_id is not None:
        write_file(path.with_name(path.name + CHECKSUM), f"{sha256(data)}  {path.name}\n".encode())
