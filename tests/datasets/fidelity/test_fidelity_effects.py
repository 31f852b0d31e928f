"""Renders of each effect alone, and of all together, agree with the float64 prediction."""

from pathlib import Path

import pytest
from helpers_effects import CAMERA, EFFECTS, Edits
from helpers_studies import small_study

from roundel.datasets.fidelity.measure import measure_circle
from roundel.datasets.fidelity.summary import fidelity_lines, summarise
from roundel.render.radiance import render_radiance
from roundel.scenes.world.frame import frames_of

pytestmark = pytest.mark.slow

# Rays of 2,048 a pixel of the edge: over eight frames the interval of a blurred edge's shift is then some 0.001 px.
FRAMES = 8
PICTURE: Edits = (
    ("width_px: 160, height_px: 120", "width_px: 200, height_px: 150"),
    ("band_samples: 256", "band_samples: 2048, target_error: 0"),
    ("frames: 4", f"frames: {FRAMES}"),
)

# More of what must be predicted: a bladed aperture, a mosaic whose colours are diffracted or magnified each its own
# way, pixels with gaps, light that falls off, other edges within the blur.
BLADED = (CAMERA, CAMERA + ", aperture_mm: 20, focus_m: 0.45, blades: 5, blade_turn_deg: 20")
COLOURED = (
    (CAMERA, CAMERA + ", aperture_mm: 0.1, focus_m: 0.64, diffraction: true, wavelengths_nm: [650, 550, 450]"),
    ("light:", "sensor: {mosaic: rggb, fill_factor: 0.5}\nlight:"),
    ("radiance: 6}]}", "radiance: 6, colour: [1.0, 0.6, 0.3]}]}"),
)
ABERRATED = (
    (CAMERA, CAMERA + ", distortion: [-0.15, 0.02, 0, 0], lateral_ca: [1.004, 0.996]"),
    ("light:", "sensor: {mosaic: grbg}\nlight:"),
)
NEAR = (
    *EFFECTS["defocus"],
    ("{kind: disc, diameter_m: 0.08}", "{kind: ring, diameter_m: 0.08, inner_diameter_m: 0.06, margin_m: 0.005}"),
)
CASES = {**EFFECTS, "blades": (BLADED,), "colours": COLOURED, "aberration": ABERRATED, "ring_near_the_wall": NEAR}


@pytest.mark.parametrize("name", CASES)
def test_the_bias_of_an_edge_is_below_what_is_promised(mi, tmp_path: Path, name: str) -> None:
    measured = []
    for frame in frames_of(small_study(tmp_path, *CASES[name], *PICTURE)):
        radiance = render_radiance(mi, frame)
        measured.append(measure_circle(frame, 0, radiance.mean, radiance.variance))
    found = summarise(measured)
    print(name, *fidelity_lines(found), f"z rms {found.get('z_rms', 0):.3f}", sep="\n")
    assert found["circles"] == FRAMES
    # 0.002 px of a sharp edge, 0.005 px of any other: the 95 % interval of the mean must lie within.
    assert found["shift_bound_px"] <= (0.002 if name == "sharp" else 0.005)
    assert found["z_consistent"]
