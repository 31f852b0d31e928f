"""The tables of a report.

calibration: Tables of OpenCV's calibrations: residuals, and errors against the true camera
calibration_benefit: Tables of the benefit of a calibration: of one camera for every kind of intrinsics, and over
    several cameras
report: Tables of a report, made from its summary
statistics: Tables of recall at thresholds, comparisons with the main run, and statistical power
table: Tables as records, the source of HTML, CSV, Markdown and LaTeX
uncertainty: Tables of what a run states of itself: the regions of its poses, the probabilities of its candidates
writers: Tables as files: CSV, Markdown and LaTeX, with all text from users escaped
"""
