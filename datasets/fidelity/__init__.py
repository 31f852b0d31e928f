"""Rendered images compared with a float64 prediction.

measure: Fidelity: how far the rendered image of a circle lies from its float64 prediction, measured
pixel_coverage: Exact areas of closed curves in pixels: signed areas of short segments, by Green's theorem
pixel_test: Whether pixels differ from a prediction by their Monte-Carlo error and no more
prediction: What an image of a print must be, in float64: the analytic pattern integrated over pixel, lens, time and
    wavelength
print_outlines: The pattern of a print as closed edges: circles and polygons, each with the step of reflectance
    inside it
projected_contours: Where a camera images the edges of a print: by forward projection only, node by node
quadrature: The points over which a prediction averages: where on the lens, when, how far diffracted, how deep in a
    soft edge
selection: Which circles fidelity is measured on, what is at work on their edges, and why others are left out
summary: The fidelity of a dataset, from that of its circles: in figures, over all and by effect, and in a few lines
"""
