"""Photographs: reading, solving, overlays.

overlay: What was found, drawn on the photograph: contour, centre, both normals, and the distance with its spread
photo_file: A photograph as a measuring instrument wants it: upright, grey, in linear light, with what its EXIF says
photo_report: Estimates from photographs as text: a readable record of each, and one line for the terminal
photographs: Photographs to poses: every file with the focal length that is known of it, as tables, as text, and as
    pictures
"""
