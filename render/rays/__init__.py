"""From pixels to rays: lens, aperture, shutter, and sample counts.

rays: From pixels to rays, in one pass: pixel aperture, diffraction, distortion, thin lens, shutter and motion
sample_allocation: Bands of pixels around the imaged edges of a frame, in closed form
samples: Samples per pixel: few where the image is smooth, many where it has structure
undistort: The inverse of the lens model inside the tracer, in float32: image positions to the rays that the lens
    images there
"""
