"""Circles that are hard to find: small, blurred beside sharp ones, cut by the border, on boards, in clutter."""

from __future__ import annotations

import time

import cv2
import numpy as np
import pytest
from helpers_images import coverage, picture

from roundel.scenes.geometry.conic import ellipse_points
from roundel.solver.detect.detect import detect

PAPER, INK = 200.0, 30.0


def drawn(ellipses, width, height, blur_px=0.5, noise_dn=2.0, half=30):
    """Dark ellipses on paper, each drawn in its own neighbourhood with its own blur."""
    image = np.full((height + 2 * half, width + 2 * half), PAPER)
    blurs = np.broadcast_to(blur_px, len(ellipses))
    for ellipse, blur in zip(ellipses, blurs, strict=True):
        x, y = np.floor(ellipse[:2]).astype(int) - half
        local = np.asarray(ellipse) - np.array([x, y, 0, 0, 0])
        patch = image[y + half : y + 3 * half, x + half : x + 3 * half]
        patch += (INK - PAPER) * coverage(local, 2 * half, 2 * half, float(blur), 8)
    image = image[half:-half, half:-half] + np.random.default_rng(0).normal(0, noise_dn, (height, width))
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def confident(detections, ellipse, tolerance_px):
    """Whether a confident detection lies within the tolerance of an ellipse: centre and semi-axes."""
    return any(
        d.confidence > 0.5 and np.abs(d.edges.ellipse[:4] - np.asarray(ellipse)[:4]).max() < tolerance_px
        for d in detections
    )


def grid(columns, rows, pitch_px, a_px, b_px, seed=1):
    generator = np.random.default_rng(seed)
    at = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
    centres = pitch_px * (at + 0.5) + generator.uniform(-0.5, 0.5, (len(at), 2))
    shapes = np.broadcast_to([a_px, b_px], (len(at), 2))
    return np.column_stack([centres, shapes, generator.uniform(0, 180, len(at))])


def test_small_circles():
    ellipses = grid(12, 8, 40.0, 5.5, 4.0)
    found = detect(drawn(ellipses, 480, 320))
    # Noise of 2 dn of 170 leaves 0.03 px; a neighbour's contour would be off by pixels.
    assert np.mean([confident(found, e, 0.3) for e in ellipses]) >= 0.95
    assert len(found) == len(ellipses)


def test_tilted_and_small_circles():
    ellipses = grid(12, 8, 40.0, 11.0, 4.5)
    found = detect(drawn(ellipses, 480, 320, blur_px=1.0))
    assert np.mean([confident(found, e, 0.3) for e in ellipses]) >= 0.95


def test_blurred_circles_beside_sharp_ones():
    ellipses = grid(6, 3, 100.0, 24.0, 20.0)
    blurs = np.where(np.arange(len(ellipses)) % 6 < 3, 0.6, 6.0)
    found = detect(drawn(ellipses, 600, 300, blurs, half=50))
    # The model of a curved edge is first order in the blur's variance over the size: 36 / 22 px, 20 % of it.
    assert all(confident(found, e, 0.2 if blur < 1 else 0.5) for e, blur in zip(ellipses, blurs, strict=True))
    assert len(found) == len(ellipses)


@pytest.mark.parametrize("x", [18.0, 8.0])
def test_circles_cut_by_the_border_are_found_and_say_so(x):
    ellipse = np.array([x, 150.4, 30.0, 24.0, 20.0])
    visible = np.mean(ellipse_points(ellipse, 3600)[:, 0] > -0.5)
    (found,) = detect(picture([(ellipse, INK)], 400, 300, blur_px=0.5, noise_dn=2.0))
    assert found.cut
    assert found.visible == pytest.approx(visible, abs=0.03)  # of 64 steps
    assert found.confidence > 0.5
    # Noise of 2 dn, and three fifths of the contour: some hundredths of a pixel.
    assert np.abs(found.edges.ellipse[:4] - ellipse[:4]).max() < 0.2
    (whole,) = detect(picture([([200.3, 150.4, 30.0, 24.0, 20.0], INK)], 400, 300, blur_px=0.5, noise_dn=2.0))
    assert not whole.cut


def test_both_contours_of_blurred_rings():
    outer = grid(5, 3, 80.0, 26.0, 22.0)
    for blur_px in (0.5, 2.0):
        ink = drawn(outer, 400, 240, blur_px, 0.0, 40).astype(float) - PAPER
        paper = drawn(outer * [1, 1, 0.45, 0.45, 1], 400, 240, blur_px, 0.0, 40).astype(float) - PAPER
        image = PAPER + ink - paper + np.random.default_rng(2).normal(0, 2.0, ink.shape)
        found = detect(np.clip(np.rint(image), 0, 255).astype(np.uint8))
        assert all(confident(found, e, 0.3) for e in outer)
        assert [len(d.inner) for d in found] == [1] * len(outer)


def test_a_board_of_hundreds_of_circles():
    ellipses = grid(24, 16, 40.0, 12.0, 10.0)
    found = detect(drawn(ellipses, 960, 640))
    assert len(found) == len(ellipses)
    assert all(confident(found, e, 0.2) for e in ellipses)


def clutter(width, height, count, seed=3):
    """Leaves and outlines with many bends, their edges as soft as a camera's."""
    generator = np.random.default_rng(seed)
    image = np.full((height, width), 150, np.uint8)
    for i in range(count):
        size, turn = float(np.exp(generator.uniform(1.5, 4.5))), generator.uniform(0, 2 * np.pi)
        u = np.linspace(0, 2 * np.pi, 60)
        if i % 2:
            points = np.stack([size * np.cos(u), 0.35 * size * np.sign(np.sin(u)) * np.sin(u) ** 2], axis=1)
        else:
            waves = sum(generator.normal() * np.cos(n * u + generator.uniform(0, 6)) / n for n in range(2, 6))
            points = (size * (1 + 0.25 * waves))[:, None] * np.stack([np.cos(u), np.sin(u)], axis=1)
        c, s = np.cos(turn), np.sin(turn)
        points = points @ np.array([[c, s], [-s, c]]) + generator.uniform(0, [width, height])
        level = int(generator.integers(20, 230))
        cv2.fillPoly(image, [np.rint(points * 16).astype(np.int32)], level, cv2.LINE_AA, 4)
    return cv2.GaussianBlur(image, (0, 0), 0.8).astype(float)


def test_circles_in_clutter():
    image = clutter(1200, 900, 500)
    ellipses = grid(4, 3, 300.0, 34.0, 27.0)
    noise = np.random.default_rng(4).normal(0, 2.0, image.shape)
    for ellipse in ellipses:
        x, y = np.rint(ellipse[:2]).astype(int)
        image[y - 50 : y + 51, x - 52 : x + 53] = PAPER
        cover = coverage(ellipse, 1200, 900, 0.7, 8)
        image = image * (1 - cover) + INK * cover
    found = [d for d in detect(np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)) if d.confidence > 0.5]
    assert all(confident(found, e, 0.2) for e in ellipses)
    assert len(found) == len(ellipses)


def test_leaves_alone_are_no_circles():
    image = clutter(1200, 900, 500) + np.random.default_rng(5).normal(0, 2.0, (900, 1200))
    assert [d for d in detect(np.clip(np.rint(image), 0, 255).astype(np.uint8)) if d.confidence > 0.5] == []


@pytest.mark.slow
def test_ten_thousand_circles_take_time_by_their_number():
    def seconds(columns, rows):
        image = drawn(grid(columns, rows, 30.0, 9.0, 8.0), 30 * columns, 30 * rows, half=15)
        began = time.process_time()
        assert len(detect(image)) >= 0.99 * columns * rows
        return time.process_time() - began

    seconds(20, 20)  # loads the compiled kernels
    small, large = seconds(50, 50), seconds(100, 100)
    assert large < 6 * small + 0.5  # four times as many; all pairs take 16 times as long
