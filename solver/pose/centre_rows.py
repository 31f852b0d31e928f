"""The poses of an ellipse that moves while the rows are read: each at the row that images its circle's centre."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera, distort_px
from roundel.solver.fit.ellipse import ellipse_of_shape, shape_of_ellipse
from roundel.solver.pose.circle_pose import CirclePoses
from roundel.solver.pose.pose_covariance import poses_with_covariance
from roundel.solver.pose.pose_curvature import curved_covariance

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MovingEllipse:
    """An ellipse, its rates, and how well both are known together.

    Attributes
    ----------
    ellipse : (5,) array
        At the time of the row `row_zero_px`.
    rates : (5,) array
        Of its x, y, S11, S12, S22, px/s.
    shape_cov : (5, 5) array
        Of the shape.
    rates_cov : (5, 10) array
        Of the rates with the shape, and with themselves.
    row_zero_px, row_s : float
        The row, or column, and the delay from one to the next.
    along_x : bool
        Whether the sensor's rows are columns of the image.
    """

    ellipse: Array
    rates: Array
    shape_cov: Array
    rates_cov: Array
    row_zero_px: float
    row_s: float
    along_x: bool

    def at(self, row_px: float) -> tuple[Array, Array]:
        """Ellipse (5,) and covariance (5, 5) of its shape at the time of a row."""
        time_s = (row_px - self.row_zero_px) * self.row_s
        shape = shape_of_ellipse(self.ellipse) + time_s * self.rates
        crossed, own = time_s * self.rates_cov[:, :5], time_s**2 * self.rates_cov[:, 5:]
        return ellipse_of_shape(shape), self.shape_cov + crossed + crossed.T + own


def poses_at_centre_rows(
    poses: CirclePoses,
    moving: MovingEllipse,
    camera: Camera,
    radius_m: float,
    focal_sigma: float,
    principal_sigma_px: float,
) -> tuple[CirclePoses, Array | None]:
    """Both poses and their covariance, each at mid-exposure of its own centre's row; these differ by some rows.

    Parameters
    ----------
    poses : CirclePoses
        Of the ellipse at its own time.
    moving : MovingEllipse
    camera, radius_m, focal_sigma, principal_sigma_px
        See `poses_with_covariance`.

    Raises
    ------
    ValueError
        As `poses_with_covariance`.
    """
    normal, centre, covs = poses.normal.copy(), poses.centre_m.copy(), []
    for i in range(2):
        seen = camera.K @ poses.centre_m[i]
        row = float(distort_px(camera, (seen[:2] / seen[2])[None])[0, 0 if moving.along_x else 1])
        ellipse, shape_cov = moving.at(row if np.isfinite(row) else moving.row_zero_px)
        there, cov = poses_with_covariance(ellipse, shape_cov, camera.K, radius_m, focal_sigma, principal_sigma_px)
        if cov is None:
            return poses, None
        cov = curved_covariance(there, cov, ellipse, shape_cov, camera.K, radius_m)
        # The same candidate: near-frontal ones may change their order.
        same = int(np.argmax(there.normal @ poses.normal[i]))
        normal[i], centre[i] = there.normal[same], there.centre_m[same]
        covs.append(cov[same])
    return CirclePoses(normal, centre), np.stack(covs)
