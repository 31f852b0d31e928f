"""Markers to print, to scale.

marker_layouts: Markers to print: a section of a study for each kind, all of whose sizes follow from one diameter
print_page: A marker to print, to scale: the sheet that the renderer renders, as vectors, with rulers that check the
    printer
"""
