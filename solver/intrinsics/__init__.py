"""Which camera the solver assumes, and how uncertain it is.

exif: What a photograph's EXIF tells of the focal length, and how firmly
specification: Which camera an estimate is made with: the frame's own, a scaled or calibrated one, or one that is
    assumed
uncertain_camera: A camera that is assumed rather than measured: what is believed of it, how firmly, and on what
    ground
"""
