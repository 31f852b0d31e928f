"""Caveats of photographs on the terminal and in `estimates.json`."""

from __future__ import annotations

import json

import numpy as np
from helpers_images import picture
from PIL import Image

from roundel.cli.main import main
from roundel.scenes.camera.srgb import linear_to_srgb

DISCS = [(np.array([150.3, 110.2, 30.0, 22.0, 20.0]), 30.0), (np.array([262.0, 180.0, 30.0, 24.0, 0.0]), 40.0)]


def photograph(path, layers, gain=1.0):
    light = gain * picture(layers, 280, 240, blur_px=0.6) + np.random.default_rng(0).normal(0, 1, (240, 280))
    Image.fromarray(np.rint(255 * linear_to_srgb(np.clip(light, 0, 255) / 255)).astype(np.uint8)).save(path)
    return str(path)


def test_sentences_of_one_circle_and_counts_of_several(tmp_path, capsys):
    one = photograph(tmp_path / "one.png", DISCS[:1], gain=1.5)
    two = photograph(tmp_path / "two.png", DISCS)
    assert main(["solve", one, two, str(tmp_path / "out"), "--diameter-m", "0.08"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith(one)
    assert any(line.startswith("    ") and "of the edge's pixels are clipped" in line for line in lines)
    assert "    1 of 2: cut by the image's border" in lines
    record = json.loads((tmp_path / "out" / "estimates.json").read_text())
    (estimate,) = record["photographs"][0]["detections"][0]["estimates"]
    assert estimate["clipped_fraction"] > 0
    assert estimate["curve"] == "srgb: photographs are sRGB unless their file says otherwise"
    assert any("clipped" in text for text in estimate["caveats"])


def test_a_curve_is_estimated_or_refused(tmp_path, capsys):
    file = photograph(tmp_path / "a.png", DISCS[:1])
    assert main(["solve", file, str(tmp_path / "out"), "--diameter-m", "0.08", "--curve", "estimate"]) == 0
    assert "the response curve was estimated: sRGB" in capsys.readouterr().out
    assert main(["solve", file, str(tmp_path / "out"), "--diameter-m", "0.08", "--curve", "srbg"]) == 2
    assert "unknown curve 'srbg'; did you mean srgb?" in capsys.readouterr().err
