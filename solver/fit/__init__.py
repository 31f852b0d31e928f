"""Pixels to ellipses: edges, fits, and the model of the pixels themselves.

band_pixels: Distances of pixels to an ellipse, with derivatives, under lens distortion
contour_sectors: Sectors of a contour where the model does not hold, and errors that neighbouring sectors share
edge_fit: The ellipse of edge points along a contour: sectors off it are left out, and shared errors widen its
    covariance
edges: Sub-pixel edge points on the contour of an ellipse, from the raw pixels around it
ellipse: Ellipses from points: a direct fit as the starting value, the orthogonal-distance fit as the estimate
ellipse_distance: Orthogonal projection of points on an ellipse, exact and vectorised
guaranteed_fit: Guaranteed ellipse fit: minimal Sampson distances among ellipses, never a hyperbola
levenberg_marquardt: Levenberg-Marquardt for a few parameters, as the five of an ellipse, with few function
    evaluations
local_light: Light that smooth functions do not follow: departures of the grey levels, sector by sector of a contour
pixel_covariance: The covariance of a fit to the pixels: that of the noise, raised by what the residuals show of the
    model's errors
pixel_fit: Ellipse, blur and grey levels fitted to the pixels together, by weighted least squares
pixel_scene: The data of a pixel fit: pixels of the edge, the plateaus beside it, and functions of the grey levels
row_motion: The motion of an ellipse while the rows of the image are read, under a prior
sector_planes: Planes of the grey levels in the sectors of a contour, by least squares over the neighbouring sectors
settled_fit: One fit to the pixels of given sectors: what its model needs, and Gauss-Newton until it settles
"""
