"""Cameras: projection, lenses, motion and shutter, diffraction.

airy: Diffraction by the aperture: the Airy pattern, truncated at a declared radius
camera_file: Camera files: the camera keys of `cameras.json`, with the covariance of a calibration, as JSON or YAML
film: The 35 mm frame to which EXIF's equivalent focal length refers, and the default focal lengths of a phone
focal_fusion: Two statements about one focal length, fused: a prior, and a measurement from the image
intrinsics_label: Labels of intrinsics, such as `true` or `scaled:0.7`: parsing, order and display text
lens_fisheye: OpenCV's fisheye (Kannala and Brandt, 2006) on normalised coordinates: forward, field, and the exact
    inverse
lens_opencv: OpenCV's lens model on normalised coordinates: forward with its Jacobian, its field, and the exact
    inverse
model: The camera: intrinsics, the lens model and the thin lens, in float64
motion: Motion over the exposure: constant twists, and the exposure time of each sensor row
parameter_covariance: The parameters of a camera in OpenCV's order, and their covariance as camera files store it
phones: Cameras of phones: a table with sources, and normal distributions fitted to it
quarter_turns: A camera whose image is turned by quarter turns, as photographs are that were taken with the camera held
    upright
response_curve: Response curve of an image: how its levels depend on the light, as a record with its source, and its
    parser
row_time: When rows are read, and what is known of the motion meanwhile: what a camera declares about its rolling
    shutter
srgb: The sRGB curve (IEC 61966-2-1), both ways, on levels from 0 to 1
"""
