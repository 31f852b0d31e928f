"""Views of drawn circles, as a method gets them, without a renderer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from helpers_circles import CircleScene
from helpers_images import picture

from roundel.scenes.camera.model import Camera
from roundel.scenes.camera.response_curve import LINEAR
from roundel.scenes.geometry.conic import ellipse_of_conic
from roundel.solver.methods.plugin import View

WIDTH_PX, HEIGHT_PX = 640, 480


def printed(kind: str, diameters_m: list[float], **layout: Any) -> list[dict[str, Any]]:
    """Rows of `cameras.json`, one for each diameter."""
    return [{"marker_id": i, "kind": kind, "diameter_m": d, "layout": layout} for i, d in enumerate(diameters_m)]


def view_of(
    scene: CircleScene,
    markers: list[dict[str, Any]],
    *,
    levels: list[float] | None = None,
    focal_factor: float = 1.0,
    focal_sigma: float = 0.0,
    noise_dn: float = 1.0,
    seed: int = 0,
    companions: Callable[[], list[View]] = list,
) -> View:
    """A view of a scene's circles painted in their order, dark on light, with the true camera or another."""
    ink = [40.0] * len(scene.conics) if levels is None else levels
    layers = [(ellipse_of_conic(conic), level) for conic, level in zip(scene.conics, ink, strict=True)]
    image = picture(layers, WIDTH_PX, HEIGHT_PX, noise_dn=noise_dn, seed=seed, subpixels=16)
    k = scene.K.copy()
    k[:2, :2] *= focal_factor
    diameter = 2.0 * float(scene.radii_m[0])
    return View(
        image,
        Camera(WIDTH_PX, HEIGHT_PX, k),
        diameter,
        markers,
        curve=LINEAR,
        focal_sigma=focal_sigma,
        companions=companions,
    )
