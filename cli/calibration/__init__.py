"""The verb `calibrate` of photographs: which board, what each photograph shows, the camera file and its page.

arguments: Arguments of `calibrate`
board_detection: What each photograph shows: the board in it, or why it does not count
boards: The board that was photographed: a kind with its sizes, a print of `roundel marker`, a YAML file, or --grid
from_photographs: Photographs of a board become a camera file and a page
wrong_board: When no photograph shows the board: perhaps they show another, whose counts or tags were taken for it
"""
