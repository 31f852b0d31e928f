"""Pixels to ellipses: edges, fits, and the model of the pixels themselves.

band_pixels: The pixels of a band and their distances to an ellipse, with derivatives, also under lens distortion
disc_blur: Edge response of a defocus disc, relative to a Gaussian blur of the same variance
edge_band: The band of pixels around a contour: signed distances, sectors, and the extent of the edge
edges: Sub-pixel edge points on the contour of an ellipse, from the raw pixels around it
ellipse: Ellipses from points: a direct fit as the starting value, the orthogonal-distance fit as the estimate
ellipse_distance: Orthogonal projection of points on an ellipse, exact and vectorised
grey_levels: Grey levels inside and outside a contour: constants, or smooth functions where the pixels need them
guaranteed_fit: Guaranteed ellipse fit: minimal Sampson distances among ellipses, never a hyperbola
image_levels: An image array of any kind as grey levels, with its saturation level
levenberg_marquardt: Levenberg-Marquardt for the five parameters of an ellipse, with few function evaluations
pixel_fit: Ellipse, blur and grey levels fitted to the pixels together, by weighted least squares
pixel_model: The predicted pixels along a contour, with derivatives by ellipse, blur and grey levels
pixel_scene: The data of a pixel fit: pixels of the edge, the plateaus beside it, and basis functions of the grey
    levels
"""
