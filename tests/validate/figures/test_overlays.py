"""Overlays of frames whose truth was altered."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers_reports import POINTS, make_dataset

from roundel.validate.figures import overlays


@pytest.mark.parametrize("value", [1e300, -1e19, np.inf, np.nan])
def test_a_contour_that_is_nowhere_is_left_out(value: float, tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "ds", POINTS.replace("frames_per_cell: 4", "frames_per_cell: 1"))
    row = {"frame_id": dataset.images.frame_ids[0], "marker_id": 0}
    truth = np.array([[100.0, 100.0], [140.0, 100.0], [140.0, 140.0], [value, 120.0]])
    shown = overlays._svg(dataset, row, truth, None)
    assert shown.startswith('<svg class="overlay" viewBox="')
    assert shown == overlays._svg(dataset, row, truth[:3], None).replace("<polygon", "<polyline").replace(
        "</polygon>", "</polyline>"
    )
    assert overlays._svg(dataset, row, np.full((4, 2), value), None) == ""
