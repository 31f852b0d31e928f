"""Light transport in a world: all lights are sampled where a ray first lands, then Mitsuba's path integrator goes on.

Nearly all the noise of a room comes from the first landing: from which of its lights is looked for, and where on it
(measured: without indirect light the variance of a pixel is the same). Looking for all of them there, each once, is
dearer by a shadow ray and takes half of the variance away.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

# With a sky, whose sun and dome are one emitter, the one light is looked for this often.
_SKY_LOOKS = 2


def radiance_along(
    mi: Any, scene: Any, onward: Any, emitters: Sequence[Any], sampler: Any, ray: Any
) -> tuple[Any, Any]:
    """Radiance along rays.

    Parameters
    ----------
    mi : module
    scene : mitsuba.Scene
    onward : mitsuba.Integrator
        A path integrator for the light that comes over further bodies; it counts the light that a ray meets first.
    emitters : sequence
        The emitters of the scene.
    sampler : mitsuba.Sampler
    ray : mitsuba.Ray3f

    Returns
    -------
    radiance : Spectrum
    hit : SurfaceInteraction3f
        What the rays meet first.
    """
    hit = scene.ray_intersect(ray)
    radiance = hit.emitter(scene).eval(hit)
    context, bsdf = mi.BSDFContext(), hit.bsdf(ray)
    landed = hit.is_valid()
    looks = _SKY_LOOKS if len(emitters) == 1 else 1
    for emitter in emitters:
        for _ in range(looks):
            found, light = emitter.sample_direction(hit, sampler.next_2d(), landed)
            lit = landed & (found.pdf > 0) & ~scene.ray_test(hit.spawn_ray_to(found.p), landed & (found.pdf > 0))
            reflected, pdf = bsdf.eval_pdf(context, hit, hit.to_local(found.d), lit)
            # A ray in a drawn direction never meets a point.
            weight = _keep(found.delta, _balance(mi, looks * found.pdf, pdf))
            radiance += _where(lit, reflected * light * (weight / looks))
    drawn, share = bsdf.sample(context, hit, sampler.next_1d(), sampler.next_2d(), landed)
    further = hit.spawn_ray(hit.to_world(drawn.wo))
    next_hit = scene.ray_intersect(further, landed)
    beyond = next_hit.emitter(scene)
    met = beyond.eval(next_hit, landed)
    toward = mi.DirectionSample3f(scene, next_hit, hit)
    is_delta = mi.has_flag(drawn.sampled_type, mi.BSDFFlags.Delta)
    chance = beyond.pdf_direction(hit, toward, landed & ~is_delta)
    weight = _balance(mi, drawn.pdf, looks * chance)
    incoming, _, _ = onward.sample(scene, sampler, further, None, landed)
    # The light met directly has been looked for already: it counts with its weight, the rest in full.
    radiance += _where(landed & (drawn.pdf > 0), share * (incoming - met + met * _keep(is_delta, weight)))
    return radiance, hit


def _balance(mi: Any, a: Any, b: Any) -> Any:
    """Power heuristic of two densities (Veach 1997)."""
    import drjit as dr

    return dr.select(a > 0, dr.square(a) / (dr.square(a) + dr.square(b)), mi.Float(0.0))


def _where(mask: Any, value: Any) -> Any:
    import drjit as dr

    return dr.select(mask, value, type(value)(0.0))


def _keep(always: Any, weight: Any) -> Any:
    import drjit as dr

    return dr.select(always, type(weight)(1.0), weight)
