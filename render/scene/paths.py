"""Light transport in a world: paths go on in waves, from one landing to the next.

At each landing a path counts the light that it met there, looks for lamps, and is reflected. Then it ends with a chance
that grows as less of its light can reach the camera, and what is left is packed together: few lanes of the processor's
vectors are idle, and all waves but the first share one kernel, whatever the number of samples.

Russian roulette (Arvo and Kirk 1990) is unbiased, and adds noise where all or nothing is counted of the light of
further reflections. Here every path counts a guess of it beforehand, the mean light of the room, and a path that goes
on gives the guess back: it cancels in the mean. The guess is never so large that a path's light becomes negative.

Panes of thin glass let light straight through: whoever looks for a lamp sees it through them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

# With a sky, whose sun and dome are one emitter, the one light is looked for this often at the first landing.
_SKY_LOOKS = 2

# The chance to go on, over the path's share of the light that it may still find. Measured on tabletops: between 2 and
# 6 the product of time and variance hardly changes.
_CHANCE = 3.0


@dataclass(frozen=True)
class Lit:
    """A world for tracing: `ambient` is a rough mean of its radiance, `panes` says whether it has thin glass."""

    mi: Any
    scene: Any
    emitters: Sequence[Any]
    ambient: Any
    panes: bool


@dataclass(frozen=True)
class Path:
    """Where paths go on.

    Attributes
    ----------
    origin, direction : Point3f, Vector3f
        Of the next ray.
    share : Spectrum
        Factor on the light that it finds.
    landing : Point3f
        Where it was reflected last; panes do not count.
    pdf : Float
        Density of its direction there, times the chance to go on, for each time that a lamp was looked for; no lamp
        was where `is_delta`.
    is_delta : Bool
    """

    origin: Any
    direction: Any
    share: Any
    landing: Any
    pdf: Any
    is_delta: Any

    @property
    def parts(self) -> tuple[Any, ...]:
        """Its arrays, in the order of its attributes."""
        return self.origin, self.direction, self.share, self.landing, self.pdf, self.is_delta


@dataclass(frozen=True)
class FirstLanding:
    """What rays meet first: the light up to the first reflection, where they land, and which paths go on."""

    radiance: Any
    hit: Any
    path: Path
    alive: Any
    seed: Any


def first_landing(lit: Lit, sampler: Any, ray: Any) -> FirstLanding:
    """Trace rays (RayDifferential3f) to what they meet first, and look for all lamps there."""
    import drjit as dr

    mi = lit.mi
    hit = lit.scene.ray_intersect(ray)
    looks = _SKY_LOOKS if len(lit.emitters) == 1 else 1
    # No lamp was looked for from the camera: what it sees counts in full.
    path = Path(ray.o, ray.d, mi.Spectrum(1.0), ray.o, mi.Float(1.0), mi.Bool(True))
    found = hit.emitter(lit.scene).eval(hit)
    found, path, alive = _reflected(lit, sampler, hit, ray, hit.is_valid(), path, found, looks)
    seed = dr.reinterpret_array(mi.UInt32, dr.gather(mi.Float, sampler.next_1d(), mi.UInt32(0)))
    return FirstLanding(found, hit, path, alive, seed)


def follow(lit: Lit, first: FirstLanding, bounces: int) -> Any:
    """Radiance (Spectrum) of paths of up to `bounces` reflections between light and camera."""
    import drjit as dr

    mi = lit.mi
    radiance, path, alive = first.radiance, first.path, first.alive
    dr.eval(radiance, alive, first.seed, *path.parts)
    chosen: Any = dr.compress(alive)
    index = chosen
    for bounce in range(1, bounces + 1):
        count = dr.width(chosen)
        if count == 0:
            break
        sampler = mi.load_dict({"type": "independent", "sample_count": 1})
        sampler.seed(first.seed + dr.opaque(mi.UInt32, bounce), count)
        path = Path(*(dr.gather(type(part), part, chosen) for part in path.parts))
        found = dr.gather(mi.Spectrum, radiance, index)
        # A number, so that the kernel is the same: after the last reflection a path may still meet a lamp.
        reflects = dr.opaque(mi.Bool, bounce < bounces)
        found, path, alive = _wave(lit, sampler, path, found, reflects)
        # Each sample occurs once: nothing depends on the order of threads.
        dr.scatter(radiance, found, index)
        dr.eval(radiance, alive, *path.parts)
        chosen = dr.compress(alive)
        index = dr.gather(mi.UInt32, index, chosen)
    # A guess given back may leave some 1e-8 below zero, by rounding.
    return dr.maximum(radiance, 0.0)


def _wave(lit: Lit, sampler: Any, path: Path, found: Any, reflects: Any) -> tuple[Any, Path, Any]:
    """Paths to their next landing: the light found so far, what goes on from there, and where anything does."""
    import drjit as dr

    mi = lit.mi
    ray = mi.RayDifferential3f(mi.Ray3f(path.origin, path.direction))
    hit = lit.scene.ray_intersect(ray)
    emitter = hit.emitter(lit.scene)
    before = dr.zeros(mi.SurfaceInteraction3f, dr.width(path.pdf))
    before.p = path.landing
    looked = emitter.pdf_direction(before, mi.DirectionSample3f(lit.scene, hit, before), ~path.is_delta)
    weight = dr.select(path.is_delta, 1.0, _balance(mi, path.pdf, looked))
    found += path.share * emitter.eval(hit) * weight
    return _reflected(lit, sampler, hit, ray, hit.is_valid() & reflects, path, found, 1)


def _reflected(
    lit: Lit, sampler: Any, hit: Any, ray: Any, active: Any, came: Path, found: Any, looks: int
) -> tuple[Any, Path, Any]:
    """Look for lamps, each `looks` times; then reflection and roulette."""
    import drjit as dr

    mi, context, bsdf = lit.mi, lit.mi.BSDFContext(), hit.bsdf(ray)
    for emitter in [emitter for emitter in lit.emitters for _ in range(looks)]:
        sample, light = emitter.sample_direction(hit, sampler.next_2d(), active)
        clear = _clear(lit, hit, sample.p, active & (sample.pdf > 0))
        seen = dr.max(clear) > 0
        reflected, pdf = bsdf.eval_pdf(context, hit, hit.to_local(sample.d), seen)
        kept = came.share * reflected
        # The density with which a path would go on that way: that of the reflection times the chance.
        pdf *= _chance(dr.max(kept) / dr.maximum(pdf, 1e-9))
        # A ray in a drawn direction never meets a point.
        weight = dr.select(sample.delta, 1.0, _balance(mi, sample.pdf, pdf / looks)) / looks
        found += dr.select(seen, kept * light * clear * weight, 0.0)
    drawn, kept = bsdf.sample(context, hit, sampler.next_1d(), sampler.next_2d(), active)
    share, drawable = came.share * kept, active & (drawn.pdf > 0)
    chance = _chance(dr.max(share))
    alive = drawable & (sampler.next_1d() < chance)
    # A path that goes on gives back guess / chance: the guess is no larger than what keeps its light positive.
    most = found * chance / dr.maximum(1 - chance, 1e-6)
    guess = dr.select(drawable, dr.minimum(share * lit.ambient, most), 0.0)
    found = found + guess - dr.select(alive, guess / chance, 0.0)
    onward = hit.spawn_ray(hit.to_world(drawn.wo))
    # Straight on through a pane: a lamp behind it was looked for at the landing before.
    passes = mi.has_flag(drawn.sampled_type, mi.BSDFFlags.Null) if lit.panes else mi.Bool(False)
    landing = dr.select(passes, came.landing, hit.p)
    pdf = dr.select(passes, came.pdf, drawn.pdf * chance / looks)
    is_delta = dr.select(passes, came.is_delta, mi.has_flag(drawn.sampled_type, mi.BSDFFlags.Delta))
    return found, Path(onward.o, onward.d, dr.select(alive, share / chance, 0.0), landing, pdf, is_delta), alive


def _clear(lit: Lit, hit: Any, target: Any, active: Any) -> Any:
    """Share of the light (Spectrum) that comes to a landing from a point of a lamp: 0 behind a body."""
    import drjit as dr

    mi = lit.mi
    ray = hit.spawn_ray_to(target)
    hidden = lit.scene.ray_test(ray, active)
    if not lit.panes:
        return dr.select(active & ~hidden, mi.Spectrum(1.0), 0.0)

    def goes_on(clear: Any, ray: Any, active: Any) -> Any:
        return active

    def through(clear: Any, ray: Any, active: Any) -> tuple[Any, Any, Any]:
        met = lit.scene.ray_intersect(ray, mi.RayFlags.All, False, active)
        blocked = active & met.is_valid()
        bsdf = met.bsdf()
        clear = dr.select(blocked, clear * bsdf.eval_null_transmission(met, blocked), clear)
        active = blocked & (dr.max(clear) > 0)
        return clear, dr.select(active, met.spawn_ray_to(target), ray), active

    clear = dr.select(active, mi.Spectrum(1.0), 0.0)
    return dr.while_loop((clear, mi.Ray3f(ray), active & hidden), goes_on, through)[0]


def _chance(share: Any) -> Any:
    """The chance of a path to go on."""
    import drjit as dr

    return dr.minimum(_CHANCE * share, 1.0)


def _balance(mi: Any, a: Any, b: Any) -> Any:
    """Power heuristic of two densities (Veach 1997)."""
    import drjit as dr

    return dr.select(a > 0, dr.square(a) / (dr.square(a) + dr.square(b)), mi.Float(0.0))
