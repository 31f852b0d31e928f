"""Curves that files declare: ICC profiles and PNG chunks."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from PIL import Image, ImageCms, PngImagePlugin

from roundel.scenes.camera.response_curve import LINEAR
from roundel.solver.photos.file_curve import declared_curve
from roundel.solver.photos.photo_file import read_photo


def profile(curve: bytes, tag: bytes = b"gTRC") -> bytes:
    """A profile with a single tag."""
    return bytes(128) + struct.pack(">I4sII", 1, tag, 144, len(curve)) + curve


def parametric(kind: int, *values: float) -> bytes:
    return (
        b"para"
        + bytes(4)
        + struct.pack(">HH", kind, 0)
        + struct.pack(f">{len(values)}i", *(round(65536 * v) for v in values))
    )


def table(values: np.ndarray) -> bytes:
    return (
        b"curv"
        + bytes(4)
        + struct.pack(f">I{len(values)}H", len(values), *np.rint(65535 * values).astype(int).tolist())
    )


SRGB_PARAMETERS = (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)


@pytest.mark.parametrize(
    ("curve", "kind"),
    [
        (b"curv" + bytes(8), "linear"),
        (b"curv" + bytes(4) + struct.pack(">IH", 1, round(256 * 2.2)), "gamma:2.199"),
        (parametric(3, *SRGB_PARAMETERS), "srgb"),
        (parametric(4, *SRGB_PARAMETERS, 0.0, 0.0), "srgb"),
        (parametric(0, 1.8), "gamma:1.8"),
        (parametric(1, 1.0, 1.0, 0.0), "linear"),
        (table(np.linspace(0, 1, 1024) ** 1.8), "gamma:1.8"),
        (table(np.linspace(0, 1, 2)), "linear"),
    ],
)
def test_profiles(curve, kind):
    found = declared_curve({"icc_profile": profile(curve)})
    assert str(found) == kind
    assert found.basis == "the file's ICC profile"
    assert str(declared_curve({"icc_profile": profile(curve, b"kTRC")})) == kind


@pytest.mark.parametrize(
    "data",
    [b"", b"short", bytes(128), bytes(128) + b"\xff" * 40, profile(b"para" + bytes(4) + b"\0\x09" + bytes(40)),
     profile(b"curv\0\0\0\0\xff\xff\xff\xff"), profile(table(np.linspace(1, 0, 64))), profile(table(np.zeros(64))),
     profile(parametric(3, 2.4, -1.0, 0.0, 0.0, 0.0)), profile(table(np.linspace(0, 1, 64) > 0.5))],
)  # fmt: skip
def test_damaged_profiles_say_nothing(data):
    assert declared_curve({"icc_profile": data}) is None


def test_the_profile_of_littlecms_is_srgb():
    data = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    assert str(declared_curve({"icc_profile": data})) == "srgb"


def test_chunks_of_a_png(tmp_path):
    ramp = np.arange(256, dtype=np.uint8).reshape(16, 16)

    def saved(name: str, *chunks: tuple[bytes, bytes]) -> str:
        info = PngImagePlugin.PngInfo()
        for chunk in chunks:
            info.add(*chunk)
        Image.fromarray(ramp).save(tmp_path / name, pnginfo=info)
        return str(read_photo(tmp_path / name).photometry.curve)

    assert saved("plain.png") == "srgb"
    assert saved("linear.png", (b"gAMA", struct.pack(">I", 100_000))) == "linear"
    assert saved("gamma.png", (b"gAMA", struct.pack(">I", 45_455))) == "srgb"
    assert saved("adobe.png", (b"gAMA", struct.pack(">I", 55_556))) == "gamma:1.8"
    assert saved("said.png", (b"sRGB", b"\0"), (b"gAMA", struct.pack(">I", 100_000))) == "srgb"
    assert np.array_equal(read_photo(tmp_path / "linear.png").grey, ramp)
    # What is given has priority.
    assert read_photo(tmp_path / "plain.png", LINEAR).photometry.curve == LINEAR


def test_the_curve_of_a_photograph_has_a_reason(tmp_path):
    Image.fromarray(np.zeros((16, 16, 3), np.uint8)).save(tmp_path / "a.jpg", quality=50)
    photometry = read_photo(tmp_path / "a.jpg").photometry
    assert str(photometry.curve) == "srgb"
    assert "unless their file says otherwise" in photometry.curve.basis
    assert photometry.jpeg is not None
    assert photometry.jpeg[0] == 16  # the standard's table K.1
    assert photometry.step_dn == 1.0
    assert photometry.averaged == pytest.approx(0.2126**2 + 0.7152**2 + 0.0722**2)
