"""Detection: what is found, and what must not be found."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers_images import coverage, picture
from PIL import Image, ImageDraw, ImageFont

from roundel.solver.detect.detect import detect
from roundel.solver.detect.grey_image import noise_dn

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
    # At some sizes a round letter of ten pixels is a circle within the accuracy of its contour; not at these.
    for i, size in enumerate((18, 44)):
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


@pytest.mark.parametrize("hidden_to", [0.1, -0.1])
def test_half_hidden(hidden_to):
    """Behind the edge of something: the chain of edge pixels turns a corner there, and what is left is an arc."""
    ellipse = np.array([200.0, 150.0, 40.0, 33.0, 30.0])
    image = picture([(ellipse, 30.0)], WIDTH, HEIGHT, blur_px=0.5, noise_dn=2.0)
    image[:, round(200 + 38 * hidden_to) :] = 120
    found = detect(image)
    # Half an ellipse tells its hidden side some ten times worse than a whole one.
    assert nearest(found, ellipse) < 0.5
    assert found[0].confidence < 0.5


def test_soft_and_noisy_circles_are_found_in_the_reduced_image():
    ellipse = np.array([200.0, 150.0, 60.0, 48.0, 30.0])
    for blur_px, noise, paper in ((12.0, 2.0, 200.0), (0.5, 50.0, 140.0)):
        image = cv2.GaussianBlur(
            picture([(ellipse, 60.0)], WIDTH, HEIGHT, paper_dn=paper).astype(np.float64), (0, 0), blur_px
        )
        image += np.random.default_rng(3).normal(0, noise, image.shape)
        found = detect(np.clip(np.rint(image), 0, 255).astype(np.uint8))
        # The curved edge's model is first order in the blur's variance over the size: 144 / 48 px, 2 % of it.
        assert nearest(found, ellipse) < 1.0


def test_thin_and_small():
    """A circle of 9 px tilted by 70 degrees: 3 px across."""
    for seed in range(4):
        generator = np.random.default_rng(seed)
        ellipse = np.array([*generator.uniform((140, 130), (260, 170)), 4.5, 1.6, generator.uniform(0, 180)])
        found = detect(picture([(ellipse, 30.0)], WIDTH, HEIGHT, blur_px=0.3, noise_dn=1.0, seed=seed))
        assert nearest(found, ellipse) < 0.3


def test_a_hundred_circles():
    generator = np.random.default_rng(5)
    layers = []
    for row in range(10):
        for column in range(10):
            centre = np.array([32.0 + 62 * column, 32.0 + 46 * row]) + generator.uniform(-3, 3, 2)
            a = generator.uniform(5, 17)
            layers.append((np.array([*centre, a, a * generator.uniform(0.5, 1), generator.uniform(0, 180)]), 30.0))
    found = detect(many(layers, 640, 480))
    assert len(found) == 100
    assert max(nearest(found, ellipse) for ellipse, _ in layers) < 0.2
    # The smallest, 5 x 2.5 px, hardly tell an octagon from a circle in this noise.
    assert min(d.confidence for d in found) > 0.4
    assert np.median([d.confidence for d in found]) > 0.9


def many(layers, width, height, noise=2.0):
    """As `picture`, each ellipse drawn in its own neighbourhood."""
    image = np.full((height, width), 200.0)
    for ellipse, level in layers:
        x, y = np.floor(ellipse[:2]).astype(int) - 24
        local = ellipse - np.array([x, y, 0, 0, 0])
        image[y : y + 48, x : x + 48] += (level - 200.0) * coverage(local, 48, 48, 0.5)[: height - y, : width - x]
    image += np.random.default_rng(0).normal(0, noise, image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def polygon(corners, radius, turn_deg, centre=(100.0, 80.0), squeeze=1.0, size=(200, 160)):
    """A regular polygon, squeezed as a tilt would: a picture with soft edges."""
    t = np.radians(turn_deg) + 2 * np.pi * np.arange(corners) / corners
    fine = 8
    points = np.stack([centre[0] + radius * np.cos(t), centre[1] + squeeze * radius * np.sin(t)], axis=1)
    big = np.full((size[1] * fine, size[0] * fine), 200, np.uint8)
    cv2.fillPoly(big, [np.rint((points + 0.5) * fine - 0.5).astype(np.int32)], 30)
    image = cv2.resize(big, size, interpolation=cv2.INTER_AREA).astype(float)
    image = cv2.GaussianBlur(image, (0, 0), 0.6) + np.random.default_rng(1).normal(0, 2, image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("corners", [3, 4, 5, 6, 8])
def test_polygons_have_no_confidence(corners):
    for radius in (8.0, 15.0, 30.0, 60.0):
        for squeeze in (1.0, 0.6):
            for detection in detect(polygon(corners, radius, 11.0, squeeze=squeeze)):
                assert detection.confidence < 0.5


def test_letters_have_no_confidence():
    page = Image.new("L", (500, 420), 215)
    y = 5
    for size in (12, 16, 22, 30, 44, 64):
        ImageDraw.Draw(page).text((8, y), "Quo vadis 0689 GOD", fill=30, font=ImageFont.load_default(size))
        y += int(1.5 * size)
    image = np.asarray(page) + np.random.default_rng(0).normal(0, 2, (420, 500))
    sure = [d for d in detect(np.clip(np.rint(image), 0, 255).astype(np.uint8)) if d.confidence >= 0.5]
    # The dot of the i and a counter of 7 px are as round as a circle can be at their size: of over a hundred letters.
    assert len(sure) <= 6


def test_confidence_of_a_whole_circle_is_one():
    ellipse = np.array([200.4, 150.2, 30.0, 24.0, 20.0])
    whole = picture([(ellipse, 30.0)], WIDTH, HEIGHT, blur_px=0.5, noise_dn=2.0)
    assert detect(whole)[0].confidence > 0.95
    hidden = whole.copy()
    hidden[:, 212:] = 120
    assert detect(hidden)[0].confidence < 0.7
    faint = picture([(ellipse, 196.0)], WIDTH, HEIGHT, blur_px=0.5, noise_dn=2.0)
    assert all(d.confidence < 0.8 for d in detect(faint))  # a step of two sigmas


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((1, 1), np.uint8),
        np.full((40, 60), 128, np.uint8),
        np.zeros((3, 400), np.uint8),
        np.zeros((400, 3), np.uint16),
        np.full((64, 64), 1e-9),
        np.eye(64, dtype=np.uint8) * 255,
        np.full((50, 50), 65535, np.uint16),
        np.random.default_rng(0).integers(0, 256, (90, 120)).astype(np.int64),
    ],
)
def test_nothing_to_find(image):
    assert [d for d in detect(image) if d.confidence >= 0.5] == []


def test_kinds_of_numbers():
    ellipse = np.array([200.4, 150.2, 30.0, 24.0, 20.0])
    image = picture([(ellipse, 30.0)], WIDTH, HEIGHT, blur_px=0.5, noise_dn=2.0)
    for other, full_scale in (
        (image.astype(np.uint16) * 257, 65535.0),
        (image / 255.0, 1.0),
        (image.astype(np.int32), 255.0),
        (np.repeat(image, 2, axis=1)[:, ::2], 255.0),
    ):
        assert nearest(detect(other, full_scale), ellipse) < 0.05


def test_huge_images_are_searched_reduced():
    ellipse = np.array([3100.3, 2500.8, 130.0, 100.0, 30.0])
    image = np.full((4200, 6000), 200, np.uint8)
    image[2300:2700, 2900:3300] = picture([(ellipse - [2900, 2300, 0, 0, 0], 30.0)], 400, 400, blur_px=1.0)
    found = detect(image)
    assert len(found) == 1
    assert nearest(found, ellipse) < 0.02  # measured in the whole image


def test_pixels_without_shades():
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    for radius in (8, 20, 60):
        found = detect(np.where((x - 200.3) ** 2 + (y - 150.2) ** 2 < radius**2, 0, 255).astype(np.uint8))
        assert len(found) == 1
        assert nearest(found, np.array([200.3, 150.2, radius, radius, 0])) < 0.2  # whole pixels


def test_twice_the_same():
    image = picture([(np.array([200.0, 150.0, 40.0, 33.0, 30.0]), 30.0)], WIDTH, HEIGHT, noise_dn=5.0)
    one, two = (detect(v, own_ellipses=True) for v in (image, image.copy()))
    assert np.array_equal(one[0].edges.points_px, two[0].edges.points_px)
    assert np.array_equal(one[0].edgedrawing, two[0].edgedrawing)


def test_noise_is_measured():
    for sigma in (1.5, 4.0, 12.0):
        image = picture([(np.array([200.0, 150.0, 40.0, 33.0, 30.0]), 30.0)], WIDTH, HEIGHT, noise_dn=sigma)
        assert noise_dn(image) == pytest.approx(sigma, rel=0.05)  # 40,000 samples, their rounding, a median


@pytest.mark.slow
def test_the_detection_study(tmp_path):
    """Two frames of each group of configs/detection.yaml, rendered: every marker is found, and with confidence."""
    from roundel.render.run import render_study

    text = (Path(__file__).resolve().parents[3] / "configs" / "detection.yaml").read_text(encoding="utf-8")
    study = tmp_path / "study.yaml"
    study.write_text(text.replace("frames: 16", "frames: 2"), encoding="utf-8")
    dataset = render_study(study, tmp_path / "dataset")
    keys = [f"ellipse_{k}" for k in ("x_px", "y_px", "a_px", "b_px", "angle_deg")]
    for i, row in enumerate(dataset.truth.select(keys).to_pylist()):
        truth = np.array([row[k] for k in keys])
        found = detect(*dataset.images.linear_image(i))
        assert nearest(found, truth) < 0.2, i  # the smallest is 8 px across; a wrong contour is off by pixels
        best = min(found, key=lambda d: float(np.abs(d.edges.ellipse[:4] - truth[:4]).max()))
        assert best.confidence > 0.5, i


def test_a_disc_within_a_disc_is_a_ring_only_if_it_is_concentric():
    # A hole that is off the centre by a quarter of the outer radius is a marker of its own.
    outer = np.array([200.0, 150.0, 100.0, 100.0, 0.0])
    ring = detect(picture([(outer, 30.0), (np.array([200.0, 150.0, 40.0, 40.0, 0.0]), 220.0)], WIDTH, HEIGHT))
    assert [len(d.inner) for d in ring] == [1]
    apart = detect(picture([(outer, 30.0), (np.array([228.0, 150.0, 40.0, 40.0, 0.0]), 220.0)], WIDTH, HEIGHT))
    assert [len(d.inner) for d in apart] == [0, 0]
    # A small hole may be off by some tenths of a pixel more, not by pixels.
    small = detect(picture([(outer, 30.0), (np.array([240.0, 150.0, 12.0, 12.0, 0.0]), 220.0)], WIDTH, HEIGHT))
    assert [len(d.inner) for d in small] == [0, 0]


def test_a_faint_disc_is_found_behind_many_things_that_are_not_circles():
    # Stronger candidates are looked at first, and all of these come to nothing.
    image = Image.new("L", (900, 700), 200)
    draw = ImageDraw.Draw(image)
    for i in range(7):
        for j in range(5):
            x, y = 40 + 120 * i, 40 + 130 * j
            if (i, j) != (3, 2):
                draw.rounded_rectangle((x, y, x + 90, y + 90), radius=35, fill=20)
    pixels = np.asarray(image, dtype=np.float64)
    disc = coverage([3 * 120 + 85.3, 2 * 130 + 84.6, 15.0, 14.0, 20.0], 900, 700)
    found = detect(pixels * (1 - disc) + 160.0 * disc)
    assert nearest(found, np.array([445.3, 344.6, 15.0, 14.0])) < 0.3
