"""Pixels to ellipses: edges, fits, and the model of the pixels themselves.

band_pixels: The pixels of a band and their distances to an ellipse, with the derivatives: also through a lens that
    distorts
curvature_bias: The bias of the orthogonal-distance fit under isotropic noise, taken out
disc_blur: How a circle of confusion differs from a Gaussian blur of the same variance, at an edge
edge_band: The pixels around a contour: their distances to it, the sectors they belong to, and how far its edge
    extends
edges: Sub-pixel edge points on the contour of an ellipse, from the raw pixels around it
ellipse: Ellipses from points: the direct fit as a start, the orthogonal-distance fit as the estimate
ellipse_distance: Orthogonal projection of points on an ellipse: exact, and for all points at once
grey_levels: Grey levels along a contour: one pair, or as much more as the pixels ask for
guaranteed_fit: The guaranteed maximum-likelihood ellipse: the least Sampson distances among ellipses, never a
    hyperbola
image_levels: Any array that is an image, as grey levels with the level at which its pixels saturate
levenberg_marquardt: Levenberg-Marquardt for five parameters of an ellipse and many points: small, and sparing with
    evaluations
pixel_fit: The ellipse fitted to the pixels themselves: shape, blur and grey levels together, by weighted least
    squares
pixel_model: What the pixels along a contour should show, and how that changes with ellipse, blur and grey levels
pixel_scene: The pixels that `pixel_fit` fits: those of the edge, the plateaus beside it, and functions for their
    grey levels
"""
