"""Pixels to rays: lens, aperture, shutter, and how many of them.

rays: From pixels to rays, in one pass: pixel aperture, diffraction, distortion, thin lens, shutter and motion
sample_allocation: Where the edges of a frame are imaged: bands of pixels round them, known in closed form
samples: Which pixels get how many rays: few where the image is smooth, many where it has structure
undistort: The inverse of the lens model inside the tracer, in float32: image positions to the rays that the lens
    images there
"""
