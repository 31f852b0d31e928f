"""Markers: what is printed where, as exact curves.

circle_grid: Where the dots of OpenCV's circle grids are
dot_codes: Identities in dots on two rings, in the spirit of RUNE-Tag (Bergamasco et al
ink_pattern: Reflectance of a sheet, point by point, in float64: the definition of what `roundel.render.scene.ink`
    traces
marker: Markers as exact ink: circles, squares, bars, cells and sectors in the plane of the print, in metres
outlines: Outlines of a sheet's edges as polylines, for the allocation of samples
plausible_size: Whether the size of a print is plausible in metres
ring_codes: Identities in the widths of concentric crowns, in the spirit of CCTag (Calvet et al
stag_codes: The layout of STag and its library HD21: Benligiray, Topal and Akinlar, STag: A Stable Fiducial Marker
    System (2019)
surfaces: Surfaces that a flat print is bent to without stretching: cylinders and waves
tags: Square tags: their cells by family and id, and their layout on a board
value_noise: Value noise: random numbers as a function of position, for paper grain and clutter
"""
