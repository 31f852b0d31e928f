"""Concentric circles in one plane, under perspective."""

from __future__ import annotations

import numpy as np

from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic
from roundel.solver.detect.concentric import concentric, outer_contours

K = np.array([[800.0, 0.0, 320.0], [0.0, 800.0, 240.0], [0.0, 0.0, 1.0]])


def circle(radius_m, offset_m=0.0, tilt_deg=50.0):
    c, s = np.cos(np.radians(tilt_deg)), np.sin(np.radians(tilt_deg))
    pose = np.eye(4)
    pose[:3, :3] = [[1, 0, 0], [0, c, -s], [0, s, c]]
    pose[:3, 3] = pose[:3, :3] @ [offset_m, 0.0, 0.0] + [0.02, -0.03, 0.4]
    return np.asarray(ellipse_of_conic(conic_of_circle(pose, radius_m, K)))


def test_rings_are_concentric_and_holes_off_the_centre_are_not():
    outer = circle(0.05)
    for ratio in (0.2, 0.5, 0.9):
        assert concentric(outer, circle(0.05 * ratio), 0.5)
    # An offset of a quarter of the radius, in the plane and along its short axis in the image.
    assert not concentric(outer, circle(0.02, 0.0125), 0.5)
    assert not concentric(circle(0.02), outer, 0.5)


def test_a_concentric_ellipse_that_is_no_circle_of_the_plane():
    outer, inner = circle(0.05), circle(0.03)
    inner[3] *= 0.8
    assert not concentric(outer, inner, 0.5)


def test_the_outermost_contour_of_each():
    ellipses = np.array([circle(0.05), circle(0.03), [500.0, 100.0, 30.0, 20.0, 0.0], circle(0.01)])
    assert outer_contours(ellipses, np.full(4, 0.5)).tolist() == [0, 0, 2, 0]
