"""A camera from photographs of a printed board: its file, its page, and what to photograph next.

coverage: What the photographs of a board cover: the image, and the directions in which the board was tilted
figures: Figures of a calibration: which parts of the image the board covered, and what the camera does not explain
from_corners: A camera from the corners of boards in photographs: of a chessboard or a ChArUco board
next_photo: Which photograph of the board would make a camera most certain: predicted, not guessed
page: The page of a calibration from photographs: no script, nothing from a network
record: A calibration from photographs of a board, as its camera file and its page need it
summary: A calibration from photographs in words: for the terminal and for its page
"""
