"""Printing markers to scale.

marker_layouts: Marker layouts for printing: all sizes follow from one diameter
print_page: Printable page: the target sheet as vectors, to scale, with rulers to check the printer
"""
