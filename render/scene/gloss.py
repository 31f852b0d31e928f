"""Gloss on a bare plane in closed form: what it reflects of a uniform sky, and of a lamp.

The sky is seen by every reflected ray, and yet it is what made glossy frames noisy: a reflection is drawn from the
gloss or from the print below, and the two weigh differently. Its light is therefore a table: the albedo of the surface
by angle, integrated once. Only the lamp, minus the sky that it hides, is sampled.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.render.scene.materials import surface
from roundel.scenes.study.marker_section import SurfaceSection

# Angles of the table, even in the cosine, and points of the integral at each: some 1e-4 of the albedo.
_ANGLES, _POINTS_BASE2 = 97, 14

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Gloss:
    """A glossy surface for the tracer.

    Its albedo at an angle is `coat + base r / (1 - inside r)` for a print of reflectance r: what the coat reflects, and
    what passes it twice, with reflections inside the coat. `coat` and `base` are tables over the cosine.
    """

    bsdf: Any
    coat: Any
    base: Any
    inside: Any

    def albedo(self, cosine: Any, reflectance: Any) -> Any:
        """Share of a uniform sky's radiance that is reflected (Float)."""
        import drjit as dr

        place = dr.clip(cosine, 0.0, 1.0) * (_ANGLES - 1)
        low = dr.minimum(dr.uint32_array_t(place)(place), _ANGLES - 2)
        part = place - low
        coat, base = (
            (1 - part) * dr.gather(type(table), table, low) + part * dr.gather(type(table), table, low + 1)
            for table in (self.coat, self.base)
        )
        return coat + base * reflectance / (1 - self.inside * reflectance)


def gloss_of(mi: Any, section: SurfaceSection, texture: Any) -> Gloss:
    """A glossy surface over a print."""
    import drjit as dr

    coat, base, inside = _tables(mi.variant(), section.kind, section.roughness, section.ior)
    tables = [mi.Float(table.astype(np.float32)) for table in (coat, base)]
    return Gloss(mi.load_dict(surface(section, texture)), tables[0], tables[1], dr.opaque(mi.Float, inside))


def glossy_light(
    dr: Any,
    mi: Any,
    gloss: Gloss,
    normal: Any,
    sky: Any,
    lamps: Any,
    reflectance: Any,
    sampler: Any,
    hit: Any,
    ray: Any,
) -> Any:
    """Radiance that a glossy plane reflects of a uniform sky and lamps.

    Parameters
    ----------
    gloss : Gloss
    normal : Vector3f
        Of the plane.
    sky : Spectrum
    lamps : sequence of roundel.render.scene.transport.Lamp
    reflectance : Float
        Of the print.
    sampler : Sampler
    hit : Point3f
        Points of the plane.
    ray : RayDifferential3f
    """
    frame = mi.Frame3f(normal)
    at = dr.zeros(mi.SurfaceInteraction3f, dr.width(hit))
    at.p, at.n, at.sh_frame, at.wi = hit, mi.Normal3f(normal), frame, frame.to_local(-ray.d)
    radiance = sky * gloss.albedo(at.wi.z, reflectance)
    context = mi.BSDFContext()
    for lamp in lamps:
        if lamp.area is None:
            toward = lamp.place - hit
            r2 = dr.squared_norm(toward)
            radiance += lamp.light * gloss.bsdf.eval(context, at, frame.to_local(toward * dr.rsqrt(r2))) / r2
            continue
        # A point of the lamp, and a direction of the reflection: each suits one of a sharp and a broad highlight.
        sample = sampler.next_2d()
        toward = lamp.place + (2 * sample.x - 1) * lamp.half_x + (2 * sample.y - 1) * lamp.half_y - hit
        value, density = gloss.bsdf.eval_pdf(context, at, frame.to_local(dr.normalize(toward)))
        radiance += _shown(dr, mi, sky, lamp, toward) * value * _weighted(dr, _density(dr, lamp, toward), density)
        drawn, weight = gloss.bsdf.sample(context, at, sampler.next_1d(), sampler.next_2d())
        way = frame.to_world(drawn.wo)
        toward = way * (dr.dot(lamp.place - hit, lamp.normal) / dr.dot(way, lamp.normal))
        across = hit + toward - lamp.place
        met = (
            (dr.dot(toward, way) > 0)
            & (drawn.pdf > 0)
            & (dr.abs(dr.dot(across, lamp.half_x)) < dr.squared_norm(lamp.half_x))
            & (dr.abs(dr.dot(across, lamp.half_y)) < dr.squared_norm(lamp.half_y))
        )
        share = drawn.pdf * _weighted(dr, drawn.pdf, _density(dr, lamp, toward))
        radiance += dr.select(met, _shown(dr, mi, sky, lamp, toward) * weight * share, mi.Spectrum(0.0))
    return radiance


def _shown(dr: Any, mi: Any, sky: Any, lamp: Any, toward: Any) -> Any:
    """A lamp's radiance less that of the sky that it hides; its back is black and hides the sky, too."""
    return dr.select(dr.dot(lamp.normal, toward) < 0, lamp.light, mi.Spectrum(0.0)) - sky


def _density(dr: Any, lamp: Any, toward: Any) -> Any:
    """Density of a direction toward a lamp whose points are drawn evenly."""
    r2 = dr.squared_norm(toward)
    return r2 * dr.sqrt(r2) / (dr.abs(dr.dot(lamp.normal, toward)) * lamp.area)


def _weighted(dr: Any, mine: Any, other: Any) -> Any:
    """One over a density, times the power heuristic's weight against another (Veach 1997)."""
    return dr.select(mine > 0, mine / (dr.square(mine) + dr.square(other)), 0.0)


@lru_cache(maxsize=8)
def _tables(variant: str, kind: Any, roughness: float, ior: float) -> tuple[Array, Array, float]:
    """Albedo of the coat, of what is below it for a factor of 1, and the share that is reflected inside.

    From the albedos for prints of reflectance 0, 1/2 and 1.
    """
    import drjit as dr
    import mitsuba as mi
    from scipy.stats import qmc

    section = SurfaceSection(kind=kind, roughness=roughness, ior=ior)
    points = qmc.Sobol(3, scramble=True, rng=np.random.default_rng(0)).random_base2(_POINTS_BASE2).astype(np.float32)
    # Grazing itself reflects everything, and is no limit of what is sampled.
    cosines = np.linspace(0, 1, _ANGLES)
    cosines[0] = 1e-3
    count = len(points)
    hit = dr.zeros(mi.SurfaceInteraction3f, count * _ANGLES)
    z = mi.Float(np.repeat(cosines, count).astype(np.float32))
    hit.wi = mi.Vector3f(dr.sqrt(1 - z * z), 0.0, z)
    one, x, y = (mi.Float(np.tile(column, _ANGLES)) for column in points.T)
    found = []
    for reflectance in (0.0, 0.5, 1.0):
        bsdf = mi.load_dict(surface(section, {"type": "uniform", "value": reflectance}))
        _, weight = bsdf.sample(mi.BSDFContext(), hit, one, mi.Point2f(x, y))
        found.append(np.array(dr.block_sum(weight[0], count) / count, dtype=np.float64))
    coat, half, whole = found[0], found[1] - found[0], found[2] - found[0]
    # With k = half / whole: k = (1 - F) / (2 - F).
    k = float(half.sum() / whole.sum())
    inside = (1 - 2 * k) / (1 - k)
    return coat, whole * (1 - inside), inside
