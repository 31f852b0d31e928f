"""The declared Airy pattern against published values and integrals."""

import dataclasses

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import j0, j1

from roundel.scenes.camera.airy import REACH, effective_radius_m, encircled_energy, radius_table, spread_px
from roundel.scenes.camera.model import Camera

CAMERA = Camera(640, 480, np.diag([1000.0, 1000.0, 1.0]), aperture_radius_m=1e-3, focus_distance_m=1.0)


def test_the_first_dark_rings_hold_the_published_energy() -> None:
    # Born and Wolf, table 8.2: 83.8 % within the first dark ring (x = 1.220 pi), 91.0 % and 93.8 % within the next.
    for x_over_pi, energy in ((1.220, 0.838), (2.233, 0.910), (3.238, 0.938)):
        whole = 1 - j0(REACH) ** 2 - j1(REACH) ** 2
        assert encircled_energy(np.pi * x_over_pi) * whole == pytest.approx(energy, abs=6e-4)
    assert encircled_energy(REACH) == 1.0
    assert 1 - j0(REACH) ** 2 - j1(REACH) ** 2 > 0.985


def test_energy_is_the_integral_of_the_pattern() -> None:
    whole = 1 - j0(REACH) ** 2 - j1(REACH) ** 2
    for x in (0.5, 2.0, 7.0, 20.0):
        # dE = 2 J1(x)^2 / x dx
        integral, _ = quad(lambda t: 2 * j1(t) ** 2 / t, 0, x, limit=200)
        assert encircled_energy(x) * whole == pytest.approx(integral, abs=1e-9)


def test_the_table_inverts_the_energy() -> None:
    table = radius_table(4097)
    assert np.all(np.diff(table) >= 0)
    # Linear interpolation of x^2 over 64 k points: dark rings, where the energy stands still, are the worst.
    np.testing.assert_allclose(encircled_energy(np.sqrt(table)), np.linspace(0, 1, 4097), atol=1e-6)


def test_a_polygon_diffracts_like_the_circle_of_its_area() -> None:
    for blades, area in ((4, 2.0), (6, 1.5 * np.sqrt(3))):
        radius = effective_radius_m(dataclasses.replace(CAMERA, blades=blades))
        assert np.pi * radius**2 == pytest.approx(area * 1e-6, rel=1e-12)
    assert effective_radius_m(CAMERA) == 1e-3


def test_spread_scales_with_wavelength_over_aperture() -> None:
    assert spread_px(CAMERA) == (0.0, 0.0)
    green = spread_px(dataclasses.replace(CAMERA, wavelengths_m=(550e-9,)))
    wider = spread_px(dataclasses.replace(CAMERA, wavelengths_m=(1100e-9,)))
    assert green[1] == pytest.approx(REACH * 550e-9 * 1000 / (2 * np.pi * 1e-3), rel=1e-12)
    assert wider[0] == pytest.approx(2 * green[0], rel=1e-12)
    # Standard deviation along x by the radial integral of x^2/2 over the declared pattern.
    second, _ = quad(lambda t: t * j1(t) ** 2, 0, REACH, limit=400)
    scale = green[1] / REACH
    assert green[0] == pytest.approx(scale * np.sqrt(second / (1 - j0(REACH) ** 2 - j1(REACH) ** 2)), rel=1e-6)
