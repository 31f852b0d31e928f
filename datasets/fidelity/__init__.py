"""Rendered images compared with a float64 prediction.

measure: Fidelity: difference between the rendered image of a circle and its float64 prediction
pixel_coverage: Exact areas of closed curves in pixels, by Green's theorem
pixel_test: Test whether pixels differ from a prediction by their Monte-Carlo error alone
prediction: Predicted image of a print in float64: the pattern integrated over pixel, lens, time and wavelength
print_outlines: The pattern of a print as closed edges with their reflectance steps
projected_contours: Images of a print's edges, by forward projection only
quadrature: Quadrature nodes of a prediction: lens, time, diffraction, soft edges
selection: Selection of the circles whose fidelity is measured, and reasons for leaving out others
summary: Fidelity of a dataset, summarised over circles and by effect
"""
