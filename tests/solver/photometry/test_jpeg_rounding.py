"""Noise by JPEG's tables, against images that Pillow encodes."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from helpers_images import coverage
from PIL import Image

from roundel.scenes.camera.response_curve import LINEAR, SRGB
from roundel.solver.photometry.jpeg_rounding import jpeg_edge, luminance_table, read_luminance_table
from roundel.solver.photometry.photometry import Photometry


def encoded(image: np.ndarray, quality: int) -> Image.Image:
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "JPEG", quality=quality)
    buffer.seek(0)
    return Image.open(buffer)


@pytest.mark.parametrize("quality", [98, 90, 75, 60])
def test_the_variance_is_that_of_edges_in_jpegs(quality):
    """Displacement of an edge: the mean error across it, weighted by its slope, against independent noise."""
    pushed, known = [], []
    for seed in range(12):
        generator = np.random.default_rng(seed)
        a = generator.uniform(20, 40)
        ellipse = np.array([*generator.uniform(60, 68, 2), a, generator.uniform(0.6, 1) * a, generator.uniform(0, 180)])
        share = coverage(ellipse, 128, 128, blur_px=0.7, subpixels=8)
        clean = 200.0 - 150.0 * share + generator.normal(0.0, 0.5, share.shape)
        file = encoded(np.rint(clean).astype(np.uint8), quality)
        error = np.asarray(file, dtype=np.float64) - (200.0 - 150.0 * share)
        # The slope along the normal; a band of 8x8 blocks has one displacement.
        gy, gx = np.gradient(share)
        slope = np.hypot(gx, gy)
        for row in range(0, 128, 8):
            for column in range(0, 128, 8):
                block = np.s_[row : row + 8, column : column + 8]
                if np.sum(slope[block] ** 2) > 0.5:
                    pushed.append(np.sum((slope * error)[block]))
                    known.append(np.sum(slope[block] ** 2))
    measured = np.sum(np.square(pushed)) / np.sum(known)
    table = luminance_table(encoded(np.zeros((8, 8), np.uint8), quality))
    assert table is not None
    # Some 250 blocks determine a variance to 10 %; the rounding to 8 bits is not part of the prediction.
    assert jpeg_edge(table, LINEAR, 50.0, 200.0, 0.7).variance == pytest.approx(measured, rel=0.4)


def test_coarser_tables_are_noisier_and_nothing_is_free():
    tables = [luminance_table(encoded(np.zeros((8, 8), np.uint8), q)) for q in (95, 75, 50, 25)]
    variances = [jpeg_edge(table, LINEAR, 40.0, 160.0, 1.0).variance for table in tables]
    assert variances == sorted(variances)
    assert 0.05 < variances[0] < 1.0  # steps of 1 to 12
    assert jpeg_edge(tables[0], LINEAR, 80.0, 80.0, 1.0) == (0.0, 0.0)


def test_only_a_curve_displaces_edges():
    table = luminance_table(encoded(np.zeros((8, 8), np.uint8), 60))
    plain = [abs(jpeg_edge(table, LINEAR, 50.0, 220.0, blur).displacement_px) for blur in (0.1, 1.0)]
    sharp, soft = (jpeg_edge(table, SRGB, 56.0, 224.0, blur).displacement_px for blur in (0.1, 1.0))
    # 800 blocks leave an error of some 0.001 px; rendered frames of quality 60 measured 0.01 to 0.03 px outward.
    assert max(plain) < 0.004
    assert sharp == pytest.approx(0.03, abs=0.01)
    assert 0.002 < soft < 0.01
    # The bright side gains, whichever it is.
    assert jpeg_edge(table, SRGB, 224.0, 56.0, 0.1).displacement_px == pytest.approx(-sharp, abs=0.005)


def test_tables_of_files(tmp_path):
    Image.fromarray(np.zeros((16, 16, 3), np.uint8)).save(tmp_path / "a.jpg", quality=50)
    Image.fromarray(np.zeros((16, 16), np.uint8)).save(tmp_path / "a.png")
    (tmp_path / "bad.jpg").write_bytes(b"\xff\xd8 no JPEG")
    table = read_luminance_table((tmp_path / "a.jpg").read_bytes())
    assert table is not None
    assert table[:4] == (16, 11, 10, 16)  # the standard's table K.1
    assert read_luminance_table((tmp_path / "a.png").read_bytes()) is None
    assert read_luminance_table((tmp_path / "bad.jpg").read_bytes()) is None


def test_lost_colours_displace_an_edge_as_well():
    table = luminance_table(encoded(np.zeros((16, 16), np.uint8), 75))
    assert table is not None
    grey = Photometry(SRGB, jpeg=table)
    colour = replace(grey, averaged=1 / 3)
    for inside, outside, sign in ((15.0, 200.0, 1.0), (200.0, 15.0, -1.0)):
        plain, both = (p.displacement_px(inside, outside, 0.4) for p in (grey, colour))
        assert sign * plain > 0.003
        assert 0.005 < sign * (both - plain) <= 0.017
    assert Photometry(LINEAR, averaged=1 / 3, jpeg=table).displacement_px(15.0, 200.0, 0.4) == pytest.approx(
        Photometry(LINEAR, jpeg=table).displacement_px(15.0, 200.0, 0.4)
    )
