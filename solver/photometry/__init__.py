"""Photometry: what the levels of an image say about light, and how exactly.

curve_displacement: Uncertainty of an ellipse whose image has an unknown response curve, for fits that do not know of it
curve_evidence: The response curve of an image, estimated from its edges
edge_levels: Levels along a contour, apart from any fit: both sides of the edge, and whether the edge overshoots them
frame_levels: A dataset's frame as grey levels, linear in light, with what its record says of its sensor
image_levels: An image array of any kind as grey levels that are linear in light, with its saturation level
jpeg_rounding: Noise that JPEG's quantisation adds to an edge, from the tables in the file
photometry: What is known about the levels of one image: response curve, rounding, and processing by the camera
processing_displacement: What a camera's processing does to an edge: a displacement by sharpening and tone curves
"""
