"""Veiling glare and halo against their formulas."""

from pathlib import Path

import numpy as np
import pytest
from helpers_studies import small_study

from roundel.render.sensor.demosaic import filters
from roundel.render.sensor.develop import develop
from roundel.render.sensor.glare import with_glare
from roundel.scenes.errors import StudyError
from roundel.scenes.study.camera_section import CameraSection
from roundel.scenes.world.frame import Frame, frame_of


def lens(**keys: float) -> CameraSection:
    return CameraSection.model_validate({"width_px": 160, "height_px": 120, "focal_px": 320, **keys})


def frame_with(folder: Path, camera: str, sensor: str = "{}") -> Frame:
    edits = ("focal_px: 320", f"focal_px: 320, {camera}"), ("frames: 4", f"frames: 1\nsensor: {sensor}")
    return frame_of(small_study(folder, *edits), 0)


def patch() -> np.ndarray:
    """A black patch of 10 x 10 px in a white frame."""
    out = np.ones((120, 160), dtype=np.float32)
    out[50:60, 70:80] = 0
    return out


def test_without_glare_the_array_is_the_same() -> None:
    scene = patch()
    assert with_glare(scene, lens(), "none") is scene


def test_a_black_patch_has_the_veiling_glare_index() -> None:
    scene = patch()
    seen = with_glare(scene, lens(veiling_glare=0.03), "none")
    assert seen.dtype == np.float32
    mean = 1 - 100 / (120 * 160)
    np.testing.assert_allclose(seen[55, 75], 0.03 * mean, rtol=1e-6)
    np.testing.assert_allclose(seen[0, 0], 0.97 + 0.03 * mean, rtol=1e-6)
    np.testing.assert_allclose(seen.mean(), scene.mean(), rtol=1e-6)


@pytest.mark.parametrize("mosaic", ["none", "rggb", "gbrg"])
def test_no_light_is_lost_and_colours_stay_apart(mosaic: str) -> None:
    scene = np.random.default_rng(0).random((120, 160))
    colour = np.zeros(scene.shape, dtype=int) if mosaic == "none" else filters(mosaic, (120, 160))
    scene = scene * np.array([1.0, 0.0, 3.0])[colour] if mosaic != "none" else scene
    seen = with_glare(scene, lens(veiling_glare=0.05, halo=0.1, halo_px=15), mosaic)
    for channel in range(3):
        own = colour == channel
        if own.any():
            np.testing.assert_allclose(seen[own].sum(), scene[own].sum(), rtol=1e-12)


@pytest.mark.parametrize("mosaic", ["none", "rggb"])
def test_a_halo_is_a_gaussian(mosaic: str) -> None:
    scene = np.zeros((201, 201))
    scene[90:110, 90:110] = 1.0
    seen = with_glare(scene, lens(halo=0.2, halo_px=12), mosaic)
    x = np.arange(201.0)
    outside = scene == 0
    # A square of 20 px and a Gaussian: their second moments add. Truncated at four sigma: 0.1 %.
    halo = seen - 0.8 * scene
    variance = np.sum(halo * (x - 99.5) ** 2) / halo.sum()
    assert variance == pytest.approx(12**2 + (20**2 - 1) / 12, rel=0.005)
    assert halo.sum() == pytest.approx(0.2 * 400, rel=1e-6)
    assert seen[outside].max() < 0.2


def test_glare_lowers_contrast_and_lifts_noise_in_the_photometry(tmp_path: Path) -> None:
    scene = np.full((120, 160), 0.8, dtype=np.float32)
    scene[:, :80] = 0.05
    coverage = (np.arange(160) < 80) * np.ones((120, 1), dtype=np.float32)
    coverage[:, 79:81] = 0.5
    sensor = "{exposure_e: 10000}"
    bare, veiled = (develop(frame_with(tmp_path, keys, sensor), scene) for keys in ("aspect: 1", "veiling_glare: 0.1"))
    first, second = (d.edge(coverage.astype(np.float32)) for d in (bare, veiled))
    assert second["edge_contrast_dn"] == pytest.approx(0.9 * first["edge_contrast_dn"], rel=1e-5)
    assert veiled.noise_dn()[60, 20] > 1.2 * bare.noise_dn()[60, 20]
    np.testing.assert_array_equal(bare.light, scene)


def test_exposure_sees_the_glare(tmp_path: Path) -> None:
    # A bright wall around a dim sheet: without the light that it scatters, the sheet would be overexposed.
    frame = frame_with(tmp_path, "veiling_glare: 0.1", "{read_noise_e: 0, shot_noise: false}")
    scene = np.full((120, 160), 4.0, dtype=np.float32)
    from roundel.render.sensor.exposure import sheet_pixels

    rows, columns = sheet_pixels(frame)
    scene[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1] = 0.5
    image = develop(frame, scene).image
    # The sheet's white at 0.8 of the well, whatever was scattered onto it.
    assert image[rows[len(rows) // 2], columns[len(columns) // 2]] == round(0.8 * 255)


@pytest.mark.parametrize(
    ("camera", "words"),
    [
        ("veiling_glare: 1.5", "camera.veiling_glare: 1.5 is out of range; it must be between 0 and 1"),
        ("veiling_glare: 0.7, halo: 0.5", "veiling_glare and halo spread more light than there is"),
        ("halo: 0.1, halo_px: 0", "camera.halo_px: 0 is out of range; it must be positive"),
    ],
)
def test_bad_input_is_one_line(tmp_path: Path, camera: str, words: str) -> None:
    with pytest.raises(StudyError) as caught:
        frame_with(tmp_path, camera)
    assert words in str(caught.value)
    assert caught.value.line == 4
