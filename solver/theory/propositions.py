"""Propositions 1 to 3: the separation test for the vanishing line, in the image and in the plane.

The circle's plane contains F, the foot of the perpendicular from the camera's centre (height d), and the circle (centre
at ell from F, radius R). The virtual circle psi, the back-projected absolute conic, has centre F and radius i d. The
pencil of both circles has a radical axis l_o and two limiting points x1, x3. With F as origin and the axis toward the
centre:

    Q - psi = -2 ell x + ell^2 - R^2 - d^2   =>   l_o: x_o = (ell^2 - R^2 - d^2) / (2 ell),
    x1, x3 = the roots of m^2 - 2 x_o m - d^2 = 0:  m1 inside the circle, m3 = -d^2 / m1 beyond F.

- Proposition 1: l_o separates x1 and x3, the line at infinity does not. Proof: m1 + m3 = 2 x_o, the limiting points are
  symmetric about the radical axis.
- Proposition 2: in the image exactly one of both lines separates the images z1, z3: that of l_o if x1 and x3 are on the
  same side of the principal line L (depth zero), the vanishing line otherwise. Proof: with third coordinates scaled to
  1, (v.z1)(v.z3) = (l.x1)(l.x3) / (depth1 depth3). x1 is inside the circle, so in front: "both behind" never occurs.
- Proposition 3, with its inequality reversed: depth1 depth3 = sin^2(theta) E / ell^2, so they are on the same side of L
  if and only if E >= 0. (The paper prints <= 0, which is wrong for every configuration that was tried.)

E > 0 <=> the vanishing line does not separate z1, z3 <=> the true pose is candidate 0 of `CirclePoses`. An image cannot
decide this: candidate 0 always has E > 0 and candidate 1 always has E < 0. The propositions convert external knowledge
into a choice.

Source: the paper, section IV-B, with the corrections of the errata, section 3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.solver.theory.conic_pencil import ConicPencil

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]


def separates(line: ArrayLike, first: ArrayLike, second: ArrayLike) -> Bools:
    """Whether a line separates two points: (l.x1)(l.x2) < 0 with third coordinates scaled to 1.

    Parameters
    ----------
    line, first, second : (..., 3) array_like
        Homogeneous, of any scale and sign; the points are finite.

    Returns
    -------
    (...) array of bool
    """
    v, x, y = (np.asarray(a, dtype=np.float64) for a in (line, first, second))
    product = np.sum(v * x, axis=-1) * np.sum(v * y, axis=-1) * x[..., 2] * y[..., 2]
    return np.asarray(product < 0)


def separating_lines(pencil: ConicPencil) -> Bools:
    """Which of the two candidate lines separates the images of the limiting points (proposition 2).

    Exactly one does, always the second: v1,2 = a +- b with a, b > 0 times omega z1, omega z3, so that
    v1,2 . z1 = |a| > 0 and v1,2 . z3 = +- |b| for third coordinates that are positive.

    Returns
    -------
    (..., 2) array of bool
        (False, False) if the camera is on the circle's axis: both lines coincide, so there is no choice.
    """
    z1, z3 = pencil.base_point[..., None, 0, :], pencil.base_point[..., None, 2, :]
    return separates(pencil.line, z1, z3) & ~pencil.single[..., None]


@dataclass(frozen=True, eq=False)
class PlanePencil:
    """The pencil in the circle's plane, in the marker's frame.

    Attributes
    ----------
    foot_m : (..., 2) array
        F, the foot of the perpendicular from the camera's centre.
    ell_m, height_m : (...) arrays
        From F to the circle's centre, and from F to the camera.
    limiting_m : (..., 2) array
        m1 > 0 > m3: abscissae of the limiting points on the line from F toward the circle's centre.
    limiting_point_m : (..., 2, 2) array
        x1 and x3 in the marker's plane.
    radical_axis : (..., 3) array
        l_o, homogeneous, with unit normal.
    """

    foot_m: Array
    ell_m: Array
    height_m: Array
    limiting_m: Array
    limiting_point_m: Array
    radical_axis: Array


def plane_pencil(camera_from_marker: ArrayLike, radius_m: ArrayLike) -> PlanePencil:
    """Limiting points and radical axis of a circle viewed by a camera (errata, section 2).

    Parameters
    ----------
    camera_from_marker : (..., 4, 4) array_like
    radius_m : (...) array_like

    Returns
    -------
    PlanePencil

    Raises
    ------
    ValueError
        If a camera is on the axis of its circle: the circles are then concentric, the radical axis is the line at
        infinity, and the solution is unique.
    """
    foot, height = _foot(np.asarray(camera_from_marker, dtype=np.float64))
    radius = np.asarray(radius_m, dtype=np.float64)
    ell = np.hypot(foot[..., 0], foot[..., 1])
    if np.any(ell == 0.0):
        raise ValueError("the camera is on the axis of the circle: there is no radical axis, and only one pose")
    twice_x_o = (ell**2 - radius**2 - height**2) / ell
    root = np.hypot(twice_x_o, 2.0 * height)
    # The root without cancellation first, then the other from m1 m3 = -d^2.
    large = np.where(twice_x_o < 0, twice_x_o - root, twice_x_o + root) / 2.0
    m = np.stack([np.where(twice_x_o < 0, -(height**2) / large, large)] * 2, axis=-1)
    m[..., 1] = np.where(twice_x_o < 0, large, -(height**2) / large)
    toward = -foot / ell[..., None]
    points = foot[..., None, :] + m[..., None] * toward[..., None, :]
    offset = twice_x_o / 2.0 + np.sum(toward * foot, axis=-1)
    return PlanePencil(foot, ell, height, m, points, np.concatenate([toward, -offset[..., None]], axis=-1))


def depth_product(camera_from_marker: ArrayLike, radius_m: ArrayLike) -> Array:
    """ell^2 depth1 depth3, metres^4: positive if both limiting points are in front of the camera.

    A plane point at m from F toward the centre has the depth d_F + (m / ell)(d_c - d_F). With m1 + m3 = 2 x_o and
    m1 m3 = -d^2 the product of two of them is a polynomial: no root, no division, and no exception on the axis.
    It has the sign of E wherever E exists, and is also defined if the optical axis misses the plane.

    Parameters
    ----------
    camera_from_marker : (..., 4, 4) array_like
    radius_m : (...) array_like
    """
    m = np.asarray(camera_from_marker, dtype=np.float64)
    foot, height = _foot(m)
    ell2 = np.sum(foot**2, axis=-1)
    at_foot = -m[..., 2, 2] * height  # foot = camera - height normal
    rise = m[..., 2, 3] - at_foot
    twice_x_o_ell = ell2 - np.asarray(radius_m, dtype=np.float64) ** 2 - height**2
    return np.asarray(ell2 * at_foot**2 + twice_x_o_ell * rise * at_foot - (rise * height) ** 2)


@dataclass(frozen=True, eq=False)
class PlaneView:
    """A circle in the frame of proposition 3, lengths in units of the camera's distance to q.

    q, the intersection of optical axis and plane, is the origin. X is parallel to the principal line L:
    Y = -1 / cos theta (the printed vector d = [0, 1, cos theta] must be [0, cos theta, 1]); Y is the optical axis
    projected on the plane; the camera is at (0, -cos theta, sin theta), theta in ]0, 90] degrees. theta is 90 degrees
    minus `tilt_deg`.

    Attributes
    ----------
    cos_theta, sin_theta : (...) arrays
    x_c, y_c : (...) arrays
        The circle's centre.
    radius : (...) array
    """

    cos_theta: Array
    sin_theta: Array
    x_c: Array
    y_c: Array
    radius: Array


def plane_view(camera_from_marker: ArrayLike, radius_m: ArrayLike) -> PlaneView:
    """The frame of proposition 3 for a marker's pose.

    Parameters
    ----------
    camera_from_marker : (..., 4, 4) array_like
    radius_m : (...) array_like

    Raises
    ------
    ValueError
        If the optical axis does not meet the plane in front of the camera (tilt of 90 degrees or more): there is no q.
    """
    m = np.asarray(camera_from_marker, dtype=np.float64)
    foot, height = _foot(m)
    sin = -m[..., 2, 2] * np.sign(height)
    if not np.all(sin > 0):
        raise ValueError("the optical axis does not meet the marker's plane in front of the camera; use depth_product")
    reach = np.abs(height) / sin
    axis = m[..., 2, :2]  # the optical axis in the plane, of length cos theta
    cos = np.hypot(axis[..., 0], axis[..., 1])
    upward = np.stack([np.zeros_like(cos), np.ones_like(cos)], axis=-1)  # tilt 0: any direction is valid
    y_axis = np.where(cos[..., None] > 0, axis / np.where(cos > 0, cos, 1.0)[..., None], upward)
    from_q = -foot / reach[..., None] - axis  # the marker's origin minus q = F + reach axis
    y_c = np.sum(from_q * y_axis, axis=-1)
    x_c = from_q[..., 0] * y_axis[..., 1] - from_q[..., 1] * y_axis[..., 0]
    return PlaneView(cos, sin, x_c, y_c, np.asarray(radius_m, dtype=np.float64) / reach)


def criterion(view: PlaneView) -> Array:
    """E of proposition 3: the limiting points are on the same side of L if and only if E >= 0 (printed: <= 0).

    E = (1 + c yc)(xc^2 + yc^2 + c yc) - c R^2 (yc + c) with c = cos theta, which is the printed left-hand side:
    c (yc^2 - R^2)(yc + c) + c yc (1 + xc^2) + xc^2 + yc^2. Proof: multiply out ell^2 depth1 depth3 with
    depth = 1 + c Y, ell^2 = xc^2 + (yc + c)^2, d = sin theta; the result is sin^2(theta) E.
    """
    c, x, y = view.cos_theta, view.x_c, view.y_c
    return np.asarray((1.0 + c * y) * (x * x + y * y + c * y) - c * view.radius**2 * (y + c))


def sufficient_conditions(view: PlaneView) -> tuple[Bools, Bools]:
    """The paper's conditions (i) and (ii); both together imply E > 0, neither does alone.

    (i) q and F are on the same side of L', the parallel to L through the circle's centre: yc > 0 or yc < -c.
    (ii) (0, yc) is outside the circle about q with the circle's radius: yc^2 > R^2.

    Proof: for yc > 0, E = c (yc^2 - R^2)(yc + c) + positive terms. For yc < -c both terms of the factored E are
    positive, with or without (ii): 1 + c yc is the depth of the centre, yc^2 + c yc = yc (yc + c). (The text after
    proposition 3 reaches the right conclusion by two errors that cancel.)
    """
    y = view.y_c
    return np.asarray((y > 0) | (y < -view.cos_theta)), np.asarray(y * y > view.radius**2)


def outside_thales_disc(view: PlaneView) -> Bools:
    """E > 0 in the limit of a small marker: its centre is outside the disc with diameter [F, q].

    R -> 0 leaves (1 + c yc)(xc^2 + yc^2 + c yc), and 1 + c yc is the depth of the centre: positive.
    """
    return np.asarray(view.x_c**2 + view.y_c**2 + view.cos_theta * view.y_c > 0)


def minor_axis(ellipse: ArrayLike) -> Array:
    """Unit vector (..., 2) along the minor axis of an ellipse (..., 5)."""
    angle = np.radians(np.asarray(ellipse, dtype=np.float64)[..., 4])
    return np.stack([-np.sin(angle), np.cos(angle)], axis=-1)


def minor_axis_offset_px(ellipse: ArrayLike, principal_point_px: ArrayLike) -> Array:
    """Distance from the principal point to the ellipse's centre along its minor axis: |m . (x_e - pp)|, px.

    The reliability guard: E is near zero, and knowledge of its sign of little use, unless this exceeds the error of the
    principal point plus a few sigma_centre = sigma sqrt(2 / N) (errata, section 3, "Decision procedure", 4).

    Parameters
    ----------
    ellipse : (..., 5) array_like
    principal_point_px : (..., 2) array_like
    """
    offset = np.asarray(ellipse, dtype=np.float64)[..., :2] - np.asarray(principal_point_px, dtype=np.float64)
    return np.asarray(np.abs(np.sum(minor_axis(ellipse) * offset, axis=-1)))


def approaches_vanishing_line(ellipse: ArrayLike, vanishing_line: ArrayLike, principal_point_px: ArrayLike) -> Bools:
    """E > 0 from the image: the direction from principal point to ellipse along the minor axis approaches the line.

    (v_xy . m)(m . (x_e - pp)) < 0 with v > 0 on the ellipse; for square pixels. Numerical evidence only (errata,
    section 3, "Image form": 100 % of the cases tried).

    Parameters
    ----------
    ellipse : (..., 5) array_like
    vanishing_line : (..., 3) array_like
        Of any scale and sign.
    principal_point_px : (..., 2) array_like

    Returns
    -------
    (...) array of bool
    """
    e, v = np.asarray(ellipse, dtype=np.float64), np.asarray(vanishing_line, dtype=np.float64)
    m = minor_axis(e)
    on_ellipse = np.sum(v[..., :2] * e[..., :2], axis=-1) + v[..., 2]
    slope = np.sum(v[..., :2] * m, axis=-1) * np.sign(on_ellipse)
    offset = np.sum(m * (e[..., :2] - np.asarray(principal_point_px, dtype=np.float64)), axis=-1)
    return np.asarray(slope * offset < 0)


def _foot(camera_from_marker: Array) -> tuple[Array, Array]:
    """F (..., 2) in the marker's plane and the camera's height (...) above it."""
    rotation, centre = camera_from_marker[..., :3, :3], camera_from_marker[..., :3, 3]
    camera = -np.sum(rotation * centre[..., None], axis=-2)
    return camera[..., :2], camera[..., 2]
