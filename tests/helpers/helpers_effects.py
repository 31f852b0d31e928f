"""Edits of the small study that apply one effect, or all of them, to the edges of its disc."""

from __future__ import annotations

CAMERA = "focal_px: 320"
FLAT = (
    "light: {environment: 0.7, lamps: [{position_m: [-0.3, -0.5, 0.0], size_m: 0.2, radiance: 6}]}",
    "light: {environment: 1.5}",
)
DISTORTION = "distortion: [-0.3, 0.1, 0.004, -0.003, 0.02]"
TWIST = "camera: {velocity_m_s: [0.3, 0.2, 0.1], rate_deg_s: [20, 30, -60]}"

Edits = tuple[tuple[str, str], ...]


def motion(keys: str) -> tuple[str, str]:
    """A motion section before the light's."""
    return "light:", f"motion: {{{keys}}}\nlight:"


EFFECTS: dict[str, Edits] = {
    "sharp": (),
    "defocus": ((CAMERA, CAMERA + ", aperture_mm: 20, focus_m: 0.45"),),
    # In focus for the marker; the Airy pattern's first dark ring has a radius of 2.1 px.
    "diffraction": ((CAMERA, CAMERA + ", aperture_mm: 0.1, focus_m: 0.64, diffraction: true"),),
    "motion": (motion("exposure_s: 0.02, " + TWIST),),
    "rolling_shutter": (motion("exposure_s: 0.005, readout_s: 0.03, " + TWIST),),
    "distortion": ((CAMERA, f"{CAMERA}, {DISTORTION}"),),
    "soft_edges": (("diameter_m: 0.08", "diameter_m: 0.08, edge_softness_m: 0.004"),),
    "all": (
        (
            CAMERA,
            f"{CAMERA}, {DISTORTION}, aperture_mm: 3, focus_m: 0.3, blades: 5, diffraction: true, "
            "wavelengths_nm: [450, 550, 650]",
        ),
        motion("exposure_s: 0.02, readout_s: 0.03, " + TWIST),
        ("diameter_m: 0.08", "diameter_m: 0.08, edge_softness_m: 0.001"),
    ),
}
