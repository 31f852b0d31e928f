"""Which camera the solver assumes, and how uncertain it is.

default_phone: The default phone: the phones that it stands for, and the conventions of 35-mm equivalence
exif: Focal length and its uncertainty from a photograph's EXIF
plausibility: Plausibility of a given focal length: numbers that look as if they were in another unit
shutter: The rolling shutter of a camera of which nothing is declared: a phone held still by a hand
specification: Parse `--intrinsics` and make its camera: true, scaled, calibrated, from EXIF, or the default phone
uncertain_camera: A camera with its uncertainty: the best guess, its standard deviations, and their basis
"""
