"""What is found, and what must not be."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from helpers_images import picture
from PIL import Image, ImageDraw, ImageFont

from roundel.solver.candidates import noise_dn
from roundel.solver.detect import detect

WIDTH, HEIGHT = 400, 300


def nearest(detections, ellipse):
    return min((float(np.abs(d.edges.ellipse[:4] - ellipse[:4]).max()) for d in detections), default=np.inf)


@pytest.mark.parametrize(
    ("a_px", "b_px", "blur_px", "noise"),
    [
        (4.0, 3.8, 0.5, 2.0),
        (4.0, 2.5, 0.5, 2.0),
        (8.0, 3.0, 0.5, 2.0),
        (14.4, 11.4, 0.0, 0.0),
        (14.4, 11.4, 1.0, 5.0),
        (43.0, 37.0, 0.5, 2.0),
        (32.1, 31.1, 2.0, 2.0),
        (90.0, 20.0, 0.5, 2.0),
        (120.0, 110.0, 1.0, 5.0),
    ],
)
def test_one_disc(a_px, b_px, blur_px, noise):
    for seed in range(3):
        generator = np.random.default_rng(seed)
        ellipse = np.array([*generator.uniform((140, 130), (260, 170)), a_px, b_px, generator.uniform(0, 180)])
        found = detect(picture([(ellipse, 30.0)], WIDTH, HEIGHT, blur_px=blur_px, noise_dn=noise, seed=seed))
        assert len(found) == 1
        # The smallest in noise of 5 dn, ten of its sigmas; a wrong ellipse is off by pixels.
        assert nearest(found, ellipse) < 0.2
        assert found[0].edges.contrast_dn > 0


@pytest.mark.parametrize(("paper", "ink", "noise"), [(40, 220, 2.0), (200, 190, 1.0), (200, 170, 8.0), (200, 30, 20.0)])
def test_any_contrast(paper, ink, noise):
    ellipse = np.array([200.4, 150.2, 30.0, 24.0, 20.0])
    found = detect(picture([(ellipse, ink)], WIDTH, HEIGHT, paper_dn=paper, blur_px=0.5, noise_dn=noise))
    assert len(found) == 1
    assert nearest(found, ellipse) < 0.3
    assert np.sign(found[0].edges.contrast_dn) == np.sign(paper - ink)


@pytest.mark.parametrize("noise", [0.0, 2.0, 10.0])
def test_nothing_in_nothing(noise):
    assert detect(picture([], WIDTH, HEIGHT, noise_dn=noise)) == []


def ring(a_px, b_px, ratio):
    outer = np.array([200.3, 150.6, a_px, b_px, 30.0])
    return outer, outer * np.array([1, 1, ratio, ratio, 1])


@pytest.mark.parametrize("ratio", [0.3, 0.5, 0.7, 0.85])
def test_a_ring_is_one_detection(ratio):
    outer, inner = ring(40.0, 33.0, ratio)
    found = detect(picture([(outer, 30.0), (inner, 200.0)], WIDTH, HEIGHT, blur_px=0.5, noise_dn=2.0))
    assert len(found) == 1
    assert nearest(found, outer) < 0.05
    assert len(found[0].inner) == 1
    assert np.abs(found[0].inner[0].ellipse[:4] - inner[:4]).max() < 0.05


def test_bullseye_and_neighbours():
    layers = [
        (np.array([120.0, 150.4, r, 0.8 * r, 30.0]), 30.0 if i % 2 == 0 else 200.0)
        for i, r in enumerate((60, 45, 30, 15))
    ]
    other = np.array([300.0, 150.0, 25.0, 20.0, 100.0])
    found = detect(picture([*layers, (other, 30.0)], WIDTH, HEIGHT, blur_px=0.5, noise_dn=2.0))
    assert [len(d.inner) for d in found] == [3, 0]  # the strongest first
    assert nearest(found, layers[0][0]) < 0.05
    assert nearest(found, other) < 0.05


def chessboard(image, square_px, turn_deg=6.0):
    fine, (height, width) = 4, image.shape
    pattern = np.indices((8, 9)).sum(axis=0) % 2 == 0
    board = (
        np.where(pattern, 30, 230).astype(np.uint8).repeat(square_px * fine, axis=0).repeat(square_px * fine, axis=1)
    )
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    move = np.array([[c, -0.7 * s, 20.0 * fine], [s, 0.8 * c, 20.0 * fine]])
    size = (width * fine, height * fine)
    mask = cv2.warpAffine(np.full_like(board, 255), move, size)
    painted = cv2.warpAffine(board, move, size)
    mask, painted = (cv2.resize(v, (width, height), interpolation=cv2.INTER_AREA) for v in (mask, painted))
    return np.where(mask > 127, painted, image).astype(np.uint8)


@pytest.mark.parametrize("square_px", [6, 9, 14, 22])
def test_chessboards_are_not_circles(square_px):
    ellipse = np.array([330.3, 240.2, 20.0, 15.0, 30.0])
    found = detect(chessboard(picture([(ellipse, 30.0)], WIDTH, HEIGHT, noise_dn=2.0), square_px))
    assert len(found) == 1
    assert nearest(found, ellipse) < 0.05


def test_sheets_squares_and_text_are_not_circles():
    image = picture([], WIDTH, HEIGHT, paper_dn=90.0, noise_dn=2.0)
    cv2.fillPoly(image, [np.array([[60, 40], [360, 30], [380, 270], [50, 280]])], 210, cv2.LINE_AA)
    for i, side in enumerate((8, 12, 20, 40)):
        corners = cv2.boxPoints(((90.0 + 70 * i, 80.0), (side, side), 20.0 * i))
        cv2.fillPoly(image, [corners.round().astype(np.int32)], 30, cv2.LINE_AA)
    # Pillow's font, not OpenCV's: the letters of OpenCV 4 and 5 are different ones.
    page = Image.fromarray(image)
    for i, size in enumerate((16, 30)):
        ImageDraw.Draw(page).text((80, 140 + 50 * i), "Quo 0689 door", fill=30, font=ImageFont.load_default(size))
    assert detect(np.asarray(page)) == []


def test_partly_hidden_and_cut_by_the_border():
    ellipse = np.array([200.0, 150.0, 40.0, 33.0, 30.0])
    image = picture([(ellipse, 30.0)], WIDTH, HEIGHT, blur_px=0.5, noise_dn=2.0)
    image[146:152] = 120
    image[:, 226:] = 120
    assert nearest(detect(image), ellipse) < 0.05
    cut = np.array([12.0, 150.0, 40.0, 33.0, 30.0])
    assert nearest(detect(picture([(cut, 30.0)], WIDTH, HEIGHT, blur_px=0.5, noise_dn=2.0)), cut) < 0.1


def test_pixels_without_shades():
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    for radius in (8, 20, 60):
        found = detect(np.where((x - 200.3) ** 2 + (y - 150.2) ** 2 < radius**2, 0, 255).astype(np.uint8))
        assert len(found) == 1
        assert nearest(found, np.array([200.3, 150.2, radius, radius, 0])) < 0.2  # whole pixels


def test_twice_the_same():
    image = picture([(np.array([200.0, 150.0, 40.0, 33.0, 30.0]), 30.0)], WIDTH, HEIGHT, noise_dn=5.0)
    one, two = detect(image), detect(image.copy())
    assert np.array_equal(one[0].edges.points_px, two[0].edges.points_px)
    assert np.array_equal(one[0].edgedrawing, two[0].edgedrawing)


def test_noise_is_measured():
    for sigma in (1.5, 4.0, 12.0):
        image = picture([(np.array([200.0, 150.0, 40.0, 33.0, 30.0]), 30.0)], WIDTH, HEIGHT, noise_dn=sigma)
        assert noise_dn(image) == pytest.approx(sigma, rel=0.05)  # 40,000 samples, their rounding, a median
