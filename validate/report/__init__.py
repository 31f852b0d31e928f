"""The pages: one report, or several compared.

compare: `roundel compare`: one page over several reports
html: Pages: templates filled so that no text of a user's is taken for anything but text
report: report.html: one file that stands alone, loads nothing and runs nothing
summary_text: The report in plain sentences: what was found, how far off, and why
"""
