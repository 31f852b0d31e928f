"""Direct light on matte things: where a ray lands, each lamp is looked for once, and the uniform sky once.

Mitsuba's own direct integrator intersects in full where only visibility is asked for, and the camera's rays twice. Here
a landing is followed by one shadow ray for each lamp and one for the sky, in a direction drawn from the reflection:
where nothing is in its way, the sky is there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from roundel.scenes.world.frame import Frame


@dataclass(frozen=True)
class DirectLight:
    """Pointers to the lamps of a scene, and the radiance (Spectrum) of its sky; None if it is black."""

    lamps: Sequence[Any]
    sky: Any


def has_direct_light(frame: Frame) -> bool:
    """Whether a frame's light is of this kind: matte sheets, one reflection, a uniform sky."""
    light = frame.settings.light
    return (
        frame.settings.render.bounces == 1
        and light.map is None
        and light.sky is None
        and all(view.settings.marker.surface.kind == "matte" for view in frame.views())
    )


def direct_light(mi: Any, scene: Any) -> DirectLight:
    """The lights of a scene; numbers are opaque to the tracer, so that frames share kernels."""
    import drjit as dr

    lamps = [mi.EmitterPtr(emitter) for emitter in scene.emitters() if not emitter.is_environment()]
    for lamp in lamps:
        dr.make_opaque(lamp)
    sky = None
    if scene.environment() is not None:
        sky = mi.Spectrum(scene.environment().eval(dr.zeros(mi.SurfaceInteraction3f)))
        dr.make_opaque(sky)
    return DirectLight(lamps, sky)


def direct_radiance(mi: Any, scene: Any, light: DirectLight, sampler: Any, ray: Any) -> tuple[Any, Any]:
    """Radiance (Spectrum) along rays (RayDifferential3f), and what they meet first (SurfaceInteraction3f)."""
    import drjit as dr

    hit = scene.ray_intersect(ray)
    landed, context, bsdf = hit.is_valid(), mi.BSDFContext(), hit.bsdf(ray)
    radiance = hit.emitter(scene).eval(hit)
    for lamp in light.lamps:
        sample, arriving = lamp.sample_direction(hit, sampler.next_2d(), landed)
        lit = landed & (sample.pdf > 0)
        lit &= ~scene.ray_test(hit.spawn_ray_to(sample.p), lit)
        reflected = bsdf.eval(context, hit, hit.to_local(sample.d), lit)
        radiance += dr.select(lit, reflected * arriving, 0.0)
    if light.sky is not None:
        # Matte things have nothing to choose with the first number.
        drawn, share = bsdf.sample(context, hit, mi.Float(0.5), sampler.next_2d(), landed)
        free = landed & (drawn.pdf > 0)
        free &= ~scene.ray_test(hit.spawn_ray(hit.to_world(drawn.wo)), free)
        radiance += dr.select(free, share * light.sky, 0.0)
    return radiance, hit
