"""Diffraction by the aperture: the Airy pattern, truncated at a declared radius.

Incoherent light of wavelength L through an aperture of radius A spreads over angles alpha (offsets in normalised
image coordinates) with intensity (2 J1(x) / x)^2, x = 2 pi A alpha / L (Born and Wolf, Principles of Optics, 8.5.2);
the energy within x is 1 - J0(x)^2 - J1(x)^2 (Rayleigh). The tail falls so slowly (2 / (pi x)) that the variance is
infinite: the declared pattern is truncated at `REACH`, which keeps 99 % of the light, and renormalised.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.camera.model import Camera

Array = NDArray[np.float64]

# Radius at which the declared pattern is truncated, in units of x.
REACH = 64.0


def encircled_energy(x: ArrayLike) -> Array:
    """Fraction of the declared pattern's light within radius x; 1 at `REACH`."""
    from scipy.special import j0, j1

    def of_all(at: Array) -> Array:
        return np.asarray(1 - j0(at) ** 2 - j1(at) ** 2, dtype=np.float64)

    inside = np.minimum(np.asarray(x, dtype=np.float64), REACH)
    return of_all(inside) / of_all(np.array(REACH))


def radius_table(entries: int) -> Array:
    """x^2 at which the encircled energy is 0, ..., 1 in `entries` even steps: the inverse, for drawing radii."""
    x = np.linspace(0.0, REACH, 64 * 1024)
    return np.asarray(np.interp(np.linspace(0, 1, entries), encircled_energy(x), x * x), dtype=np.float64)


def effective_radius_m(camera: Camera) -> float:
    """Radius of the round aperture with the area of this one (a polygon has less than its circumscribed circle)."""
    if camera.blades == 0:
        return camera.aperture_radius_m
    n = camera.blades
    return float(camera.aperture_radius_m * np.sqrt(n * np.sin(2 * np.pi / n) / (2 * np.pi)))


def spread_px(camera: Camera) -> tuple[float, float]:
    """Standard deviation along x and reach, in pixels, of the declared pattern of the longest wavelength."""
    if not camera.wavelengths_m:
        return 0.0, 0.0
    from scipy.special import jv

    scale = max(camera.wavelengths_m) * float(camera.K[0, 0]) / (2 * np.pi * effective_radius_m(camera))
    # The mean of x^2: the integral of 2 x J1(x)^2 is x^2 (J1^2 - J0 J2) (Lommel).
    j0, j1, j2 = (float(jv(order, REACH)) for order in range(3))
    mean_x2 = REACH**2 * (j1 * j1 - j0 * j2) / (1 - j0 * j0 - j1 * j1)
    return scale * float(np.sqrt(mean_x2 / 2)), scale * REACH
