"""What the truth of a marker's edge says: against the simpler bound, and against the renderer's motion."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from helpers_reports import POINTS, make_dataset

from roundel.datasets.dataset import Dataset
from roundel.render.sensor.data_sheet import data_sheet
from roundel.scenes.camera.model import Camera
from roundel.scenes.camera.motion import Motion, image_of
from roundel.scenes.camera.row_time import RowTime
from roundel.scenes.geometry.conic import circle_points_m
from roundel.scenes.geometry.edge_spread_function import PIXEL_VARIANCE
from roundel.scenes.geometry.information import shape_of_pose
from roundel.scenes.geometry.pixel_information import EdgeConditions
from roundel.scenes.geometry.pose import camera_from_marker_of, normal_of
from roundel.scenes.study.sensor_section import SensorSection
from roundel.validate.metrics.cramer_rao import bounds_of
from roundel.validate.metrics.edge_conditions import edges_of, with_shutter
from roundel.validate.metrics.ground_truth import true_targets


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return make_dataset(tmp_path_factory.mktemp("points") / "ds", POINTS)


def as_images(dataset: Dataset, electrons: bool = True, keys: dict[str, Any] | None = None, **columns: Any) -> Dataset:
    """The same circles as images of a linear sensor of 10,000 electrons, from 500 inside to 8,000 outside."""
    n = dataset.truth.num_rows
    sheet = data_sheet(SensorSection.model_validate(keys or {}), 0.01)
    gain = sheet.gain_dn_per_e
    noise = np.sqrt(((500 + 8000) / 2 + 25) * gain**2 + 1 / 12)
    told: dict[str, Any] = {
        "edge_contrast_dn": 7500 * gain,
        "edge_noise_dn": noise,
        "edge_blur_px": np.sqrt(0.4**2 + PIXEL_VARIANCE),
        "edge_inside_e": 500.0 if electrons else None,
        "edge_outside_e": 8000.0 if electrons else None,
    }
    for name, value in (told | columns).items():
        at = dataset.truth.column_names.index(name)
        column = pa.array([value] * n, dataset.truth.schema.field(name).type)
        dataset = replace(dataset, kept_truth=dataset.truth.set_column(at, name, column))
    records = [{**r, "sensor": {**sheet.record(), "saturation_dn": 255}} for r in dataset.images.records]
    manifest = {**dataset.manifest, "groups": None, "study": {**dataset.study, "groups": {}}}
    return replace(dataset, manifest=manifest, images=replace(dataset.images, records=records))


def bounds(dataset: Dataset, **edge: Any) -> Any:
    made = as_images(dataset, **edge)
    return bounds_of(made, true_targets(made, 3.0))


def test_a_clean_frame_has_the_simple_bound(dataset: Dataset) -> None:
    plain, simple = bounds(dataset), bounds(dataset, electrons=False)
    np.testing.assert_allclose(plain.normal_deg, simple.normal_deg, rtol=1e-9)
    np.testing.assert_allclose(plain.position_m, simple.position_m, rtol=1e-9)


@pytest.mark.parametrize(
    ("edge", "normal", "position"),
    [
        # Twice the full well: the edge is steeper, but its light side clips, and with it the knowledge of the size.
        ({"edge_outside_e": 20_000.0}, (0.6, 1.2), (4.0, 60.0)),
        # A ramp of a twentieth of the radius, 1 to 2 px, beside a blur of 0.5.
        ({"edge_softness_m": 0.002}, (1.05, 1.6), (1.05, 1.6)),
        ({"contour_visible": [True] * 192 + [False] * 64}, (1.2, 30.0), (1.1, 30.0)),
        # An 8-bit file of the sRGB curve rounds bright levels more coarsely than noise, and dark ones less.
        ({"keys": {"curve": "srgb"}}, (0.9, 1.1), (0.9, 1.1)),
    ],
)
def test_what_a_condition_costs(dataset: Dataset, edge, normal, position) -> None:
    plain, worse = bounds(dataset), bounds(dataset, **edge)
    for values, (low, high) in (
        (worse.normal_deg / plain.normal_deg, normal),
        (worse.position_m / plain.position_m, position),
    ):
        assert low <= np.median(values) <= high, np.median(values)


def test_frames_without_electrons_or_with_a_processor_have_no_edge(dataset: Dataset) -> None:
    for made in (as_images(dataset, electrons=False), as_images(dataset, keys={"isp": "phone"})):
        assert edges_of(made, true_targets(made, 3.0)) == [None] * made.truth.num_rows
    old = replace(dataset, kept_truth=dataset.truth.drop_columns(["edge_inside_e"]))
    assert edges_of(old, true_targets(old, 3.0)) == [None] * old.truth.num_rows


@pytest.mark.parametrize("axis", range(6))
def test_the_shutter_moves_the_contour_as_the_renderer_does(axis: int) -> None:
    camera = Camera(640, 480, np.array([[1000.0, 0, 319.5], [0, 1000.0, 239.5], [0, 0, 1]]))
    pose = camera_from_marker_of(normal_of(35.0, 50.0), [0.05, -0.04, 0.9])
    readout_s, sigma = 0.02, RowTime(0.02, 0.1, 8.0).twist_sigma
    given = with_shutter(EdgeConditions(), RowTime(readout_s, 0.1, 8.0), pose, 0.04, camera)
    assert given.drift is not None
    assert given.reference_px is not None
    twist = np.zeros(6)
    twist[axis] = sigma[axis]
    motion = Motion(0.001, readout_s / 480, float(given.reference_px[1]), twist, np.zeros(6))
    seen, _ = image_of(camera, motion, pose, circle_points_m(np.eye(4), 0.04, 90))
    rows = seen[:, 1] - given.reference_px[1]
    shape = shape_of_pose(pose, 0.04, camera.K)[:, None] + given.drift[:, axis][:, None] * rows
    # Each point lies on the ellipse of its own row: |S^-1 (p - c)| = 1.
    s = np.array([[shape[2], shape[3]], [shape[3], shape[4]]]).transpose(2, 0, 1)
    u = np.linalg.solve(s, (seen - shape[:2].T)[..., None])[..., 0]
    still = np.linalg.norm(
        np.linalg.solve(
            np.array([[shape_of_pose(pose, 0.04, camera.K)[2:4], shape_of_pose(pose, 0.04, camera.K)[3:5]]])[0],
            (seen - shape_of_pose(pose, 0.04, camera.K)[:2]).T,
        ),
        axis=0,
    )
    moved = np.abs(still - 1).max()
    # What is left is of second order in the motion: a few per cent of a per cent of the ellipse.
    assert np.abs(np.linalg.norm(u, axis=1) - 1).max() < max(0.02 * moved, 1e-6)
