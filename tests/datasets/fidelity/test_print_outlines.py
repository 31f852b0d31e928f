"""Outlines of a print against its reflectance: every point is the wall plus the steps of the edges around it."""

import numpy as np
import pytest
from helpers_markers import sheet

from roundel.datasets.fidelity.print_outlines import outlines_of
from roundel.scenes.markers.ink_pattern import reflectance_at


def encloses(outline, x, y):
    if outline.corners_m is None:
        return np.hypot(x - outline.x_m, y - outline.y_m) < outline.radius_m
    corners = outline.corners_m
    sides = np.roll(corners, -1, axis=0) - corners
    return np.all([s[0] * (y - c[1]) - s[1] * (x - c[0]) > 0 for c, s in zip(corners, sides, strict=True)], axis=0)


@pytest.mark.parametrize("kind", ["disc", "disc_with_tick", "rings", "disc_with_chessboard", "disc_with_charuco"])
def test_the_steps_add_up_to_the_reflectance(kind):
    printed = sheet(kind)
    border, edges = outlines_of(printed)
    rng = np.random.default_rng(1)
    x, y = (rng.uniform(low, high, 2000) for low, high in zip(printed.low_m, printed.high_m, strict=True))
    total = printed.wall + sum(edge.step * encloses(edge, x, y) for edge in [border, *edges])
    np.testing.assert_allclose(total, reflectance_at(printed, x, y), atol=1e-12)
