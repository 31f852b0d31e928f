"""Camera and motion of a frame, from sections of a study whose spreads are drawn."""

from __future__ import annotations

import numpy as np

from roundel.scenes.camera.film import FILM_DIAGONAL_MM
from roundel.scenes.camera.model import Camera, focal_at_focus_px, principal_point_at_centre
from roundel.scenes.camera.motion import Motion
from roundel.scenes.study.camera_section import CameraSection, MotionSection


def camera_of(section: CameraSection, fill_factor: float = 1.0) -> Camera:
    """The camera described by a section with all values drawn."""
    focus_m = section.focus_m if section.focus_m is not None else float("inf")
    focal_px: float
    focal_mm, pitch_um = section.focal_mm, section.pixel_pitch_um
    if focal_mm is not None and pitch_um is not None:
        focal_px = focal_at_focus_px(focal_mm, focus_m, pitch_um)
    else:
        assert section.focal_px is not None  # the schema requires one or the other
        focal_px = section.focal_px
    cx, cy = principal_point_at_centre(section.width_px, section.height_px)
    cx = section.principal_point_x_px if section.principal_point_x_px is not None else cx
    cy = section.principal_point_y_px if section.principal_point_y_px is not None else cy
    aperture_m = 0.0
    if section.f_number is not None and focal_mm is not None:
        aperture_m = focal_mm * 1e-3 / section.f_number / 2
    elif section.aperture_mm is not None:
        aperture_m = section.aperture_mm * 1e-3 / 2
    if section.diffraction and aperture_m == 0:
        raise ValueError("diffraction: an aperture of 0 lets no light through; give aperture_mm or f_number")
    # Phones write whole millimetres, based on the diagonal.
    diagonal_px = float(np.hypot(section.width_px, section.height_px))
    written = float(max(1, round(focal_px * FILM_DIAGONAL_MM / diagonal_px)))
    return Camera(
        width_px=section.width_px,
        height_px=section.height_px,
        K=np.array([[focal_px, section.skew_px, cx], [0.0, focal_px * section.aspect, cy], [0.0, 0.0, 1.0]]),
        distortion=tuple(section.distortion),
        aperture_radius_m=aperture_m,
        focus_distance_m=focus_m,
        focal_35mm_mm=section.focal_35mm_mm if section.focal_35mm_mm is not None else written,
        distortion_model=section.distortion_model,
        blades=section.blades,
        blade_turn_deg=section.blade_turn_deg,
        wavelengths_m=tuple(1e-9 * w for w in section.wavelengths_nm) if section.diffraction else (),
        natural_vignetting=section.natural_vignetting,
        barrel_radius_m=float("inf") if section.barrel_mm is None else section.barrel_mm * 1e-3 / 2,
        barrel_length_m=section.barrel_length_mm * 1e-3,
        pixel_side=float(np.sqrt(fill_factor)),
        magnification=(section.lateral_ca[0], 1.0, section.lateral_ca[1]) if section.lateral_ca else (),
    )


def motion_of(section: MotionSection, height_px: int, centre_row_px: float) -> Motion:
    """The motion described by a section with all values drawn.

    Raises
    ------
    ValueError
        If the exposure or the readout is longer than the frame time.
    """
    if section.exposure_s > section.frame_s:
        raise ValueError(
            f"exposure_s: {section.exposure_s:g} s exceeds the frame time of {section.frame_s:g} s; reduce it, or "
            "increase frame_s"
        )
    if section.readout_s > section.frame_s:
        raise ValueError(
            f"readout_s: {section.readout_s:g} s exceeds the frame time of {section.frame_s:g} s; reduce it, or "
            "increase frame_s"
        )
    twists = [
        np.array([*twist.velocity_m_s, *np.radians(np.array(twist.rate_deg_s, dtype=np.float64))], dtype=np.float64)
        for twist in (section.camera, section.marker)
    ]
    return Motion(section.exposure_s, section.readout_s / height_px, centre_row_px, *twists)
