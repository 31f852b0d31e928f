"""The verb `import`: photographs of a printed sheet become a dataset.

arguments: Arguments of `import`
board_photographs: Photographs read one by one, and the board that each shows
import_verb: The verb itself: sheet, boards, camera, reference poses, dataset
"""
