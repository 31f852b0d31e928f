"""Noise by JPEG's tables, against images that Pillow encodes."""

from __future__ import annotations

import io

import numpy as np
import pytest
from helpers_images import coverage
from PIL import Image

from roundel.solver.photometry.jpeg_rounding import jpeg_variance, luminance_table, read_luminance_table


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
    assert jpeg_variance(table, 150.0, 0.7) == pytest.approx(measured, rel=0.4)


def test_coarser_tables_are_noisier_and_nothing_is_free():
    tables = [luminance_table(encoded(np.zeros((8, 8), np.uint8), q)) for q in (95, 75, 50, 25)]
    variances = [jpeg_variance(table, 120.0, 1.0) for table in tables]
    assert variances == sorted(variances)
    assert 0.05 < variances[0] < 1.0  # steps of 1 to 12
    assert jpeg_variance(tables[0], 0.0, 1.0) == 0.0


def test_tables_of_files(tmp_path):
    Image.fromarray(np.zeros((16, 16, 3), np.uint8)).save(tmp_path / "a.jpg", quality=50)
    Image.fromarray(np.zeros((16, 16), np.uint8)).save(tmp_path / "a.png")
    (tmp_path / "bad.jpg").write_bytes(b"\xff\xd8 no JPEG")
    table = read_luminance_table(tmp_path / "a.jpg")
    assert table is not None
    assert table[:4] == (16, 11, 10, 16)  # the standard's table K.1
    assert read_luminance_table(tmp_path / "a.png") is None
    assert read_luminance_table(tmp_path / "bad.jpg") is None
    assert read_luminance_table(tmp_path / "none.jpg") is None
