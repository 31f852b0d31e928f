"""Fuzz `locate` with hypothesis: images of all kinds, with or without ellipses, and cameras that may be absurd.

Requirement: a list of estimates that are finite or give a reason, or a one-line ValueError. A warning, an exception
from an underlying library, or half a minute for such a small image is a failure.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from typing import Any

import numpy as np
from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from roundel.scenes.camera.model import Camera
from roundel.solver.methods.locate import locate

DTYPES = ("uint8", "uint16", "int8", "int16", "int32", "uint32", "int64", "float16", "float32", "float64", "bool")
_SLOW_S = 30.0
_numbers = st.floats(allow_nan=True, allow_infinity=True)


@st.composite
def images(draw: st.DrawFn) -> NDArray[Any]:
    """Varying light, overlapping ellipses, blur, noise, saturation; then a data type, channels and a memory layout."""
    height, width = draw(st.integers(1, 300)), draw(st.integers(1, 300))
    if draw(st.integers(0, 3)) == 0:
        height = draw(st.integers(1, 12))
    y, x = np.mgrid[:height, :width].astype(np.float64)
    level = st.floats(0.0, 1.0)
    image = draw(level) + draw(st.floats(-2, 2)) * x / width + draw(st.floats(-2, 2)) * y / height
    for _ in range(draw(st.integers(0, 6))):
        cx, cy = draw(st.floats(-0.3, 1.3)) * width, draw(st.floats(-0.3, 1.3)) * height
        a = draw(st.floats(0.5, 200.0))
        b = a * draw(st.floats(0.01, 1.0))
        angle = draw(st.floats(0.0, np.pi))
        u = ((x - cx) * np.cos(angle) + (y - cy) * np.sin(angle)) / a
        v = ((y - cy) * np.cos(angle) - (x - cx) * np.sin(angle)) / b
        shape = draw(st.sampled_from(["ellipse", "ellipse", "ellipse", "ring", "box"]))
        radius = np.maximum(np.abs(u), np.abs(v)) if shape == "box" else np.hypot(u, v)
        # The edge is one pixel wide at its steepest, as in an antialiased drawing.
        cover = np.clip(0.5 + (1.0 - radius) * b, 0.0, 1.0)
        if shape == "ring":
            cover = cover * np.clip(0.5 + (radius - draw(st.floats(0.1, 0.9))) * b, 0.0, 1.0)
        image = image + (draw(level) - image) * cover
    blur = draw(st.sampled_from([0.0, 0.0, 0.5, 1.5, 5.0]))
    if blur:
        image = gaussian_filter(image, blur)
    noise = draw(st.sampled_from([0.0, 0.0, 0.003, 0.02, 0.3]))
    if noise:
        image = image + np.random.default_rng(draw(st.integers(0, 2**32))).normal(0.0, noise, image.shape)
    return _dressed(draw, np.clip(image, 0.0, 1.0) if draw(st.booleans()) else image)


def _dressed(draw: st.DrawFn, image: NDArray[np.float64]) -> NDArray[Any]:
    dtype = np.dtype(draw(st.sampled_from(DTYPES)))
    out: NDArray[Any]
    if dtype == np.bool_:
        out = image > draw(st.floats(0.0, 1.0))
    elif dtype.kind == "f":
        scale = draw(st.sampled_from([1.0, 255.0, 65535.0, 1e-6, 1e30, 1e300]))
        with np.errstate(over="ignore"):  # infinity is a valid test image
            out = (image * scale).astype(dtype)
        if draw(st.integers(0, 9)) == 0:
            at = draw(st.integers(0, out.shape[0] - 1)), draw(st.integers(0, out.shape[1] - 1))
            with np.errstate(over="ignore"):
                out[at] = draw(_numbers)
    else:
        limit = np.iinfo(dtype)
        top = draw(st.sampled_from([limit.max, min(255, limit.max), min(4095, limit.max), 1]))
        # The limits of 64 bits round up in float64: stay below them.
        out = np.clip(np.rint(image * top), limit.min * 0.99, limit.max * 0.99).astype(dtype)
    channels = draw(st.sampled_from([0, 0, 0, 1, 3, 4, 2, 5]))
    if channels:
        out = np.repeat(out[..., None], channels, axis=2)
    layout = draw(st.sampled_from(["C", "C", "Fortran", "reversed", "read-only", "swapped"]))
    if layout == "Fortran":
        out = np.asfortranarray(out)
    elif layout == "reversed":
        out = out[::-1, ::-1]
    elif layout == "read-only":
        out.flags.writeable = False
    elif layout == "swapped":
        out = out.astype(out.dtype.newbyteorder())
    return out


@st.composite
def cameras(draw: st.DrawFn, width: int, height: int) -> Camera | None:
    if draw(st.booleans()):
        return None
    usual = st.floats(10.0, 5000.0)
    number = st.one_of(usual, usual, _numbers)
    if draw(st.booleans()):
        number = usual
    k = np.array([[draw(number), 0.0, draw(number)], [0.0, draw(number), draw(number)], [0.0, 0.0, 1.0]])
    model = draw(st.sampled_from(["opencv", "opencv", "fisheye"]))
    count = draw(st.sampled_from([0, 4, 4, 5, 8, 12, 14, 3])) if model == "opencv" else 4
    coefficient = st.one_of(st.floats(-0.3, 0.3), st.floats(-0.01, 0.01), _numbers)
    return Camera(width, height, k, tuple(draw(coefficient) for _ in range(count)), distortion_model=model)


@st.composite
def calls(draw: st.DrawFn) -> tuple[NDArray[Any], float, Camera | None, Any]:
    image = draw(images())
    diameter = draw(st.one_of(st.just(0.08), st.just(0.08), _numbers))
    knowledge = draw(st.sampled_from([None, None, "same_side", "opposite_side"]))
    return image, diameter, draw(cameras(image.shape[1], image.shape[0])), knowledge


def check(image: NDArray[Any], diameter_m: float, camera: Camera | None, knowledge: Any) -> None:
    before = np.array(image)
    began = time.perf_counter()
    try:
        estimates = locate(image, diameter_m, camera, knowledge=knowledge)
    except ValueError as error:
        if not str(error) or "\n" in str(error):
            raise AssertionError("an error must be one line") from error
        return
    took = time.perf_counter() - began
    assert took < _SLOW_S, f"{took:.0f} s"
    np.testing.assert_array_equal(image, before)
    for estimate in estimates:
        if not estimate:
            assert estimate.reason, "a failure without a reason"
            continue
        assert np.all(np.isfinite(estimate.ellipse)), estimate.ellipse
        assert np.all(np.isfinite(estimate.centre_m)), estimate.centre_m
        assert np.all(estimate.centre_m[:, 2] > 0), estimate.centre_m
        np.testing.assert_allclose(np.linalg.norm(estimate.normal, axis=-1), 1.0, atol=1e-9)
        assert np.all(np.sum(estimate.normal * estimate.centre_m, axis=-1) <= 1e-12 * np.abs(estimate.centre_m).max())
        assert abs(sum(estimate.probability) - 1.0) < 1e-9, estimate.probability
        assert len(estimate.rows()) == 2


def fuzz(seconds: float, first_seed: int) -> int:
    """Run until the time is over; return the number of examples. Hypothesis raises the smallest failing example."""
    until, count, turn = time.monotonic() + seconds, 0, first_seed

    def one(call: tuple[NDArray[Any], float, Camera | None, Any]) -> None:
        nonlocal count
        if time.monotonic() < until:
            count += 1
            check(*call)

    while time.monotonic() < until:
        batch = settings(
            max_examples=200, deadline=None, database=None, suppress_health_check=list(HealthCheck), print_blob=True
        )(seed(turn)(given(calls())(one)))
        batch()
        turn += 1
    return count


def main() -> int:
    parser = argparse.ArgumentParser(description="Fuzz `locate` with hypothesis.")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    warnings.simplefilter("error")
    np.set_printoptions(threshold=40)
    print(f"images: {fuzz(asked.seconds, asked.seed)} calls, no failure")
    return 0


if __name__ == "__main__":
    sys.exit(main())
