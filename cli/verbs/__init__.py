"""The verbs of the command, each in a few lines that call the packages.

calibrate: The verb `calibrate`, and a study's own calibrations: chessboards by OpenCV, circle grids by Roundel
chain: The verbs from a study to its report, and those that other modules carry out: each is a few lines
datasets: The verbs that look after datasets: verify, repair, merge, pull; and reading one that is not finished
exports: The verbs that take a dataset to others: export, card
gate: `roundel gate`, `roundel baseline` and `roundel compare`: reports held against each other
league: `roundel league`: run every entry over the study, score a submission, hold a part back
photos: Verbs for photographs, videos and printed markers
preview: `roundel preview`: a few frames of a study on a page, before it is rendered
reports: The verbs that take reports: compare, league, gate, baseline
studies: Shipped studies by name: listed, printed, copied as a starting point
"""
