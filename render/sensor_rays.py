"""The sensor plugin: pixels to rays, through the lens distortion and the thin lens, in one pass.

World coordinates are the camera frame (OpenCV's: x right, y down, z forward), so the sensor has no transform.
"""

from __future__ import annotations

from typing import Any

from roundel.scenes.camera import Camera

NAME = "roundel_sensor"

# Newton steps of the inverse distortion: each doubles the digits, and float32 has seven.
_NEWTON_STEPS = 6

# Mitsuba counts image positions from the corner of the top-left pixel, OpenCV from its centre. This is the only
# place where the half pixel between them is taken off.
HALF_PIXEL = 0.5


def register_sensor(mi: Any) -> None:
    """Register the plugin with the current variant."""
    import drjit as dr

    class RoundelSensor(mi.Sensor):  # type: ignore[misc]
        """K, OpenCV distortion and a thin lens. Call `look_through` before use."""

        def __init__(self, props: Any) -> None:
            mi.Sensor.__init__(self, props)

        def look_through(self, camera: Camera) -> None:
            """Take the camera. Every number is opaque to the tracer, so that frames share one kernel."""

            def number(value: float) -> Any:
                return dr.opaque(mi.Float, value)

            k = camera.K
            self.size = number(camera.width_px), number(camera.height_px)
            self.fx, self.fy, self.skew = number(k[0, 0]), number(k[1, 1]), number(k[0, 1])
            self.cx, self.cy = number(k[0, 2]), number(k[1, 2])
            coefficients = (tuple(camera.distortion) + (0.0,) * 5)[:5]
            self.distortion: Any = [number(c) for c in coefficients] if any(coefficients) else None
            self.aperture = number(camera.aperture_radius_m) if camera.aperture_radius_m > 0 else None
            self.focus = number(camera.focus_distance_m) if camera.aperture_radius_m > 0 else None

        def _undistorted(self, xd: Any, yd: Any) -> tuple[Any, Any]:
            k1, k2, p1, p2, k3 = self.distortion
            x, y = xd, yd
            for _ in range(_NEWTON_STEPS):
                r2 = x * x + y * y
                radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
                slope = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))
                miss_x = xd - (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x))
                miss_y = yd - (y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y)
                a = radial + x * x * slope + 2 * p1 * y + 6 * p2 * x
                b = x * y * slope + 2 * p1 * x + 2 * p2 * y
                d = radial + y * y * slope + 6 * p1 * y + 2 * p2 * x
                determinant = a * d - b * b
                x = x + (d * miss_x - b * miss_y) / determinant
                y = y + (a * miss_y - b * miss_x) / determinant
            return x, y

        def rays(self, u_px: Any, v_px: Any, time: Any, aperture_sample: Any) -> Any:
            """Rays through image positions in OpenCV's pixel coordinates."""
            y = (v_px - self.cy) / self.fy
            x = (u_px - self.cx - self.skew * y) / self.fx
            if self.distortion is not None:
                x, y = self._undistorted(x, y)
            origin = dr.zeros(mi.Point3f, dr.width(x))
            direction = mi.Vector3f(x, y, 1.0)
            if self.aperture is not None:
                lens = self.aperture * mi.warp.square_to_uniform_disk_concentric(aperture_sample)
                origin = mi.Point3f(lens.x, lens.y, 0.0)
                direction = mi.Vector3f(x * self.focus, y * self.focus, self.focus) - mi.Vector3f(origin)
            return mi.Ray3f(origin, dr.normalize(direction), time, mi.Color0f())

        def sample_ray(
            self, time: Any, sample1: Any, sample2: Any, sample3: Any, active: Any = True
        ) -> tuple[Any, Any]:
            u = sample2.x * self.size[0] - HALF_PIXEL
            v = sample2.y * self.size[1] - HALF_PIXEL
            return self.rays(u, v, time, sample3), mi.Spectrum(1.0)

        def sample_ray_differential(
            self, time: Any, sample1: Any, sample2: Any, sample3: Any, active: Any = True
        ) -> tuple[Any, Any]:
            ray, weight = self.sample_ray(time, sample1, sample2, sample3, active)
            return mi.RayDifferential3f(ray), weight

        def needs_aperture_sample(self) -> bool:
            return self.aperture is not None

        def bbox(self) -> Any:
            return mi.BoundingBox3f()

        def to_string(self) -> str:
            return f"{NAME}[]"

    mi.register_sensor(NAME, RoundelSensor)
