"""Bounds of frames: the truth that they need, and one clear line if it is missing."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from helpers_reports import POINTS, estimate_rows, make_dataset, write_estimates
from numpy.typing import NDArray

from roundel.datasets.dataset import Dataset
from roundel.scenes.errors import DataError
from roundel.scenes.geometry.conic import ellipse_perimeter_px
from roundel.scenes.geometry.edge_spread_function import PIXEL_VARIANCE
from roundel.scenes.geometry.information import contour_information, pose_bound
from roundel.validate.estimates.runs import read_runs
from roundel.validate.metrics.cramer_rao import bounds_of
from roundel.validate.metrics.ground_truth import columns_of, true_targets
from roundel.validate.scores.scores import score
from roundel.validate.scores.summary import summarise


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return make_dataset(tmp_path_factory.mktemp("points") / "ds", POINTS)


def with_column(dataset: Dataset, name: str, values: Any) -> Dataset:
    at = dataset.truth.column_names.index(name)
    return replace(dataset, kept_truth=dataset.truth.set_column(at, name, values))


def test_four_times_the_points_halve_every_bound(dataset: Dataset, tmp_path: Path) -> None:
    def counted(count: int) -> Any:
        text = POINTS.replace("frames_per_cell: 4", f"frames_per_cell: 1\npoints: {{count: {count}, sigma_px: 0.2}}")
        made = make_dataset(tmp_path / f"ds{count}", text)
        return bounds_of(made, true_targets(made, 3.0))

    few, many = counted(100), counted(400)
    for name in ("normal_deg", "position_m", "ellipse_centre_px"):
        np.testing.assert_allclose(getattr(few, name), 2 * getattr(many, name), rtol=1e-9)


def as_images(
    dataset: Dataset, contrast: float = 120.0, noise: float = 1.0, visible: float = 1.0, gain_dn_per_e: float = 0.0
) -> Dataset:
    """The same circles as images whose truth says so of their edges, a lens' blur of 0.4 px beside the pixel's own."""
    n, blur = dataset.truth.num_rows, math.sqrt(0.4**2 + PIXEL_VARIANCE)
    told = {"edge_contrast_dn": contrast, "edge_noise_dn": noise, "edge_blur_px": blur, "visible_fraction": visible}
    for name, value in told.items():
        dataset = with_column(dataset, name, pa.array([value] * n))
    sensor = {"shot_noise": gain_dn_per_e > 0, "curve": "linear", "gain_dn_per_e": gain_dn_per_e}
    records = [{**record, "sensor": sensor} for record in dataset.images.records]
    manifest = {**dataset.manifest, "groups": None, "study": {**dataset.study, "groups": {}}}
    return replace(dataset, manifest=manifest, images=replace(dataset.images, records=records))


def normal_bounds(dataset: Dataset, **edge: float) -> NDArray[np.float64]:
    made = as_images(dataset, **edge)
    return bounds_of(made, true_targets(made, 3.0)).normal_deg


def test_the_bound_of_an_image_follows_its_noise_contrast_and_visible_part(dataset: Dataset) -> None:
    plain = normal_bounds(dataset)
    np.testing.assert_allclose(normal_bounds(dataset, noise=2.0), 2 * plain, rtol=1e-9)
    np.testing.assert_allclose(normal_bounds(dataset, contrast=60.0), 2 * plain, rtol=1e-9)
    np.testing.assert_allclose(normal_bounds(dataset, visible=0.25), 2 * plain, rtol=1e-9)
    assert np.isnan(normal_bounds(dataset, noise=0.0)).all()
    assert np.isnan(normal_bounds(dataset, contrast=0.0)).all()


def test_the_bound_of_an_image_is_that_of_its_edge_points_and_what_levels_and_blur_cost(dataset: Dataset) -> None:
    # A pixel's length of an edge of Gaussian blur b tells its place with a variance of 2 sqrt(pi) b s^2 / h^2.
    targets = true_targets(dataset, 3.0)
    sigma = math.sqrt(2 * math.sqrt(math.pi) * math.sqrt(0.4**2 + PIXEL_VARIANCE)) / 120.0
    known = [
        pose_bound(contour_information(pose, d / 2, targets.cameras[c].K, sigma, ellipse_perimeter_px(e))).normal_deg
        for pose, d, c, e in zip(
            targets.camera_from_marker, targets.diameter_m, targets.camera, targets.ellipse, strict=True
        )
    ]
    cost = normal_bounds(dataset) / known
    # The two levels and the blur are not known beside it: seen, 1.004 on these circles, of semi-axes of 16 to 43 px.
    assert np.all((cost > 1.0) & (cost < 1.02)), cost


def test_shot_noise_tells_the_two_sides_of_an_edge_apart(dataset: Dataset) -> None:
    # Variances 1 -+ 0.005 * 120 / 2: 0.7 on the dark side, 1.3 on the light one.
    apart = normal_bounds(dataset, gain_dn_per_e=0.005)
    assert np.all(normal_bounds(dataset, noise=math.sqrt(0.7)) < apart)
    # The quieter side tells more than the louder one hides: less than their mean says.
    assert np.all(apart < normal_bounds(dataset))


def test_a_circle_seen_on_edge_has_no_bound(dataset: Dataset) -> None:
    targets = true_targets(dataset, 3.0)
    pose = targets.camera_from_marker.copy()
    # The plane now holds the camera's centre.
    z = pose[0, :3, 3] / np.linalg.norm(pose[0, :3, 3])
    x = np.cross(z, [0.0, 1.0, 0.0]) / np.linalg.norm(np.cross(z, [0.0, 1.0, 0.0]))
    pose[0, :3, :3] = np.stack([z, np.cross(x, z), x], axis=1)
    found = bounds_of(dataset, replace(targets, camera_from_marker=pose))
    assert np.isnan(found.normal_deg[0])
    assert np.isfinite(found.normal_deg[1:]).all()


def test_a_truth_that_lacks_something_is_refused(dataset: Dataset) -> None:
    with pytest.raises(DataError, match="has no column no_such; render it"):
        columns_of(dataset.truth, ["no_such"])
    ragged = pa.array([[0.0] * (5 + (i == 3)) for i in range(dataset.truth.num_rows)])
    with pytest.raises(DataError, match="contours of 2 lengths in contour_x_px"):
        true_targets(with_column(dataset, "contour_x_px", ragged), 3.0)
    with pytest.raises(DataError, match="has frame 900, which its cameras do not have"):
        true_targets(with_column(dataset, "frame_id", pa.array(range(900, 936))), 3.0)


def test_no_circle_is_no_error_of_the_targets(dataset: Dataset) -> None:
    nothing = with_column(dataset, "radius_m", pa.nulls(dataset.truth.num_rows, pa.float64()))
    assert len(true_targets(nothing, 3.0)) == 0


def test_a_detection_is_known_by_its_second_candidate(dataset: Dataset, tmp_path: Path) -> None:
    # Of frame 2 the first candidate failed, and the second did not.
    rows = estimate_rows(dataset, ["true"])
    failed = {"status": "failed", "reason": "no pose", "chosen": False}
    rows = [{**r, **failed} if (r["frame_id"], r["candidate"]) == (2, 0) else r for r in rows]
    runs = read_runs([write_estimates(tmp_path / "e.parquet", rows)], dataset)
    scores = score(dataset, true_targets(dataset, 3.0), runs)
    assert scores.table["solved"].to_pylist() == [True] * 36
    run = summarise(dataset, scores, {"reprojection_extent_D": 3.0}, 36, None).runs[0]
    assert (run["solved"], run["false_detections"]) == (36, 0)
