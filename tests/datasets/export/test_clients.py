"""Exports as their own clients read them (make clients-env): poses, masks and cameras equal the truth.

The clients run in an environment of their own, `.venv-clients`, or that named by ROUNDEL_CLIENTS. bop_toolkit is no
package: ROUNDEL_BOP_TOOLKIT names a checkout.
"""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from roundel.datasets.dataset import Dataset
from roundel.datasets.export.export import FORMATS, export_dataset
from roundel.datasets.stream.frames import Frame, frame_source
from roundel.datasets.stream.splits import Splits
from roundel.render.run import render_study
from roundel.scenes.study.study import load_study
from roundel.validate.metrics.bop import mspd_px, mssd_m

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[3]
PYTHON = Path(os.environ.get("ROUNDEL_CLIENTS", ROOT / ".venv-clients")) / "bin" / "python"
CLIENTS = Path(__file__).parent / "clients"

STUDY = """\
schema: 1
name: clients
seed: 3
camera: {width_px: 320, height_px: 240, focal_px: 320, principal_point_x_px: 150, principal_point_y_px: 125}
marker: {kind: disc, diameter_m: 0.08}
pose:
  distance_m: {uniform: [0.4, 0.7]}
  tilt_deg: {uniform: [10, 50]}
  azimuth_deg: {uniform: [-180, 180]}
  offset_x_px: {uniform: [-150, 40]}
light: {environment: 0.7}
render: {radiance: true}
groups:
  plain: {frames: 8}
  occluded:
    frames: 4
    occluders:
      - {shape: rectangle, x_m: 0.06, y_m: 0.0, z_m: 0.005, width_m: 0.08, height_m: 0.12, reflectance: 0.5}
"""


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("clients")
    (folder / "study.yaml").write_text(STUDY)
    found = render_study(load_study(folder / "study.yaml"), folder / "ds")
    assert found is not None
    return found


@pytest.fixture(scope="module")
def frames(dataset: Dataset) -> dict[int, Frame]:
    source = frame_source(dataset, lambda index: "train", masks=True)
    return {frame.frame_id: frame for frame in map(source, range(len(dataset)))}


@pytest.fixture(scope="module")
def exports(dataset: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("exports")
    for name in FORMATS:
        export_dataset(dataset, folder / name, name, Splits((0.5, 0.25, 0.25), seed=3))
    return folder


def read_by(script: str, *arguments: str | Path, **more: str) -> Any:
    """What a client prints, as JSON."""
    if not PYTHON.exists():
        pytest.skip("no environment with clients: make clients-env")
    offline = {"HF_HUB_OFFLINE": "1", "HF_DATASETS_OFFLINE": "1", "HF_HOME": f"{arguments[-1]}-cache"}
    offline["CROISSANT_CACHE"] = offline["HF_HOME"]
    done = subprocess.run(
        [PYTHON, CLIENTS / script, *arguments], check=False, capture_output=True, text=True,
        env={**os.environ, **offline, **more},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.splitlines()[-1])


def levels(frame: Frame) -> int:
    return int(frame.image.astype(np.int64).sum())


def test_coco(exports: Path, frames: dict[int, Frame]) -> None:
    read = read_by("coco.py", exports / "coco")
    assert [p for _, _, p in read["precision"]] == [1.0] * 9
    assert len(read["annotations"]) == len(frames)
    for a in read["annotations"]:
        frame = frames[int(Path(a["image"]).stem)]
        (marker,) = frame.markers
        np.testing.assert_allclose(a["pose"], marker.camera_from_marker, atol=1e-12)
        assert (a["mask_pixels"], a["full_pixels"]) == (marker.visible_mask.sum(), marker.full_mask.sum())
        ys, xs = np.nonzero(marker.visible_mask)
        assert a["mask_centre"] == pytest.approx([xs.mean() + 0.5, ys.mean() + 0.5])
        # The centre's image by the camera of the file, which counts from the corner, too.
        k = np.array(a["K"])
        x, y, z = marker.camera_from_marker[:3, 3]
        assert a["keypoints"][:2] == pytest.approx([k[0, 0] * x / z + k[0, 2], k[1, 1] * y / z + k[1, 2]])
        assert k[0, 2] == pytest.approx(frame.camera.K[0, 2] + 0.5)
        # The box is that of the outline: the mask's pixels lie in it, but for half of an edge pixel.
        left, top, width, height = a["bbox"]
        assert left - 0.5 <= xs.min()
        assert xs.max() + 1 <= left + width + 0.5
        assert top - 0.5 <= ys.min()
        assert ys.max() + 1 <= top + height + 0.5


def best_turn(rotation: np.ndarray, t: np.ndarray, pose: np.ndarray, radius: float, k: np.ndarray | None) -> np.ndarray:
    """The rotation, turned about its normal so that the farthest point of the rim is nearest."""
    angle = np.linspace(0, 2 * np.pi, 3600, endpoint=False)

    def rim(turn: float) -> np.ndarray:
        return radius * np.column_stack([np.cos(angle + turn), np.sin(angle + turn), np.zeros_like(angle)])

    def seen(points: np.ndarray) -> np.ndarray:
        if k is None:
            return points
        image = points @ k.T
        return image[:, :2] / image[:, 2:]

    def farthest(turn: float) -> float:
        mine, theirs = rim(0.0) @ rotation.T + t, rim(turn) @ pose[:3, :3].T + pose[:3, 3]
        return float(np.linalg.norm(seen(mine) - seen(theirs), axis=1).max())

    turn = float(minimize_scalar(farthest, bounds=(-0.2, 0.2), method="bounded", options={"xatol": 1e-10}).x)
    c, s = np.cos(-turn), np.sin(-turn)
    return rotation @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("error", ["mssd", "mspd"])
def test_bop(error: str, exports: Path, frames: dict[int, Frame], tmp_path: Path) -> None:
    toolkit = os.environ.get("ROUNDEL_BOP_TOOLKIT")
    if not toolkit:
        pytest.skip("ROUNDEL_BOP_TOOLKIT names no checkout of bop_toolkit")
    rng, estimates = np.random.default_rng(5), {}
    poses: dict[int, tuple[np.ndarray, np.ndarray]] = {}
    for number, frame in frames.items():
        pose = frame.markers[0].camera_from_marker
        x, y = rng.normal(scale=0.02, size=2)
        u, _, v = np.linalg.svd(np.array([[1, 0, y], [0, 1, -x], [-y, x, 1]]))
        rotation, t = pose[:3, :3] @ (u @ v), pose[:3, 3] + rng.normal(scale=0.001, size=3)
        # Roundel takes the best turn about the normal, BOP the best of 315: it is given the best one.
        rotation = best_turn(rotation, t, pose, 0.04, frame.camera.K if error == "mspd" else None)
        poses[number] = rotation, t
        estimates[str(number)] = {"R": rotation.ravel().tolist(), "t": (1000 * t).tolist()}
    (tmp_path / "estimates.json").write_text(json.dumps(estimates))
    read = read_by(
        "bop.py", exports / "bop", tmp_path / "estimates.json", tmp_path / "out_clients-test.csv", PYTHONPATH=toolkit
    )
    assert len(read) == len(frames)
    for r in read:
        frame = frames[r["frame_id"]]
        (marker,) = frame.markers
        pose = marker.camera_from_marker
        np.testing.assert_allclose(r["K"], frame.camera.K, atol=1e-12)
        np.testing.assert_allclose(r["rotation"], pose[:3, :3], atol=1e-12)
        np.testing.assert_allclose(r["t_mm"], 1000 * pose[:3, 3], atol=1e-9)
        # BOP's projection takes pixel centres as integers, as Roundel does.
        truth = marker.truth
        assert r["centre_px"] == pytest.approx([truth["centre_image_x_px"], truth["centre_image_y_px"]], abs=1e-6)
        assert (r["mask_pixels"], r["visible_pixels"]) == (marker.full_mask.sum(), marker.visible_mask.sum())
        assert r["mask_and_visible"] == r["visible_pixels"]
        assert r["info"]["px_count_visib"] == r["visible_pixels"]
        assert r["info"]["px_count_all"] >= r["mask_pixels"]
        assert r["box"] is None or r["box"] == r["info"]["bbox_visib"]
        assert 0 <= r["info"]["visib_fract"] <= 1
        assert r["symmetries"] == 315
        assert r["diameter_mm"] == pytest.approx(80.0, abs=0.01)
        assert (r["mssd_of_truth"], r["mspd_of_truth"]) == (0.0, 0.0)
        # A turn about the normal, to the toolkit's own steps of 0.02 rad.
        assert r["mssd_turned"] <= 40.0 * 0.01 * 2
        rotation, t = poses[r["frame_id"]]
        estimate = rotation[:, 2], t, marker.diameter_m / 2
        if error == "mssd":
            assert r["mssd"] / 1000 == pytest.approx(float(mssd_m(pose, *estimate)), abs=1e-6)
        else:
            assert r["mspd"] == pytest.approx(float(mspd_px(pose, frame.camera, *estimate)), abs=1e-6)


def test_webdataset_and_huggingface(exports: Path, frames: dict[int, Frame]) -> None:
    for name in ("webdataset", "huggingface"):
        read = read_by("others.py", name, exports / name)
        assert sorted(r["record"]["frame_id"] for r in read) == sorted(frames)
        for r in read:
            frame = frames[r["record"]["frame_id"]]
            assert r["levels"] == levels(frame)
            assert r["size"] == [frame.camera.width_px, frame.camera.height_px]
            np.testing.assert_array_equal(r["record"]["K"], frame.camera.K)
            (m,) = r["record"]["markers"]
            np.testing.assert_array_equal(m["camera_from_marker"], frame.markers[0].camera_from_marker)
            assert sum(m["mask"][1::2]) == frame.markers[0].visible_mask.sum()


def test_croissant(exports: Path, frames: dict[int, Frame]) -> None:
    read = read_by("others.py", "croissant", exports / "croissant")
    assert read["errors"] == []
    assert [w for w in read["warnings"] if "datePublished" not in w] == []
    assert read["images"] == [[320, 240]] * len(frames)
    assert [r["frames/frame_id"] for r in read["frames"]] == sorted(frames)
    for row in read["markers"]:
        marker = frames[row["markers/frame_id"]].markers[0]
        pose = [[row[f"markers/camera_from_marker_{i}{j}"] for j in range(4)] for i in range(4)]
        np.testing.assert_allclose(pose, marker.camera_from_marker, atol=1e-12)
    validated = subprocess.run(
        [PYTHON.parent / "mlcroissant", "validate", "--jsonld", exports / "croissant" / "croissant.json"],
        check=False, capture_output=True, text=True,
    )  # fmt: skip
    assert validated.returncode == 0, validated.stderr


def test_colmap(exports: Path, frames: dict[int, Frame]) -> None:
    read = read_by("others.py", "colmap", exports / "colmap")
    assert len(read) == len(frames)
    for r in read:
        frame = frames[int(Path(r["name"]).stem)]
        marker = frame.markers[0]
        np.testing.assert_allclose(r["pose"], marker.camera_from_marker, atol=1e-9)
        assert r["params"] == [320.0, 320.0, 150.5, 125.5]
        # COLMAP's pixel (0, 0) is the corner of the first.
        expected = [marker.truth["centre_image_x_px"] + 0.5, marker.truth["centre_image_y_px"] + 0.5]
        assert r["centre"] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("name", ["tum", "kitti"])
def test_trajectories(name: str, exports: Path, frames: dict[int, Frame]) -> None:
    read = read_by("others.py", "trajectory", exports / name)[f"marker-0.{name}"]
    assert read["valid"]
    assert read["error"] == pytest.approx(0.0, abs=1e-6)
    for pose, number in zip(read["poses"], sorted(frames), strict=True):
        np.testing.assert_allclose(np.linalg.inv(pose), frames[number].markers[0].camera_from_marker, atol=1e-9)


def test_yolo(exports: Path, frames: dict[int, Frame]) -> None:
    read = read_by("others.py", "yolo", exports / "yolo")
    assert len(read) == 2 * len(frames)
    for key, r in read.items():
        task, _, stem = key.partition("/")
        (marker,) = frames[int(stem)].markers
        assert marker.box_px is not None
        assert r["classes"] == ["disc 80 mm"]
        # Supervision counts from the corner, and rounds to single precision; of outlines to whole pixels.
        assert r["boxes"][0] == pytest.approx(np.array(marker.box_px) + 0.5, abs=1e-3 if task == "pose" else 1.0)
        if task == "segment":
            assert r["pixels"][0] == pytest.approx(marker.full_mask.sum(), rel=0.1)
