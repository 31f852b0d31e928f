"""The tables of a report.

calibration: What OpenCV's calibrations are worth, as tables: their own residuals, and their cameras beside the true
    one
calibration_benefit: What calibration is worth, as a table: every kind of intrinsics on the axis and off it
report: The tables of a report, from its summary: the page shows them, and files carry them on
statistics: Tables of what the numbers are worth: recall at thresholds, runs beside the main one, and the power of
    the set
table: Tables as records: what a page, a CSV file, a Markdown file and a LaTeX file are all made from
writers: Tables as files: CSV for programs, Markdown and LaTeX for papers
"""
