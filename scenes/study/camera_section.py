"""Keys of the camera and its motion: lens, shutter, twists."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from roundel.scenes.camera.model import lens_problem
from roundel.scenes.study.section import Section
from roundel.scenes.study.values import AnyValue, Fraction, Magnification, NonNegative, Positive, Turn


class CameraSection(Section):
    """A camera: its focal length in pixels, or a lens in millimetres with the sensor's pixel pitch."""

    width_px: int = Field(ge=16, le=20_000, description="image width, px")
    height_px: int = Field(ge=16, le=20_000, description="image height, px")
    focal_px: Positive | None = Field(
        default=None, description="focal length at focus, px (K[0, 0]); instead of focal_mm"
    )
    focal_mm: Positive | None = Field(default=None, description="focal length of the lens, mm; needs pixel_pitch_um")
    pixel_pitch_um: Positive | None = Field(
        default=None, description="distance between the centres of adjacent pixels, um"
    )
    aspect: Positive = Field(default=1.0, description="fy / fx")
    skew_px: AnyValue = Field(default=0.0, description="skew K[0, 1], px")
    principal_point_x_px: AnyValue | None = Field(
        default=None, description="principal point in x, px; default: the image centre (width_px - 1) / 2"
    )
    principal_point_y_px: AnyValue | None = Field(
        default=None, description="principal point in y, px; default: the image centre (height_px - 1) / 2"
    )
    distortion_model: Literal["opencv", "fisheye"] = Field(
        default="opencv", description="OpenCV's rational model, or OpenCV's fisheye"
    )
    distortion: list[AnyValue] = Field(
        default=[],
        description="coefficients in OpenCV's order: k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tx ty]]]]; "
        "fisheye: k1 k2 k3 k4",
    )
    f_number: Positive | None = Field(
        default=None, description="focal length divided by aperture diameter; needs focal_mm and focus_m"
    )
    aperture_mm: NonNegative | None = Field(
        default=None, description="aperture diameter, mm; 0 is a pinhole; needs focus_m"
    )
    focus_m: Positive | None = Field(
        default=None, description="focus distance from the camera centre, along the optical axis, m"
    )
    blades: Literal[0, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12] = Field(
        default=0, description="number of aperture blades; 0 is a round aperture"
    )
    blade_turn_deg: Turn = Field(
        default=0.0, description="direction of the aperture's first corner, degrees from +x toward +y"
    )
    diffraction: bool = Field(default=False, description="whether to blur with the aperture's Airy pattern")
    wavelengths_nm: list[Positive] = Field(
        default=[550.0],
        min_length=1,
        max_length=16,
        description="wavelengths of the Airy pattern, nm, equally weighted; with a mosaic three: red, green, blue",
    )
    natural_vignetting: bool = Field(
        default=False, description="whether brightness falls with cos^4 of the field angle"
    )
    barrel_mm: Positive | None = Field(
        default=None, description="diameter of the lens barrel's front opening, mm; default: no barrel"
    )
    barrel_length_mm: NonNegative = Field(
        default=0.0, description="distance of that opening in front of the aperture, mm"
    )
    lateral_ca: list[Magnification] = Field(
        default=[],
        max_length=2,
        description="lateral chromatic aberration: magnification of red and of blue relative to green, such as "
        "[1.0004, 0.9997]; needs sensor.mosaic, and the truth is that of green",
    )
    veiling_glare: Fraction = Field(
        default=0.0, description="fraction of the frame's light that the lens spreads evenly over the image (ISO 9358)"
    )
    halo: Fraction = Field(
        default=0.0, description="fraction of the light that the lens spreads around its source, a Gaussian of halo_px"
    )
    halo_px: Positive = Field(default=40.0, description="standard deviation of the halo, px")
    focal_35mm_mm: Positive | None = Field(
        default=None,
        description="35 mm equivalent focal length in the file's EXIF, mm; default: the true one, rounded to whole mm",
    )

    @model_validator(mode="after")
    def _consistent(self) -> CameraSection:
        if (self.focal_px is None) == (self.focal_mm is None):
            raise ValueError("give either focal_px or focal_mm (with pixel_pitch_um)")
        if self.focal_mm is not None and self.pixel_pitch_um is None:
            raise ValueError("focal_mm needs pixel_pitch_um")
        problem = lens_problem(self.distortion_model, (0.0,) * len(self.distortion))
        if problem:
            raise ValueError(problem)
        if len(self.lateral_ca) == 1:
            raise ValueError("lateral_ca takes two magnifications: red, blue")
        if (
            isinstance(self.veiling_glare, float)
            and isinstance(self.halo, float)
            and self.veiling_glare + self.halo > 1
        ):
            raise ValueError("veiling_glare and halo spread more light than there is; make them smaller")
        if self.f_number is not None and (self.aperture_mm is not None or self.focal_mm is None):
            raise ValueError("f_number needs focal_mm; with focal_px give aperture_mm")
        has_aperture = self.f_number is not None or self.aperture_mm is not None
        if has_aperture and self.focus_m is None:
            raise ValueError("an aperture needs focus_m, the distance in focus")
        if not has_aperture and (self.diffraction or self.barrel_mm is not None):
            raise ValueError("diffraction and a barrel need an aperture: give f_number or aperture_mm, and focus_m")
        return self


class TwistSection(Section):
    """A constant velocity, in the moving body's own frame, through mid-exposure of the marker's centre row."""

    velocity_m_s: list[AnyValue] = Field(
        default=[0.0, 0.0, 0.0], min_length=3, max_length=3, description="velocity along x, y, z, m/s"
    )
    rate_deg_s: list[AnyValue] = Field(
        default=[0.0, 0.0, 0.0], min_length=3, max_length=3, description="angular velocity about x, y, z, degrees/s"
    )


class TwistPriorSection(Section):
    """Standard deviations of each component of the camera's twist relative to the marker, for the solver to assume.

    The components are independent, normal, with mean zero, in the camera's frame.
    """

    velocity_sigma_m_s: float = Field(ge=0, le=100, description="of the velocity, m/s")
    rate_sigma_deg_s: float = Field(ge=0, le=3600, description="of the rate of rotation, degrees/s")


class MotionSection(Section):
    """When each row is exposed, and what moves during the exposure."""

    exposure_s: NonNegative = Field(default=0.01, description="exposure time of each row, s")
    readout_s: NonNegative = Field(
        default=0.0,
        description="time to read all rows, s: the delay from one row to the next times height_px; 0 is a global "
        "shutter",
    )
    frame_s: Positive = Field(default=1.0, description="time between two frames, s; not shorter than the exposure")
    twist_prior: TwistPriorSection | None = Field(
        default=None,
        description="what the solver may assume about the motion of the camera; recorded in cameras.json. "
        "Default: nothing, and the solver assumes a camera that moves if its shutter is a rolling one",
    )
    camera: TwistSection = Field(default=TwistSection(), description="motion of the camera, in its own frame")
    marker: TwistSection = Field(default=TwistSection(), description="motion of the marker, in its own frame")
