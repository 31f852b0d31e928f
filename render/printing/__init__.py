"""Printing markers to scale.

board_file: The description of a board, written into the print itself, and read from it
marker_layouts: Marker layouts for printing: all sizes follow from one diameter
print_page: Printable page: the target sheet as vectors, to scale, with rulers to check the printer
"""
