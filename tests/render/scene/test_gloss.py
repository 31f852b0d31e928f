"""Gloss in closed form against Mitsuba's integrators."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers_studies import small_study

from roundel.render.radiance import _estimate, _Shot
from roundel.render.rays.rays import optics_of
from roundel.render.scene.scene import build_scene, trace_built
from roundel.render.scene.transport import is_plain, plain_scene, trace
from roundel.scenes.world.frame import frame_of

LIGHT = "light: {environment: 0.7, lamps: [{position_m: [-0.3, -0.5, 0.0], size_m: 0.2, radiance: 6}]}"
POINTS = "light: {environment: 0.7, lamps: [{kind: point, position_m: [-0.3, -0.5, 0.0], intensity: 0.3}]}"


@pytest.mark.parametrize("surface", ["{kind: plastic}", "{kind: laminate}", "{kind: plastic, roughness: 0.02}"])
@pytest.mark.parametrize("light", [LIGHT, POINTS])
def test_gloss_agrees_with_mitsubas_integrator(mi, tmp_path: Path, surface: str, light: str) -> None:
    import drjit as dr

    study = small_study(
        tmp_path,
        (LIGHT, light),
        ("{kind: disc, diameter_m: 0.08}", f"{{kind: disc, diameter_m: 0.08, surface: {surface}}}"),
    )
    frame = frame_of(study, 1)
    assert is_plain(frame)
    plain, built = plain_scene(dr, mi, frame), build_scene(mi, frame)
    direct = {"type": "direct", "emitter_samples": 1, "bsdf_samples": 4}
    built = replace(built, integrator=mi.load_dict(direct))
    pixels = np.arange(0, frame.camera.width_px * frame.camera.height_px, 7)
    found = []
    for tracer, samples in (
        (lambda sampler, ray: trace(dr, mi, plain, sampler, ray), 64),
        (lambda sampler, ray: trace_built(built, sampler, ray), 1024),
    ):
        shot = _Shot(dr, mi, frame, optics_of(dr, mi, frame), tracer)
        found.append(_estimate(shot, pixels, samples, 5, ())[:2].astype(float))
    (mean, variance), (other, noise) = found
    # The table's albedo is good to a few 1e-4, and to a thousandth the whole agrees, beyond the noise of the means.
    error = np.sqrt(variance.sum() + noise.sum()) / len(mean)
    assert mean.mean() == pytest.approx(other.mean(), abs=1e-3 * other.mean() + 3 * error)
    # Pixel by pixel, too, within their noise.
    ratio = (mean - other) / np.sqrt(variance + noise + (2e-3 * other) ** 2)
    assert np.sqrt(np.mean(np.square(ratio))) < 1.5
    # The closed form is what makes it cheap: a tenth of the variance or less for the same rays.
    assert np.median(variance) * 64 < 0.1 * np.median(noise) * 1024
