"""Photographs of a printed sheet with a board: the camera and the pose of every circle, measured from the boards.

board_search: The board of a sheet in a photograph, and whether the circle is where the sheet has it
camera_file: The camera of an import as a camera file, and back: parameters with their covariance
reference: Reference poses of circles, from the boards beside them, with covariance
"""
