"""Markers to print, to scale.

marker_layouts: Marker layouts for printing: all sizes follow from one diameter
print_page: Printable page: the sheet as vectors, to scale, with rulers to check the printer
"""
