"""Markers: what is printed where, as exact curves.

ink_pattern: How a sheet reflects, point by point, in float64: the definition that `roundel.render.scene.ink`
    follows ray by ray
marker: Markers as exact ink: circles, squares, bars, cells and sectors in the plane of the print, in metres
outlines: Where the edges of a sheet are, as polylines: what a renderer has to look at closely
tags: Square tags: which of their cells are ink, by family and id; and which tag stands where on a board
value_noise: Random numbers that belong to places: the grain of paper, and clutter on a wall
"""
