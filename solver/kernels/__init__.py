"""The solver's inner loops, compiled by Numba: plain loops over pixels and points, without Python objects.

compiled: `compiled`: compile a function with Numba once, and keep the result on disk
contour_band: The grey levels in a wide band along a contour: how far they stay flat beside the edge, and whether
    they clip
contour_pixels: The pixels around an ellipse: a table with a row a pixel, sorted by the sectors of the contour
contour_scene: The pixels of a fit: level functions, sums over the plateaus, and the distances for another ellipse
curve_likelihood: Chi-square of an edge's pixels if light has passed a given response curve: the inner loop of
    `curve_evidence`
disc_blur: Edge response of a defocus disc minus that of a Gaussian blur, from a table for one variance
edge_response: Response of a square pixel to a blurred edge, one pixel at a time
ellipse_distances: Distances of points to an ellipse with their derivatives, in one pass
model_choice: Which further parameters and level functions the pixels of a contour show, to first order
order_statistics: Quantiles of some hundred values: a selection of our own compiles in a tenth of the time of
    NumPy's sort
pixel_equations: The normal equations of a fit to the pixels of a contour, in one pass over them
pixel_gauss_newton: Gauss-Newton for the ellipse, blur and grey levels of a contour, until the distances have to be
    computed again
sector_offsets: The offset of the edge in each sector of a contour, by Gauss-Newton with grey levels of the
    neighbourhood
small_matrices: Symmetric positive definite systems of a few unknowns, by Cholesky: too small for BLAS and its
    threads
texture_lookup: Bilinear reflectance of a printed texture at points of the image
trace_contour: From an approximate ellipse to the contour in the image: sectors of pixels, offsets, a better
    ellipse, again
"""
