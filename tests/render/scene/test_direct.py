"""Direct light on matte things against Mitsuba's integrator."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers_studies import small_study

from roundel.render.radiance import _estimate, _Shot
from roundel.render.rays.rays import optics_of
from roundel.render.scene.scene import build_scene, trace_built
from roundel.scenes.world.frame import frame_of

LIGHT = "light: {environment: 0.7, lamps: [{position_m: [-0.3, -0.5, 0.0], size_m: 0.2, radiance: 6}]}"
CARD = "occluders: [{shape: rectangle, x_m: -0.05, y_m: 0.02, z_m: 0.06, width_m: 0.06, height_m: 0.12}]"
LAMPS = {
    "area": "light: {environment: 0.7, lamps: [{position_m: [-0.3, -0.5, 0.0], size_m: 0.2, radiance: 6}]}",
    "two": "light: {environment: 0.3, lamps: [{position_m: [-0.3, -0.5, 0.0], size_m: 0.2, radiance: 6}, "
    "{kind: point, position_m: [0.3, -0.4, 0.0], intensity: 0.4}]}",
    "spot": "light: {environment: 0.2, lamps: [{kind: spot, position_m: [-0.2, -0.3, 0.0], intensity: 1, "
    "cutoff_deg: 25, beam_deg: 10}]}",
    "dark": "light: {environment: 0.0, lamps: [{position_m: [-0.3, -0.5, 0.0], size_m: 0.05, radiance: 90}]}",
    "sky": "light: {environment: 1.0}",
}


@pytest.mark.parametrize("lamps", list(LAMPS))
def test_direct_light_agrees_with_mitsubas_integrator(mi, tmp_path: Path, lamps: str) -> None:
    import drjit as dr

    frame = frame_of(small_study(tmp_path, (LIGHT, f"{LAMPS[lamps]}\n{CARD}")), 1)
    built = build_scene(mi, frame)
    assert built.direct is not None
    path = replace(built, direct=None, integrator=mi.load_dict({"type": "path", "max_depth": 2, "rr_depth": 9}))
    pixels = np.arange(0, frame.camera.width_px * frame.camera.height_px, 7)
    found = []
    for which, samples in ((built, 256), (path, 1024)):
        shot = _Shot(dr, mi, frame, optics_of(dr, mi, frame), lambda s, r, which=which: trace_built(which, s, r))
        found.append(_estimate(shot, pixels, samples, 5, ())[:2].astype(float))
    (mean, variance), (other, noise) = found
    error = np.sqrt(variance.sum() + noise.sum()) / len(mean)
    assert mean.mean() == pytest.approx(other.mean(), abs=4 * error + 1e-6)
    ratio = (mean - other) / np.sqrt(variance + noise + 1e-12)
    # Of pixels whose noise is known from eight replicates: the RMS of such ratios is 1.1 to 1.3.
    assert np.sqrt(np.mean(np.square(np.clip(ratio, -5, 5)))) < 1.4


def test_sectors_behind_a_card_are_traced(mi, tmp_path: Path) -> None:
    """Where a ray hits no sheet its ink's numbers are 0: a remainder by the number of sectors killed the process."""
    import drjit as dr

    sectors = "marker: {kind: coded_rings, diameter_m: 0.08, code: ['1100110101001101']}"
    frame = frame_of(
        small_study(tmp_path, (LIGHT, f"{LIGHT}\n{CARD}"), ("marker: {kind: disc, diameter_m: 0.08}", sectors)), 1
    )
    built = build_scene(mi, frame)
    shot = _Shot(dr, mi, frame, optics_of(dr, mi, frame), lambda s, r: trace_built(built, s, r))
    mean = _estimate(shot, np.arange(frame.camera.width_px * frame.camera.height_px), 16, 5, ())[0]
    assert np.isfinite(mean).all()
    assert mean.max() > 4 * mean.min()
