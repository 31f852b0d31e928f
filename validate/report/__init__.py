"""The pages: one report, or several compared.

compare: `roundel compare`: one page over several reports, paired by frame where they share a dataset
html: HTML pages from templates; all text from users is escaped
report: report.html: a self-contained page without scripts or external files
summary_text: Summary text of a report
"""
